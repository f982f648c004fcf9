"""Does an object at its candidate pose keep its distance from all that stands already?

Two trees of boxes are descended together by all lanes of a world's thread block: a shared stack holds the box pairs
still to be looked at, every lane takes one, and what overlaps comes back as two smaller pairs. At the leaves stand
convex pieces (`geometry: physics`) or triangles (`geometry: visual`), with round primitives among them where a scene
shows any (`visual_round`). The answer is an "or" over leaves, so it depends
neither on how many lanes there are nor on which lane takes what.
"""

from typing import Any

import warp as wp

from sceniris_gym.geometry.colliders import PIECE_LEAF
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.layout.blocks import block_any
from sceniris_gym.layout.convex import Shape, least_extent, piece_shape, separated
from sceniris_gym.layout.transforms import Pose, apply, compose, pose_of, relative
from sceniris_gym.layout.triangles import triangles_separated
from sceniris_gym.program.device import Program

# Room for the box pairs of one world. A pass takes at most one pair a lane and leaves one more behind for each, so a
# block of n lanes needs about n times the depth of both trees; `generate.py` bounds n by that. Shared memory limits how
# many worlds are under way at once, so a few convex pieces get less than thousands of triangles.
NODE_CAPACITY = {"physics": 512, "visual": 1536, "visual_round": 1536}
# Leaf pairs wait until there is one for every lane, so that their long tests run side by side. There are always fewer
# than two a lane.
LEAF_CAPACITY = 256
# Distances are compared with the margin plus this [m]: above the rounding of float32 poses and vertices within a few
# metres, below the 10 um to which a rejection must be right.
SKIN = 5.0e-6

_SPACE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
_PIECE_LEAF = wp.constant(PIECE_LEAF)
_HULL = wp.constant(int(PieceType.HULL))


@wp.func
def boxes_separated(ca: wp.vec3, ha: wp.vec3, cb: wp.vec3, hb: wp.vec3, rel: Pose, margin: float) -> bool:
    """Is there a separating axis with a gap above `margin` between two boxes (centre, half extents)?

    Box b lies in the frame that `rel` places in a's. S. Gottschalk, M. Lin, D. Manocha, "OBBTree", SIGGRAPH 1996. The
    nine axes across edges are not normalised (their length is at most 1), which errs towards "not separated".
    """
    t = apply(rel, cb) - ca
    r = rel.rot
    f = wp.mat33(
        wp.abs(r[0, 0]), wp.abs(r[0, 1]), wp.abs(r[0, 2]),
        wp.abs(r[1, 0]), wp.abs(r[1, 1]), wp.abs(r[1, 2]),
        wp.abs(r[2, 0]), wp.abs(r[2, 1]), wp.abs(r[2, 2]),
    )  # fmt: skip
    ga = wp.vec3(wp.abs(t[0]), wp.abs(t[1]), wp.abs(t[2])) - ha - f * hb
    if wp.max(ga) > margin:
        return True
    tb = wp.transpose(r) * t
    gb = wp.vec3(wp.abs(tb[0]), wp.abs(tb[1]), wp.abs(tb[2])) - hb - wp.transpose(f) * ha
    if wp.max(gb) > margin:
        return True
    for i in range(3):
        i1 = (i + 1) % 3
        i2 = (i + 2) % 3
        for j in range(3):
            j1 = (j + 1) % 3
            j2 = (j + 2) % 3
            reach = ha[i1] * f[i2, j] + ha[i2] * f[i1, j] + hb[j1] * f[i, j2] + hb[j2] * f[i, j1]
            if wp.abs(t[i2] * r[i1, j] - t[i1] * r[i2, j]) - reach > margin:
                return True
    return False


@wp.func
def piece_pose(program: Program, piece: int) -> Pose:
    """A piece's frame in its body's."""
    return pose_of(program.piece_pos[piece], program.piece_quat[piece])


