"""Poses on the device; quaternions are (w, x, y, z) in a `wp.vec4`, as in `device/quaternions.py`."""

import warp as wp

from sceniris_gym.device.angles import unit_circle


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
    """Return `b`, given in the frame of `a`, in the parent frame of `a`."""
    return Pose(a.pos + a.rot * b.pos, a.rot * b.rot)


@wp.func
def relative(a: Pose, b: Pose) -> Pose:
    """Return `b` in the frame of `a`, both given in one frame."""
    at = wp.transpose(a.rot)
    return Pose(at * (b.pos - a.pos), at * b.rot)


@wp.func
def apply(a: Pose, v: wp.vec3) -> wp.vec3:
    """Return the point `v`, given in the frame of `a`, in the parent frame of `a`."""
    return a.pos + a.rot * v
