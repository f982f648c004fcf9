"""`on`, `inside`, `in`: test if an overhead obstacle covers a point of a support."""

import warp as wp

from sceniris_gym.collide.convex import piece_shape, segment_shape, separated
from sceniris_gym.collide.leaves import piece_origin, piece_pose
from sceniris_gym.device.transforms import Pose, compose, pose_of, relative
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Program

_SPACE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
# Obstacles count up to this height [m] above a point. The ray begins a little above the surface, since surfaces of one
# height but of two geoms may differ by rounding.
_OVERHEAD_REACH = wp.constant(5.0)
_OVERHEAD_START = wp.constant(1.0e-4)
# Rounding [m] of a radius and of the distances that it is compared with.
_ROUNDING = wp.constant(1.0e-5)


@wp.func
def _upward(point: wp.vec3) -> Pose:
    """Return a frame whose x axis points up, centred on the segment over `point` in which obstacles count."""
    middle = point + wp.vec3(0.0, 0.0, _OVERHEAD_START + 0.5 * _OVERHEAD_REACH)
    return Pose(middle, wp.mat33(0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0))


@wp.func
def _crosses_box(half: wp.vec3, rel: Pose) -> bool:
    """Test whether that segment crosses a box with pose `rel` in the segment's frame, slab by slab."""
    start = -(wp.transpose(rel.rot) * rel.pos)
    low = float(-0.5 * _OVERHEAD_REACH)
    high = float(0.5 * _OVERHEAD_REACH)
    for i in range(3):
        along = rel.rot[0, i]
        if wp.abs(along) < 1.0e-9:
            if wp.abs(start[i]) > half[i]:
                return False
        else:
            a = (-half[i] - start[i]) / along
            b = (half[i] - start[i]) / along
            low = wp.max(low, wp.min(a, b))
            high = wp.min(high, wp.max(a, b))
    return low <= high


@wp.func
def _is_under_piece(
    program: Program, piece: int, point: wp.vec3, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> bool:
    """Test whether a convex piece lies above `point` (world frame)."""
    beside = piece_origin(program, piece, body_pos, body_quat) - point
    if wp.length(wp.vec2(beside[0], beside[1])) > program.piece_radius[piece] + _ROUNDING:  # most are
        return False
    body = program.piece_body[piece]
    frame = compose(pose_of(body_pos[body], body_quat[body]), piece_pose(program, piece))
    rel = relative(_upward(point), frame)
    if program.piece_type[piece] == PieceType.BOX:
        return _crosses_box(program.piece_size[piece], rel)
    return not separated(
        program.vert, segment_shape(0.5 * _OVERHEAD_REACH), piece_shape(program, piece), rel, _SPACE, 0.0
    )


@wp.func
def _is_under_faces(
    program: Program,
    collider: int,
    point: wp.vec3,
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> bool:
    """Test whether a triangle of a collider lies above `point` (world frame)."""
    body = program.collider_body[collider]
    frame = pose_of(body_pos[body], body_quat[body])
    back = wp.transpose(frame.rot)
    start = back * (point + wp.vec3(0.0, 0.0, _OVERHEAD_START) - frame.pos)
    return wp.mesh_query_ray(
        program.collider_mesh[collider], start, back * wp.vec3(0.0, 0.0, 1.0), _OVERHEAD_REACH
    ).result


@wp.func
def is_covered(
    program: Program, entry: int, point: wp.vec3, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> bool:
    """Test whether an entry of `overhead_list` lies above `point` (world frame).

    Entries are convex pieces, or with `geometry: visual` colliders.
    """
    if program.visual:
        return _is_under_faces(program, entry, point, body_pos, body_quat)
    return _is_under_piece(program, entry, point, body_pos, body_quat)