@wp.func
def lowest(program: Program, piece: int, in_body: wp.vec3) -> float:
    """Least extent of a convex piece along the direction `in_body`, both in the body's frame."""
    return least_extent(program.vert, piece_shape(program, piece), piece_pose(program, piece), in_body)


@wp.func
def physics_separated(program: Program, pair: int, a: int, b: int, rel: Pose, margin: float) -> bool:
    """Leaves of `geometry: physics`: two convex pieces.

    They are no deeper in each other than a negative margin allows if they are apart, or would be with b moved by so
    much in any direction. Those of the pair are tried.
    """
    piece = piece_pose(program, a)
    frame = relative(piece, compose(rel, piece_pose(program, b)))
    shape_a = piece_shape(program, a)
    shape_b = piece_shape(program, b)
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
def physics_over_plane(program: Program, a: int, plane: int, normal: wp.vec3, height: float, margin: float) -> bool:
    """Is the convex piece `a` more than `margin` over a plane (normal in a's body frame, body origin at `height`)?"""
    return height + lowest(program, a, normal) > margin


@wp.func
def physics_disjoint(program: Program, a: int, b: int, rel: Pose) -> bool:
    """Convex pieces need no test for containment of their own."""
    return True


@wp.func
def visual_separated(program: Program, pair: int, a: int, b: int, rel: Pose, margin: float) -> bool:
    """Leaves of `geometry: visual`: two triangles."""
    return triangles_separated(
        program.face_a[a],
        program.face_b[a],
        program.face_c[a],
        apply(rel, program.face_a[b]),
        apply(rel, program.face_b[b]),
        apply(rel, program.face_c[b]),
        margin,
    )


@wp.func
def visual_over_plane(program: Program, a: int, plane: int, normal: wp.vec3, height: float, margin: float) -> bool:
    """Is the triangle `a` more than `margin` over a plane (normal in a's body frame, body origin at `height`)?"""
    low = wp.min(
        wp.min(wp.dot(normal, program.face_a[a]), wp.dot(normal, program.face_b[a])), wp.dot(normal, program.face_c[a])
    )
    return height + low > margin


@wp.func
def _leaf_shape(program: Program, leaf: int) -> Shape:
    """A leaf of `visual_round`: a round piece, or a triangle as the hull of its corners."""
    s = Shape()
    if leaf >= _PIECE_LEAF:
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
    if leaf >= _PIECE_LEAF:
        p = piece_pose(program, leaf - _PIECE_LEAF)
    return p


@wp.func
def visual_round_separated(program: Program, pair: int, a: int, b: int, rel: Pose, margin: float) -> bool:
    """Leaves of `geometry: visual` in a scene that shows round primitives: triangles, or convex pieces."""
    if a < _PIECE_LEAF:
        if b < _PIECE_LEAF:
            return visual_separated(program, pair, a, b, rel, margin)
    frame = relative(_leaf_pose(program, a), compose(rel, _leaf_pose(program, b)))
    return separated(program.vert, _leaf_shape(program, a), _leaf_shape(program, b), frame, _SPACE, margin)


@wp.func
def visual_round_over_plane(
    program: Program, a: int, plane: int, normal: wp.vec3, height: float, margin: float
) -> bool:
    """The same over a plane."""
    if a < _PIECE_LEAF:
        return visual_over_plane(program, a, plane, normal, height, margin)
    return height + lowest(program, a - _PIECE_LEAF, normal) > margin


@wp.func
def _points_outside(program: Program, a: int, b: int, rel: Pose) -> bool:
    """Is no component of collider a inside the solid of b? `rel` is b in a's frame; surfaces are known not to meet."""
    root = program.collider_root[b]
    at = wp.transpose(rel.rot)
    for i in range(program.collider_pointnum[a]):
        p = at * (program.point[program.collider_pointadr[a] + i] - rel.pos)
        d = p - program.node_center[root]
        half = program.node_half[root]
        if wp.abs(d[0]) <= half[0] and wp.abs(d[1]) <= half[1] and wp.abs(d[2]) <= half[2]:
            query = wp.mesh_query_point_sign_winding_number(program.collider_mesh[b], p, 4.0 * wp.length(half))
            if query.result and query.sign < 0.0:
                return False
    return True


