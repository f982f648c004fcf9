"""Poses and quaternions on the device, in MuJoCo's order (w, x, y, z), stored in a `wp.vec4`.

Warp's `wp.quat` is (x, y, z, w). Device code here does not compute with it, so the two orders are never mixed up.
"""

import warp as wp

from sceniris_gym.device.angles import angle_of, unit_circle

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def mul_quat(a: wp.vec4, b: wp.vec4) -> wp.vec4:
    """Return the Hamilton product of two wxyz quaternions."""
    return wp.vec4(
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@wp.func
def neg_quat(q: wp.vec4) -> wp.vec4:
    """Return the inverse of a unit wxyz quaternion."""
    return wp.vec4(q[0], -q[1], -q[2], -q[3])


@wp.func
def rot_vec_quat(v: wp.vec3, q: wp.vec4) -> wp.vec3:
    """Return `v` rotated by the unit wxyz quaternion `q`."""
    u = wp.vec3(q[1], q[2], q[3])
    t = 2.0 * wp.cross(u, v)
    return v + q[0] * t + wp.cross(u, t)


@wp.func
def z_axis(q: wp.vec4) -> wp.vec3:
    """Return the z axis of a frame with the unit wxyz orientation `q`."""
    return wp.vec3(
        2.0 * (q[1] * q[3] + q[0] * q[2]),
        2.0 * (q[2] * q[3] - q[0] * q[1]),
        1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]),
    )


@wp.func
def turn_z(q: wp.vec4, angle: float) -> wp.vec4:
    """Return `q` followed by a rotation by `angle` [rad] about the z axis of its frame."""
    to = unit_circle(0.5 * angle)
    c = to[0]
    s = to[1]
    return wp.vec4(q[0] * c - q[3] * s, q[1] * c + q[2] * s, q[2] * c - q[1] * s, q[3] * c + q[0] * s)


@wp.func
def rotation_vector(q: wp.vec4) -> wp.vec3:
    """Return axis times angle [rad] of the unit wxyz quaternion `q`, with an angle from 0 to pi."""
    v = wp.vec3(q[1], q[2], q[3])
    w = q[0]
    if w < 0.0:
        v = -v
        w = -w
    s = wp.length(v)
    return wp.where(s > 1.0e-6, 2.0 * angle_of(w, s) / s, 2.0) * v


@wp.struct
class Pose:
    """A rigid pose: `x = pos + rot @ y` maps a point y of the posed frame to its parent frame."""

    pos: wp.vec3
    rot: wp.mat33


@wp.func
def quat_z(angle: float) -> wp.vec4:
    """Return the quaternion of a rotation by `angle` [rad] about z."""
    to = unit_circle(0.5 * angle)
    return wp.vec4(to[0], 0.0, 0.0, to[1])


@wp.func
def axis_angle_quat(axis: wp.vec3, angle: float) -> wp.vec4:
    """Return the quaternion of a rotation by `angle` [rad] about the unit vector `axis`."""
    to = unit_circle(0.5 * angle)
    return wp.vec4(to[0], axis[0] * to[1], axis[1] * to[1], axis[2] * to[1])


@wp.func
def quat_mat(q: wp.vec4) -> wp.mat33:
    """Return the rotation matrix of the unit wxyz quaternion `q`."""
    w = q[0]
    x = q[1]
    y = q[2]
    z = q[3]
    return wp.mat33(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@wp.func
def pose_of(pos: wp.vec3, quat: wp.vec4) -> Pose:
    """Return the pose with position `pos` and unit wxyz orientation `quat`."""
    return Pose(pos, quat_mat(quat))


@wp.func
def compose(a: Pose, b: Pose) -> Pose:
    """Convert the pose `b` from the frame of `a` to the parent frame of `a`."""
    return Pose(a.pos + a.rot * b.pos, a.rot * b.rot)


@wp.func
def relative(a: Pose, b: Pose) -> Pose:
    """Convert the pose `b` to the frame of `a`. `a` and `b` have the same parent frame."""
    at = wp.transpose(a.rot)
    return Pose(at * (b.pos - a.pos), at * b.rot)


@wp.func
def apply(a: Pose, v: wp.vec3) -> wp.vec3:
    """Convert the point `v` from the frame of `a` to the parent frame of `a`."""
    return a.pos + a.rot * v
