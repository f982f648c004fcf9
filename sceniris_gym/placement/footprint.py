"""Tests for `on`, `inside`, `in` and `ratio_on_support`: covered points, and footprints that extend beyond a support.

The footprint of a posed object is its shadow, seen from above. An obstacle covers a point if it lies above this point.
"""

import warp as wp

from sceniris_gym.collide.convex import least_extent, piece_shape, segment_shape, separated
from sceniris_gym.collide.leaves import piece_origin, piece_pose
from sceniris_gym.device.transforms import Pose, compose, pose_of, relative
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Program

_SPACE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
_SHADOW = wp.constant(wp.vec3(1.0, 1.0, 0.0))
# A footprint may extend beyond the edge of its support by this length [m], the tolerance of the separation test.
_RIM = wp.constant(-1.0e-6)
# An obstacle covers a point only up to this height [m] above the point.
_OVERHEAD_REACH = wp.constant(5.0)
# Height [m] of the ray's origin above the point, because rounding may separate level surfaces of two geoms.
_OVERHEAD_START = wp.constant(1.0e-4)
# Rounding error [m] of a radius and of the distances that are compared with the radius.
_ROUNDING = wp.constant(1.0e-5)


@wp.func
def inside_outline(program: Program, surface: int, p: wp.vec2) -> bool:
    """Test whether point `p` [m] lies inside the outline of a surface and outside its holes.

    `p` is in the frame of the body that has the surface. The test counts the edges that a ray from `p` along x crosses.
    """
    inside = bool(False)
    for i in range(program.surface_edgenum[surface]):
        a = program.edge_a[program.surface_edgeadr[surface] + i]
        b = program.edge_b[program.surface_edgeadr[surface] + i]
        if (a[1] > p[1]) != (b[1] > p[1]) and p[0] < a[0] + (b[0] - a[0]) * (p[1] - a[1]) / (b[1] - a[1]):
            inside = not inside
    return inside


@wp.func
def outline_distance(program: Program, surface: int, p: wp.vec2) -> float:
    """Return the distance [m] from point `p` to the nearest edge of a surface's outline or of a hole in the surface.

    `p` is in the frame of the body that has the surface.
    """
    least = float(1.0e30)
    for i in range(program.surface_edgenum[surface]):
        a = program.edge_a[program.surface_edgeadr[surface] + i]
        along = program.edge_b[program.surface_edgeadr[surface] + i] - a
        share = wp.clamp(wp.dot(p - a, along) / wp.dot(along, along), 0.0, 1.0)
        least = wp.min(least, wp.length(p - a - share * along))
    return least


@wp.func
def shadow_on_edge(program: Program, piece: int, edge: int, rel: Pose) -> bool:
    """Test whether an edge of an outline passes through the shadow of a convex piece, seen from above.

    `rel` is the pose of the piece in the outline's frame, whose z axis points up. A convex shadow lies in an outline if
    one point of the shadow does and no edge of the outline passes through the shadow.
    """
    a = program.edge_a[edge]
    b = program.edge_b[edge]
    along = b - a
    length = wp.length(along)
    c = along[0] / length
    s = along[1] / length
    middle = wp.vec3(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.0)
    seen = relative(Pose(middle, wp.mat33(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)), rel)
    beside = wp.max(wp.abs(seen.pos[0]) - 0.5 * length, 0.0)
    if wp.length(wp.vec2(beside, seen.pos[1])) > program.piece_radius[piece]:
        return False
    return not separated(program.vert, segment_shape(0.5 * length), piece_shape(program, piece), seen, _SHADOW, _RIM)


@wp.func
def _inward(program: Program, edge: int, winding: int) -> wp.vec3:
    """Return the unit normal of an edge of a convex outline. It points to the inside of the outline.

    `winding` is 1 if the corners of the outline are counter-clockwise, and -1 if they are clockwise.
    """
    along = wp.normalize(program.edge_b[edge] - program.edge_a[edge])
    return float(winding) * wp.vec3(-along[1], along[0], 0.0)


@wp.func
def _lies_inside(program: Program, edge: int, winding: int, at: wp.vec3, radius: float) -> bool:
    """Test whether a sphere lies entirely on the inner side of an edge of a convex outline.

    `at` is the sphere's centre in the outline's frame [m]. `winding` is 1 if the corners of the outline are
    counter-clockwise, and -1 if they are clockwise.
    """
    a = program.edge_a[edge]
    inward = _inward(program, edge, winding)
    return wp.dot(inward, at) - inward[0] * a[0] - inward[1] * a[1] > radius + _ROUNDING


@wp.func
def _extends_beyond(program: Program, piece: int, edge: int, winding: int, rel: Pose) -> bool:
    """Test whether a piece with pose `rel` in the outline's frame extends beyond an edge of a convex outline.

    `winding` is 1 if the corners of the outline are counter-clockwise, and -1 if they are clockwise.
    """
    a = program.edge_a[edge]
    inward = _inward(program, edge, winding)
    least = least_extent(program.vert, piece_shape(program, piece), rel, inward)
    return least < inward[0] * a[0] + inward[1] * a[1] + _RIM