@wp.func
def visual_disjoint(program: Program, a: int, b: int, rel: Pose) -> bool:
    """Is neither collider inside the other?"""
    back = Pose()
    back.rot = wp.transpose(rel.rot)
    back.pos = -(back.rot * rel.pos)
    return _points_outside(program, a, b, rel) and _points_outside(program, b, a, back)


@wp.struct
class _OverPlane:
    """A plane seen from a body: its normal in the body's frame, and the height of the body's origin over it."""

    normal: wp.vec3
    height: float


@wp.func
def _over_plane(program: Program, pose: Pose, plane_pose: Pose, plane: int) -> _OverPlane:
    up = compose(plane_pose, piece_pose(program, plane))
    axis = wp.vec3(up.rot[0, 2], up.rot[1, 2], up.rot[2, 2])
    over = _OverPlane()
    over.normal = wp.transpose(pose.rot) * axis
    over.height = wp.dot(axis, pose.pos - up.pos)
    return over


@wp.func
def _margin(program: Program, pair: int, support_body: int) -> float:
    """The least distance [m] of a pair, negative for a depth; without clearance to the body that it stands on."""
    margin = program.pair_margin[pair]
    if program.collider_body[program.pair_b[pair]] == support_body:
        margin = program.pair_touch[pair]
    return margin + wp.static(SKIN)


@wp.struct
class _Step:
    """What a pair of boxes leads to: nothing, two smaller pairs, or a test of the leaves themselves."""

    inner: bool
    leaf: bool
    left: wp.vec3i
    right: wp.vec3i


@wp.func
def _descend(
    program: Program,
    entry: wp.vec3i,
    margin: float,
    body_pos: wp.array(dtype=wp.vec3),
    body_quat: wp.array(dtype=wp.vec4),
) -> _Step:
    """One step down both trees for an entry (pair, node of a, node of b)."""
    step = _Step()
    pair = entry[0]
    na = entry[1]
    nb = entry[2]
    a = program.pair_a[pair]
    b = program.pair_b[pair]
    body_a = program.collider_body[a]
    body_b = program.collider_body[b]
    pose_a = pose_of(body_pos[body_a], body_quat[body_a])
    pose_b = pose_of(body_pos[body_b], body_quat[body_b])
    center = program.node_center[na]
    half = program.node_half[na]
    child_a = program.node_child[na]
    child_b = program.node_child[nb]
    plane = program.collider_plane[b]
    half_b = program.node_half[nb]
    if plane >= 0:
        over = _over_plane(program, pose_a, pose_b, plane)
        n = over.normal
        reach = wp.abs(n[0]) * half[0] + wp.abs(n[1]) * half[1] + wp.abs(n[2]) * half[2]
        if over.height + wp.dot(n, center) - reach > margin:
            return step
    else:
        # Only leaves may be in each other: of boxes no depth is proven.
        apart = wp.max(margin, 0.0)
        if boxes_separated(center, half, program.node_center[nb], half_b, relative(pose_a, pose_b), apart):
            return step
    if child_a < 0 and child_b < 0:
        step.leaf = True
        return step
    step.inner = True
    if child_b < 0 or (child_a >= 0 and wp.max(half) > wp.max(half_b)):
        step.left = wp.vec3i(pair, child_a, nb)
        step.right = wp.vec3i(pair, child_a + 1, nb)
    else:
        step.left = wp.vec3i(pair, na, child_b)
        step.right = wp.vec3i(pair, na, child_b + 1)
    return step


