"""Leaves of box trees against each other: convex pieces, triangles, and planes.

With `geometry: physics` a leaf is a convex piece, with `geometry: visual` a triangle or a round piece. A candidate with
one pair of leaves that are not further apart than they have to be is rejected, so the order of the pairs cannot matter.
"""

import warp as wp

from sceniris_gym.geometry.colliders import PIECE_LEAF
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.layout.convex import Shape, least_extent, piece_shape, separated
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.search import Search
from sceniris_gym.layout.transforms import Pose, apply, compose, pose_of, relative
from sceniris_gym.layout.triangles import triangles_separated
from sceniris_gym.program.device import Cause, ObjectKind, Program

wp.set_module_options({"enable_backward": False})

# Distances are compared with the margin plus this [m]: above the rounding of float32 poses and vertices within a few
# metres, below the 10 um to which a rejection must be right.
SKIN = 5.0e-6

_SPACE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
_PIECE_LEAF = wp.constant(PIECE_LEAF)
_HULL = wp.constant(int(PieceType.HULL))
_NONE = wp.constant(int(Cause.NONE))
_COLLISION = wp.constant(int(Cause.COLLISION))
_STATIC = wp.constant(int(ObjectKind.STATIC))
_OWN_A = wp.constant(1)
_OWN_B = wp.constant(2)


@wp.struct
class PairPoses:
    """The bodies of a pair of colliders in the world."""

    a: Pose
    b: Pose


@wp.struct
class OverPlane:
    """A plane seen from a body: its normal in the body's frame, and the height of the body's origin over it."""

    normal: wp.vec3
    height: float


@wp.func
def pair_poses(
    program: Program,
    pair: int,
    own_pos: wp.array(dtype=wp.vec3),
    own_quat: wp.array(dtype=wp.vec4),
    body_pos: wp.array(dtype=wp.vec3),
    body_quat: wp.array(dtype=wp.vec4),
) -> PairPoses:
    """Where a pair's bodies are: those of what is tested as it is posed, all others as they stand."""
    own = program.pair_own[pair]
    a = program.collider_body[program.pair_a[pair]]
    b = program.collider_body[program.pair_b[pair]]
    p = PairPoses()
    if (own & _OWN_A) != 0:
        p.a = pose_of(own_pos[a], own_quat[a])
    else:
        p.a = pose_of(body_pos[a], body_quat[a])
    if (own & _OWN_B) != 0:
        p.b = pose_of(own_pos[b], own_quat[b])
    else:
        p.b = pose_of(body_pos[b], body_quat[b])
    return p


@wp.func
def candidate_poses(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, pair: int) -> PairPoses:
    """The same for a candidate of a row."""
    own_pos = search.body_pos[c]
    own_quat = search.body_quat[c]
    return pair_poses(program, pair, own_pos, own_quat, layouts.body_pos[row], layouts.body_quat[row])


@wp.func
def margin_of(program: Program, pair: int, support_body: int) -> float:
    """The least distance [m] of a pair, negative for a depth; without clearance to the body that it stands on."""
    margin = program.pair_margin[pair]
    if program.collider_body[program.pair_b[pair]] == support_body:
        margin = program.pair_touch[pair]
    return margin + wp.static(SKIN)


@wp.func
def support_of(program: Program, obj: int) -> int:
    """The body that an object stands on, to which its clearance does not apply; -1 for none."""
    if program.obj_kind[obj] == _STATIC:
        return -1
    return program.obj_ground[obj]


@wp.func
def piece_pose(program: Program, piece: int) -> Pose:
    """A piece's frame in its body's."""
    return pose_of(program.piece_pos[piece], program.piece_quat[piece])


@wp.func
def lowest(program: Program, piece: int, in_body: wp.vec3) -> float:
    """Least extent of a convex piece along the direction `in_body`, both in the body's frame."""
    return least_extent(program.vert, piece_shape(program, piece), piece_pose(program, piece), in_body)


@wp.func
def over_plane(program: Program, pose: Pose, plane_pose: Pose, plane: int) -> OverPlane:
    """A plane seen from a body, both bodies posed in the world."""
    up = compose(plane_pose, piece_pose(program, plane))
    axis = wp.vec3(up.rot[0, 2], up.rot[1, 2], up.rot[2, 2])
    over = OverPlane()
    over.normal = wp.transpose(pose.rot) * axis
    over.height = wp.dot(axis, pose.pos - up.pos)
    return over