@wp.func
def overhangs(
    program: Program,
    obj: int,
    surface: int,
    index: int,
    ground: Pose,
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> bool:
    """Test whether one convex piece of an object extends beyond one edge of a surface, seen from above.

    `index` numbers the pairs of a piece and an edge: first all edges with the first piece, then all edges with the
    second piece, and so on. `ground` is the world pose of the body that has the surface. The object's footprint lies on
    the surface if no pair of a piece and an edge overhangs.
    """
    sides = program.surface_edgenum[surface]
    piece = program.shadow_list[program.obj_shadowadr[obj] + index // sides]
    body = program.piece_body[piece]
    edge = program.surface_edgeadr[surface] + index % sides
    winding = program.surface_winding[surface]
    if winding != 0:
        at = wp.transpose(ground.rot) * (piece_origin(program, piece, body_pos, body_quat) - ground.pos)
        if _lies_inside(program, edge, winding, at, program.piece_radius[piece]):  # most pieces end here
            return False
    rel = relative(ground, compose(pose_of(body_pos[body], body_quat[body]), piece_pose(program, piece)))
    if winding != 0:
        return _extends_beyond(program, piece, edge, winding, rel)
    if shadow_on_edge(program, piece, edge, rel):
        return True
    return index % sides == 0 and not inside_outline(program, surface, wp.vec2(rel.pos[0], rel.pos[1]))


@wp.func
def _upward(point: wp.vec3) -> Pose:
    """Return the frame of the vertical segment above `point` that is tested for obstacles.

    The frame's origin is the middle of the segment, and its x axis points up.
    """
    middle = point + wp.vec3(0.0, 0.0, _OVERHEAD_START + 0.5 * _OVERHEAD_REACH)
    return Pose(middle, wp.mat33(0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0))


@wp.func
def _crosses_box(half: wp.vec3, rel: Pose) -> bool:
    """Test whether the vertical segment above a point crosses a box.

    `half` has the box's half extents [m]. `_upward` returns a frame for the segment, and `rel` is the box's pose in it.
    """
    origin = -(wp.transpose(rel.rot) * rel.pos)
    low = float(-0.5 * _OVERHEAD_REACH)
    high = float(0.5 * _OVERHEAD_REACH)
    for i in range(3):
        along = rel.rot[0, i]
        if wp.abs(along) < 1.0e-9:
            if wp.abs(origin[i]) > half[i]:
                return False
        else:
            a = (-half[i] - origin[i]) / along
            b = (half[i] - origin[i]) / along
            low = wp.max(low, wp.min(a, b))
            high = wp.min(high, wp.max(a, b))
    return low <= high


@wp.func
def _is_under_piece(
    program: Program, piece: int, point: wp.vec3, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> bool:
    """Test whether a convex piece lies vertically above `point` (world frame)."""
    beside = piece_origin(program, piece, body_pos, body_quat) - point
    if wp.length(wp.vec2(beside[0], beside[1])) > program.piece_radius[piece] + _ROUNDING:  # most pieces end here
        return False
    body = program.piece_body[piece]
    frame = compose(pose_of(body_pos[body], body_quat[body]), piece_pose(program, piece))
    rel = relative(_upward(point), frame)
    if program.piece_type[piece] == PieceType.BOX:
        return _crosses_box(program.piece_size[piece], rel)
    segment = segment_shape(0.5 * _OVERHEAD_REACH)
    return not separated(program.vert, segment, piece_shape(program, piece), rel, _SPACE, 0.0)


@wp.func
def _is_under_faces(
    program: Program, collider: int, point: wp.vec3, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> bool:
    """Test whether a triangle of a collider lies vertically above `point` (world frame)."""
    body = program.collider_body[collider]
    frame = pose_of(body_pos[body], body_quat[body])
    back = wp.transpose(frame.rot)
    origin = back * (point + wp.vec3(0.0, 0.0, _OVERHEAD_START) - frame.pos)
    up = back * wp.vec3(0.0, 0.0, 1.0)
    return wp.mesh_query_ray(program.collider_mesh[collider], origin, up, _OVERHEAD_REACH).result


@wp.func
def is_covered(
    program: Program, entry: int, point: wp.vec3, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> bool:
    """Test whether an obstacle lies vertically above `point` (world frame).

    `entry` is the obstacle's entry of `overhead_list`: the number of a convex piece with `geometry: physics`, or of a
    collider with `geometry: visual`.
    """
    if program.visual:
        return _is_under_faces(program, entry, point, body_pos, body_quat)
    return _is_under_piece(program, entry, point, body_pos, body_quat)
