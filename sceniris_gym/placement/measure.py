"""Pivots and bounds: measure the lowest point of a posed object, and its bounds as relations see them."""

import warp as wp

from sceniris_gym.collide.leaves import lowest
from sceniris_gym.device.angles import unit_circle
from sceniris_gym.device.transforms import quat_mat
from sceniris_gym.placement.kinematics import pose_bodies
from sceniris_gym.placement.orientations import DrawnVariant
from sceniris_gym.program.device import Measure, OrientationType, Program


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
    whole = program.obj_measured[obj] == Measure.WHOLE
    low = wp.vec3(1.0e30)
    high = wp.vec3(1.0e30)  # negated: the least coordinate along the opposite direction
    for i in range(program.obj_piecenum[obj]):
        piece = program.piece_list[program.obj_pieceadr[obj] + i]
        body = program.piece_body[piece]
        back = wp.transpose(quat_mat(body_quat[body]))
        low[2] = wp.min(low[2], body_pos[body][2] + lowest(program, piece, back * wp.vec3(0.0, 0.0, 1.0)))
        if whole:
            for axis in range(2):
                along = back * wp.vec3(float(1 - axis), float(axis), 0.0)
                at = body_pos[body][axis]
                low[axis] = wp.min(low[axis], at + lowest(program, piece, along))
                high[axis] = wp.min(high[axis], lowest(program, piece, -along) - at)
    bottom = quat_mat(drawn.quat) * drawn.pivot
    if whole:
        for axis in range(2):
            high[axis] = -high[axis]
            if program.obj_orientation[obj] == OrientationType.ANY:
                bottom[axis] = 0.5 * (low[axis] + high[axis])
        drawn.bounds = wp.vec4(low[0] - bottom[0], low[1] - bottom[1], high[0] - bottom[0], high[1] - bottom[1])
    bottom[2] = low[2]
    drawn.pivot = wp.transpose(quat_mat(drawn.quat)) * bottom
    return drawn


@wp.func
def _extent(
    program: Program,
    obj: int,
    axis: wp.vec3,
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> wp.vec2:
    """Return the least and greatest coordinate [m] of a posed object along a unit vector of the world."""
    low = float(1.0e30)
    high = float(1.0e30)  # negated
    for i in range(program.obj_piecenum[obj]):
        piece = program.piece_list[program.obj_pieceadr[obj] + i]
        body = program.piece_body[piece]
        along = wp.transpose(quat_mat(body_quat[body])) * axis
        at = wp.dot(body_pos[body], axis)
        low = wp.min(low, at + lowest(program, piece, along))
        high = wp.min(high, lowest(program, piece, -along) - at)
    return wp.vec2(low, -high)


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
    x = _extent(program, obj, ahead, body_pos, body_quat)
    y = _extent(program, obj, across, body_pos, body_quat)
    px = wp.dot(pivot, ahead)
    py = wp.dot(pivot, across)
    return wp.vec4(x[0] - px, y[0] - py, x[1] - px, y[1] - py)
