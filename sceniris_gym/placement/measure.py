"""Pivots and bounds: measure the lowest point of a posed object, and its bounds as relations see them."""

import warp as wp

from sceniris_gym.collide.leaves import lowest
from sceniris_gym.device.angles import unit_circle
from sceniris_gym.device.transforms import quat_mat
from sceniris_gym.placement.kinematics import pose_bodies
from sceniris_gym.placement.orientations import DrawnVariant
from sceniris_gym.program.device import Measure, OrientationType, Program


@wp.func
def _least(
    program: Program, obj: int, axis: wp.vec3, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> float:
    """Return the least coordinate [m] of a posed object along a unit vector of the world."""
    least = float(1.0e30)
    for i in range(program.obj_piecenum[obj]):
        piece = program.piece_list[program.obj_pieceadr[obj] + i]
        body = program.piece_body[piece]
        along = wp.transpose(quat_mat(body_quat[body])) * axis
        least = wp.min(least, wp.dot(body_pos[body], axis) + lowest(program, piece, along))
    return least


@wp.func
def _extents(
    program: Program,
    obj: int,
    x: wp.vec3,
    y: wp.vec3,
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> wp.vec4:
    """Return where a posed object begins and ends along two axes [m]: low x, low y, high x, high y."""
    low_x = _least(program, obj, x, body_pos, body_quat)
    low_y = _least(program, obj, y, body_pos, body_quat)
    high_x = -_least(program, obj, -x, body_pos, body_quat)
    return wp.vec4(low_x, low_y, high_x, -_least(program, obj, -y, body_pos, body_quat))


@wp.func
def measure(
    program: Program,
    obj: int,
    drawn: DrawnVariant,
    qpos: wp.array[float],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> DrawnVariant:
    """Return `drawn` with its pivot at the lowest point and, if need be, its bounds in the drawn joint state.

    Leaves the bodies posed with the root at the origin, heading 0. Sideways the pivot stays the centre of the bounds in
    the start pose of the joints; with `orientation: any` it is the centre of the drawn bounds.
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
    bottom[2] = _least(program, obj, wp.vec3(0.0, 0.0, 1.0), body_pos, body_quat)
    drawn.pivot = wp.transpose(quat_mat(drawn.quat)) * bottom
    return drawn


@wp.func
def bounds_of(
    program: Program,
    obj: int,
    place: wp.vec4,
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> wp.vec4:
    """Return the bounds (low x, low y, high x, high y) [m] of a posed object around its pivot, in its own heading.

    `place` is (x, y, z, heading) of the pivot.
    """
    to = unit_circle(place[3])
    ahead = wp.vec3(to[0], to[1], 0.0)
    across = wp.vec3(-ahead[1], ahead[0], 0.0)
    pivot = wp.vec3(place[0], place[1], 0.0)
    x = wp.dot(pivot, ahead)
    y = wp.dot(pivot, across)
    return _extents(program, obj, ahead, across, body_pos, body_quat) - wp.vec4(x, y, x, y)