@wp.func
def _leaf_shape(program: Program, leaf: int) -> Shape:
    """The shape of a leaf: that of a piece, or of a triangle as the hull of its corners."""
    s = Shape()
    if program.faces == 0:
        s = piece_shape(program, leaf)
    elif leaf >= _PIECE_LEAF:
        s = piece_shape(program, leaf - _PIECE_LEAF)
    else:
        s.kind = _HULL
        s.size = wp.vec3(0.0)
        s.vertadr = program.face_vertadr + 3 * leaf
        s.vertnum = int(3)
        s.radius = float(0.0)
    return s


@wp.func
def _leaf_pose(program: Program, leaf: int) -> Pose:
    """Its frame in its body's."""
    p = Pose()
    p.pos = wp.vec3(0.0)
    p.rot = wp.identity(n=3, dtype=float)
    if program.faces == 0:
        p = piece_pose(program, leaf)
    elif leaf >= _PIECE_LEAF:
        p = piece_pose(program, leaf - _PIECE_LEAF)
    return p


@wp.func
def _separated(program: Program, pair: int, a: int, b: int, rel: Pose, margin: float) -> bool:
    """Are two leaves further apart than `margin` [m]? `rel` is b's body in a's frame.

    They are no deeper in each other than a negative margin allows if they are apart, or would be with b moved by so
    much in any direction. Those of the pair are tried.
    """
    if program.faces != 0 and a < _PIECE_LEAF and b < _PIECE_LEAF:
        return triangles_separated(
            program.face_a[a],
            program.face_b[a],
            program.face_c[a],
            apply(rel, program.face_a[b]),
            apply(rel, program.face_b[b]),
            apply(rel, program.face_c[b]),
            margin,
        )
    piece = _leaf_pose(program, a)
    frame = relative(piece, compose(rel, _leaf_pose(program, b)))
    shape_a = _leaf_shape(program, a)
    shape_b = _leaf_shape(program, b)
    if margin >= 0.0:
        return separated(program.vert, shape_a, shape_b, frame, _SPACE, margin)
    here = frame.pos
    num = program.pair_waynum[pair]
    for i in range(1 + num):
        if i > 0:
            way = program.way[program.pair_wayadr[pair] + i - 1]
            if 2 * i > num:
                way = rel.rot * way
            frame.pos = here - margin * (wp.transpose(piece.rot) * way)
        if separated(program.vert, shape_a, shape_b, frame, _SPACE, 0.0):
            return True
    return False


@wp.func
def _lowest_of_leaf(program: Program, leaf: int, in_body: wp.vec3) -> float:
    """Least extent [m] of a leaf along a direction, both in the body's frame."""
    if program.faces != 0 and leaf < _PIECE_LEAF:
        return wp.min(
            wp.min(wp.dot(in_body, program.face_a[leaf]), wp.dot(in_body, program.face_b[leaf])),
            wp.dot(in_body, program.face_c[leaf]),
        )
    piece = leaf
    if program.faces != 0:
        piece = leaf - _PIECE_LEAF
    return lowest(program, piece, in_body)


@wp.func
def leaves_touch(program: Program, entry: wp.vec3i, poses: PairPoses, margin: float) -> bool:
    """Are the leaves of an entry (pair, node of a, node of b) no further apart than `margin` [m]?"""
    a = ~program.node_child[entry[1]]
    plane = program.collider_plane[program.pair_b[entry[0]]]
    if plane >= 0:
        over = over_plane(program, poses.a, poses.b, plane)
        return over.height + _lowest_of_leaf(program, a, over.normal) <= margin
    return not _separated(program, entry[0], a, ~program.node_child[entry[2]], relative(poses.a, poses.b), margin)


# With all the registers that it would take, a multiprocessor holds few warps, and each waits for its own arithmetic.
@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _test_leaves(
    program: Program,
    lanes: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    for i in range(wp.tid(), wp.min(search.leaves[0], search.leaf.shape[0]), lanes):
        c = search.leaf[i][0]
        entry = wp.vec3i(search.leaf[i][1], search.leaf[i][2], search.leaf[i][3])
        if search.cause[c] == _NONE:
            row = search.row[c]
            poses = candidate_poses(program, layouts, search, c, row, entry[0])
            margin = margin_of(program, entry[0], support_of(program, search.obj[c]))
            if leaves_touch(program, entry, poses, margin):
                search.cause[c] = _COLLISION


def launch_test_leaves(program: Program, lanes: int, layouts: LayoutsView, search: Search, device: str) -> None:
    """Test the pairs of leaves that wait."""
    wp.launch(_test_leaves, dim=lanes, inputs=[program, lanes, layouts], outputs=[search], device=device)