def make_collides(leaf_separated: wp.Function, leaf_over_plane: wp.Function, disjoint: wp.Function) -> wp.Function:
    """The test of one object against its pairs, for one kind of leaves."""

    @wp.func
    def test_leaf(
        program: Program,
        entry: wp.vec3i,
        margin: float,
        body_pos: wp.array(dtype=wp.vec3),
        body_quat: wp.array(dtype=wp.vec4),
    ) -> int:
        a = program.pair_a[entry[0]]
        b = program.pair_b[entry[0]]
        body_a = program.collider_body[a]
        body_b = program.collider_body[b]
        pose_a = pose_of(body_pos[body_a], body_quat[body_a])
        pose_b = pose_of(body_pos[body_b], body_quat[body_b])
        leaf_a = ~program.node_child[entry[1]]
        plane = program.collider_plane[b]
        apart = bool(True)
        if plane >= 0:
            over = _over_plane(program, pose_a, pose_b, plane)
            apart = leaf_over_plane(program, leaf_a, plane, over.normal, over.height, margin)
        else:
            leaf_b = ~program.node_child[entry[2]]
            apart = leaf_separated(program, entry[0], leaf_a, leaf_b, relative(pose_a, pose_b), margin)
        return wp.where(apart, 0, 1)

    @wp.func
    def collides(
        program: Program,
        nodes: Any,
        leaves: Any,
        lane: int,
        obj: int,
        support_body: int,
        body_pos: wp.array(dtype=wp.vec3),
        body_quat: wp.array(dtype=wp.vec4),
    ) -> bool:
        start = program.obj_startnum[obj]
        for base in range(0, start, wp.block_dim()):
            entry = program.start[program.obj_startadr[obj] + wp.min(base + lane, start - 1)]
            wp.tile_stack_push(nodes, entry, base + lane < start)  # `compile_scene` has seen to it that all fit

        hit = int(0)
        while wp.tile_stack_count(nodes) + wp.tile_stack_count(leaves) > 0:
            if wp.tile_stack_count(leaves) >= wp.block_dim() or wp.tile_stack_count(nodes) == 0:
                entry, slot = wp.tile_stack_pop(leaves)
                if slot >= 0:
                    margin = _margin(program, entry[0], support_body)
                    hit = test_leaf(program, entry, margin, body_pos, body_quat)
            else:
                entry, slot = wp.tile_stack_pop(nodes)
                step = _Step()
                if slot >= 0:
                    margin = _margin(program, entry[0], support_body)
                    step = _descend(program, entry, margin, body_pos, body_quat)
                at_left = wp.tile_stack_push(nodes, step.left, step.inner)
                at_right = wp.tile_stack_push(nodes, step.right, step.inner)
                at_leaf = wp.tile_stack_push(leaves, entry, step.leaf)
                if (step.inner and (at_left < 0 or at_right < 0)) or (step.leaf and at_leaf < 0):
                    hit = 1  # no room left: unproven means not separated
            if block_any(hit) != 0:
                wp.tile_stack_clear(nodes)
                wp.tile_stack_clear(leaves)
                return True

        adr = program.obj_pairadr[obj]
        num = program.obj_pairnum[obj]
        inside = int(0)
        for base in range(0, num, wp.block_dim()):
            if base + lane < num:
                a = program.pair_a[adr + base + lane]
                b = program.pair_b[adr + base + lane]
                if program.collider_plane[b] < 0:
                    body_a = program.collider_body[a]
                    body_b = program.collider_body[b]
                    rel = relative(
                        pose_of(body_pos[body_a], body_quat[body_a]), pose_of(body_pos[body_b], body_quat[body_b])
                    )
                    if not disjoint(program, a, b, rel):
                        inside = 1
        return block_any(inside) != 0

    return collides


collides_physics = make_collides(physics_separated, physics_over_plane, physics_disjoint)
collides_visual = make_collides(visual_separated, visual_over_plane, visual_disjoint)
collides_visual_round = make_collides(visual_round_separated, visual_round_over_plane, visual_disjoint)

COLLIDES = {"physics": collides_physics, "visual": collides_visual, "visual_round": collides_visual_round}
"""The test of one object, by the kinds of leaves in a scene: see `CompiledScene.leaves`."""
