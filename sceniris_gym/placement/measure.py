"""The orientation of an object: draw it, turn it to face another object, and measure the pivot and bounds.

Every orientation is a rotation with heading 0, followed by a yaw about the vertical. The rotation with heading 0
determines the pivot, the bounds and the lowest point. The heading of an object is the direction of its root's x axis,
seen from above. If that axis points straight up or down, the heading is the direction of the y axis minus 90 degrees.
"""

import math

import warp as wp

from sceniris_gym.collide.leaves import lowest
from sceniris_gym.device.transforms import angle_of, mul_quat, quat_mat, quat_z, unit_circle
from sceniris_gym.placement.kinematics import pose_bodies
from sceniris_gym.placement.placed import rotated
from sceniris_gym.program.device import Measure, OrientationType, Program

# An x axis points straight up or down if, seen from above, it is shorter than this, as in `scene/poses.py`.
_UPRIGHT = wp.constant(1.0e-3)
_TWO_PI = wp.constant(2.0 * math.pi)


@wp.struct
class StableDraw:
    """A drawn orientation: a rotation `quat` with heading 0, a yaw [rad], and the object's pivot and bounds.

    `stable` is the index of the stable pose in the `stable_*` arrays of `Program`. `pivot` is in the root's frame [m].
    `bounds` is (low x, low y, high x, high y) relative to the pivot [m], at heading 0.
    """

    stable: int
    quat: wp.vec4
    yaw: float
    pivot: wp.vec3
    bounds: wp.vec4


@wp.func
def heading_of(quat: wp.vec4) -> float:
    """Return the heading [rad] of a root with orientation `quat`."""
    mat = quat_mat(quat)
    if wp.abs(mat[0, 0]) + wp.abs(mat[1, 0]) < _UPRIGHT:
        return angle_of(mat[1, 1], -mat[0, 1])
    return angle_of(mat[0, 0], mat[1, 0])


@wp.func
def _any_quat(u: wp.vec4) -> wp.vec4:
    """Return a uniformly distributed rotation (wxyz) from three uniform numbers, the first entries of `u`.

    K. Shoemake, "Uniform random rotations", Graphics Gems III, 1992.
    """
    a = wp.sqrt(1.0 - u[0])
    b = wp.sqrt(u[0])
    first = unit_circle(_TWO_PI * u[1])
    second = unit_circle(_TWO_PI * u[2])
    return wp.vec4(b * second[0], a * first[1], a * first[0], b * second[1])


@wp.func
def draw_stable(program: Program, worldid: int, obj: int, u: wp.vec4, w: wp.vec4) -> StableDraw:
    """Draw an orientation of an object from the uniform random numbers `u` and `w`.

    `u[0]` gives the yaw, and `w[3]` selects the stable pose. With `orientation: any`, `w` instead gives the whole
    rotation, including its yaw.
    """
    stable = program.obj_stableadr[obj]
    last = stable + program.obj_stablenum[obj] - 1
    # the last pose is not compared, because rounding may leave its cumulative probability below the uniform number
    while stable < last and w[3] >= program.stable_cdf[stable]:
        stable += 1
    quat = program.stable_quat[stable]
    interval = program.obj_yaw[worldid, obj]
    yaw = interval[0] + u[0] * (interval[1] - interval[0])
    if program.obj_orientation[obj] == OrientationType.ANY:
        rotation = _any_quat(w)
        yaw = heading_of(rotation)
        quat = mul_quat(quat_z(-yaw), rotation)
    return StableDraw(stable, quat, yaw, program.stable_pivot[stable], program.stable_bounds[stable])


@wp.func
def facing(at: wp.vec2, target: wp.vec2) -> float:
    """Return the heading [rad] with which the front (-y) of an object at `at` points to `target`."""
    d = rotated(target - at, 0.5 * wp.static(math.pi))
    return angle_of(d[0], d[1])


@wp.func
def _least(
    program: Program, obj: int, num: int, axis: wp.vec3, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> float:
    """Return the least coordinate [m] of an object's first `num` pieces along the unit vector `axis` of the world."""
    least = float(1.0e30)
    for i in range(num):
        piece = program.piece_list[program.obj_pieceadr[obj] + i]
        body = program.piece_body[piece]
        along = wp.transpose(quat_mat(body_quat[body])) * axis
        least = wp.min(least, wp.dot(body_pos[body], axis) + lowest(program, piece, along))
    return least


@wp.func
def _extents(
    program: Program, obj: int, x: wp.vec3, y: wp.vec3, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> wp.vec4:
    """Return the extents of a posed object along two unit vectors `x` and `y` of the world [m].

    The result is (low x, low y, high x, high y).
    """
    num = program.obj_piecenum[obj]
    low_x = _least(program, obj, num, x, body_pos, body_quat)
    low_y = _least(program, obj, num, y, body_pos, body_quat)
    high_x = -_least(program, obj, num, -x, body_pos, body_quat)
    return wp.vec4(low_x, low_y, high_x, -_least(program, obj, num, -y, body_pos, body_quat))


@wp.func
def measure(
    program: Program,
    obj: int,
    drawn: StableDraw,
    qpos: wp.array[float],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> StableDraw:
    """Return `drawn` with the pivot measured at the drawn joint positions. `Measure.WHOLE` also measures the bounds.

    The height of the pivot is the height of the object's lowest point. Horizontally, the pivot is the centre of the
    bounds that the object has with joints in the home pose. With `orientation: any` and `Measure.WHOLE`, it is the
    centre of the measured bounds instead. On return, `body_pos` and `body_quat` have the poses of the bodies with the
    root at the origin and heading 0.
    """
    body_pos[program.obj_body[obj]] = wp.vec3(0.0)
    body_quat[program.obj_body[obj]] = drawn.quat
    pose_bodies(program, obj, 1, qpos, body_pos, body_quat)
    bottom = quat_mat(drawn.quat) * drawn.pivot
    if program.obj_measured[obj] == Measure.WHOLE:
        ends = _extents(program, obj, wp.vec3(1.0, 0.0, 0.0), wp.vec3(0.0, 1.0, 0.0), body_pos, body_quat)
        if program.obj_orientation[obj] == OrientationType.ANY:
            bottom[0] = 0.5 * (ends[0] + ends[2])
            bottom[1] = 0.5 * (ends[1] + ends[3])
        drawn.bounds = ends - wp.vec4(bottom[0], bottom[1], bottom[0], bottom[1])
    bottom[2] = _least(program, obj, program.obj_lownum[obj], wp.vec3(0.0, 0.0, 1.0), body_pos, body_quat)
    drawn.pivot = wp.transpose(quat_mat(drawn.quat)) * bottom
    return drawn


@wp.func
def bounds_of(
    program: Program, obj: int, pivot_pose: wp.vec4, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> wp.vec4:
    """Return the bounds (low x, low y, high x, high y) [m] of a posed object, relative to its pivot.

    The x axis of the bounds points along the object's heading. `pivot_pose` is (x, y, z, heading) of the pivot.
    """
    to = unit_circle(pivot_pose[3])
    ahead = wp.vec3(to[0], to[1], 0.0)
    across = wp.vec3(-ahead[1], ahead[0], 0.0)
    pivot = wp.vec3(pivot_pose[0], pivot_pose[1], 0.0)
    x = wp.dot(pivot, ahead)
    y = wp.dot(pivot, across)
    return _extents(program, obj, ahead, across, body_pos, body_quat) - wp.vec4(x, y, x, y)
