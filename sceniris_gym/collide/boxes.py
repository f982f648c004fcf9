"""Tests of two colliders: the descent of their trees of bounding boxes, and containment.

An *entry* is a pair of colliders with one node from the box tree of each: (pair, node of a, node of b). If the boxes of
the two nodes are near each other, two entries with child nodes replace the entry. An entry of two leaves goes to the
narrow phase. The lanes of a block share a stack of entries, and each lane takes one entry at a time.

Containment tests whether one collider lies inside the other even if their surfaces do not intersect. Each closed
component of a collider has one test point. The winding number of the other collider's mesh around this point decides
whether the point is inside.
"""

from typing import Any

import warp as wp

from sceniris_gym.collide.box_pairs import absolute, gap_across_edges, gap_at_faces
from sceniris_gym.collide.leaves import PairPoses, inner_boxes_touch, leaves_touch, margin_of, over_plane, pair_poses
from sceniris_gym.device.blocks import block_any
from sceniris_gym.device.transforms import Pose, apply, relative
from sceniris_gym.program.device import Cause, Program

SHARED_STACK = 512
"""Capacity of the stack of entries that a block shares. It has room for an entry per lane and level of both trees."""
OWN_STACK = 64
"""Capacity of the stack of a single lane: one entry per level of both trees. Trees halve at each level."""
NARROW_STACK = 64
"""Capacity of the stack of narrow-phase pairs, for up to 32 lanes.

Pairs wait until each lane has one, so the stack holds fewer than two pairs per lane.
"""
UNPROVEN = -1
"""Sentinel in place of a cause: a stack was too small to complete the test."""


@wp.func
def boxes_separated(ca: wp.vec3, ha: wp.vec3, cb: wp.vec3, hb: wp.vec3, rel: Pose, margin: float) -> bool:
    """Test whether two boxes (centre, half extents [m]) have a separating axis with a gap above `margin` [m].

    Box b is given in a frame whose pose in a's frame is `rel`. The axes are from S. Gottschalk, M. Lin, D. Manocha,
    "OBBTree", SIGGRAPH 1996. The nine cross products of edges are not normalised. Their length is at most 1, so gaps
    along them are never overestimated, and the test can only err towards "not separated".
    """
    t = apply(rel, cb) - ca
    r = rel.rot
    f = absolute(r)
    # written out: a function for both boxes makes layouts of `clutter` 1% slower
    if gap_at_faces(ha, hb, t, f) > margin:
        return True
    if gap_at_faces(hb, ha, wp.transpose(r) * t, wp.transpose(f)) > margin:
        return True
    for i in range(3):
        for j in range(3):
            if gap_across_edges(ha, hb, t, r, f, i, j) > margin:
                return True
    return False


@wp.func
def _nodes_separated(program: Program, pair: int, na: int, nb: int, poses: PairPoses, margin: float) -> bool:
    """Test whether the boxes of node `na` of collider a and node `nb` of collider b are more than `margin` [m] apart.

    If collider b is a plane, the box of `na` is compared with this plane.
    """
    center = program.node_center[na]
    half = program.node_half[na]
    plane = program.pair_bodies[pair][3]
    if plane >= 0:
        over = over_plane(program, poses.a, poses.b, plane)
        n = over.normal
        reach = wp.abs(n[0]) * half[0] + wp.abs(n[1]) * half[1] + wp.abs(n[2]) * half[2]
        return over.height + wp.dot(n, center) - reach > margin
    # a negative margin only applies to leaves, because boxes cannot prove a depth
    least = wp.max(margin, 0.0)
    return boxes_separated(center, half, program.node_center[nb], program.node_half[nb], poses.rel, least)


@wp.struct
class Step:
    """The result of `next_step` for one entry (pair, node of a, node of b) of the tree descent.

    If `inner` is True, the entries `left` and `right` with child nodes replace the entry. If `leaf` is True, both nodes
    are leaves, and the narrow phase tests them. If both are False, the boxes of the two nodes are apart, and the entry
    is dropped.
    """

    inner: bool
    leaf: bool
    left: wp.vec3i
    right: wp.vec3i


@wp.func
def next_step(program: Program, entry: wp.vec3i, poses: PairPoses, margin: float) -> Step:
    """Test whether the boxes of an entry (pair, node of a, node of b) are near each other, and return the next step."""
    step = Step()  # pyrefly: ignore[missing-argument]
    pair = entry[0]
    na = entry[1]
    nb = entry[2]
    if _nodes_separated(program, pair, na, nb, poses, margin):
        return step
    child_a = program.node_child[na]
    child_b = program.node_child[nb]
    if child_a < 0 and child_b < 0:
        step.leaf = True
        return step
    step.inner = True
    # open the larger box, whose halves are more likely to be apart from the other box
    if child_b < 0 or (child_a >= 0 and wp.max(program.node_half[na]) > wp.max(program.node_half[nb])):
        step.left = wp.vec3i(pair, child_a, nb)
        step.right = wp.vec3i(pair, child_a + 1, nb)
    else:
        step.left = wp.vec3i(pair, na, child_b)
        step.right = wp.vec3i(pair, na, child_b + 1)
    return step


@wp.func
def leaves_below_touch(
    program: Program, first: wp.vec3i, poses: PairPoses, margin: float, stack: wp.array[wp.vec3i]
) -> bool:
    """Test whether any leaf below node a of an entry and any leaf below its node b are at most `margin` [m] apart.

    A single lane makes the whole descent. `stack` has room for `OWN_STACK` entries, and no other lane uses it.
    """
    stack[0] = first
    count = int(1)
    while count > 0:
        count -= 1
        entry = stack[count]
        step = next_step(program, entry, poses, margin)
        if step.leaf:
            if inner_boxes_touch(program, entry, poses, margin) or leaves_touch(program, entry, poses, margin):
                return True
        elif step.inner:
            stack[count] = step.left
            stack[count + 1] = step.right
            count += 2
    return False


@wp.func
def collides(
    program: Program,
    startadr: int,
    startnum: int,
    worldid: int,
    support: int,
    nodes: Any,
    leaves: Any,
    lane: int,
    own_pos: wp.array[wp.vec3],
    own_quat: wp.array[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> int:
    """Test a list of broad-phase pairs for collisions. Return COLLISION, NONE, or UNPROVEN if a stack was too small.

    The list has `startnum` pairs from index `startadr`. All lanes of a block call this function together, and share the
    stacks `nodes` and `leaves`, which are empty at the start. `own_pos` and `own_quat` are the world poses of the
    tested bodies. All other bodies have the poses `body_pos` and `body_quat`. `support` is the body that carries the
    tested bodies, or -1: the clearance does not apply to this body. Margins may differ between worlds, but the margins
    of an arm do not. For an arm, `worldid` may therefore be any world.
    """
    base = int(startadr)
    last = base + startnum
    hit = int(0)
    missed = int(0)
    while base < last or wp.tile_stack_count(nodes) + wp.tile_stack_count(leaves) > 0:
        if wp.tile_stack_count(nodes) == 0 and base < last:
            wp.tile_stack_push(nodes, program.broad_pair[wp.min(base + lane, last - 1)], base + lane < last)
            base += wp.block_dim()
        elif wp.tile_stack_count(leaves) >= wp.block_dim() or wp.tile_stack_count(nodes) == 0:
            entry, slot = wp.tile_stack_pop(leaves)
            if slot >= 0:
                poses = pair_poses(program, entry[0], own_pos, own_quat, body_pos, body_quat)
                if leaves_touch(program, entry, poses, margin_of(program, worldid, entry[0], support)):
                    hit = 1
            if block_any(hit) != 0:
                hit = 1
                base = last
                wp.tile_stack_clear(nodes)
                wp.tile_stack_clear(leaves)
        else:
            entry, slot = wp.tile_stack_pop(nodes)
            step = Step()  # pyrefly: ignore[missing-argument]
            if slot >= 0:
                poses = pair_poses(program, entry[0], own_pos, own_quat, body_pos, body_quat)
                step = next_step(program, entry, poses, margin_of(program, worldid, entry[0], support))
            at_left = wp.tile_stack_push(nodes, step.left, step.inner)
            at_right = wp.tile_stack_push(nodes, step.right, step.inner)
            at_leaf = wp.tile_stack_push(leaves, entry, step.leaf)
            if step.inner and wp.min(at_left, at_right) < 0:
                missed = 1
            if step.leaf and at_leaf < 0:
                missed = 1
    if hit != 0:
        return Cause.COLLISION
    return wp.where(block_any(missed) != 0, UNPROVEN, Cause.NONE)


@wp.func
def collides_without_stack(
    program: Program,
    startadr: int,
    startnum: int,
    lane: int,
    own_pos: wp.array[wp.vec3],
    own_quat: wp.array[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> bool:
    """Test broad-phase pairs of an arm for a collision after `collides` has returned UNPROVEN.

    The arguments are as in `collides`. Each lane has a separate stack, which is always large enough.
    """
    hit = int(0)
    stack = wp.zeros(shape=(wp.static(OWN_STACK),), dtype=wp.vec3i)
    for i in range(startadr + lane, startadr + startnum, wp.block_dim()):
        entry = program.broad_pair[i]
        poses = pair_poses(program, entry[0], own_pos, own_quat, body_pos, body_quat)
        if leaves_below_touch(program, entry, poses, margin_of(program, 0, entry[0], -1), stack):
            hit = 1
            break
    return block_any(hit) != 0


@wp.func
def in_solid(program: Program, collider: int, p: wp.vec3) -> bool:
    """Test whether point `p` lies in the volume that the mesh of a collider encloses.

    `p` is in the frame of the collider's body.
    """
    mesh = program.collider_mesh[collider]
    query = wp.mesh_query_point_sign_winding_number(mesh, p, program.collider_depth[collider])
    return query.result and query.sign < 0.0


@wp.func
def in_bounds(program: Program, collider: int, p: wp.vec3) -> bool:
    """Test whether point `p` lies inside the bounding box of a collider. `p` is in the frame of the collider's body."""
    root = program.collider_root[collider]
    d = p - program.node_center[root]
    half = program.node_half[root]
    return wp.abs(d[0]) <= half[0] and wp.abs(d[1]) <= half[1] and wp.abs(d[2]) <= half[2]


@wp.func
def _has_points_inside(program: Program, a: int, b: int, rel: Pose) -> bool:
    """Test whether a closed component of collider a lies inside collider b. Each component has one test point.

    `rel` is the pose of b's body in the frame of a's body.
    """
    at = wp.transpose(rel.rot)
    for i in range(program.collider_pointnum[a]):
        p = at * (program.point[program.collider_pointadr[a] + i] - rel.pos)
        if in_bounds(program, b, p):
            if in_solid(program, b, p):
                return True
    return False


@wp.func
def is_one_inside(program: Program, pair: int, poses: PairPoses) -> bool:
    """Test whether one collider of a pair lies inside the other. If one of them is a plane, the result is False."""
    a = program.pair_a[pair]
    b = program.pair_b[pair]
    if program.collider_plane[b] >= 0:
        return False
    if _has_points_inside(program, a, b, relative(poses.a, poses.b)):
        return True
    return _has_points_inside(program, b, a, relative(poses.b, poses.a))


@wp.func
def encloses(
    program: Program,
    pairadr: int,
    pairnum: int,
    lane: int,
    own_pos: wp.array[wp.vec3],
    own_quat: wp.array[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> bool:
    """Test whether, in any pair of a list, one collider lies inside the other.

    The list has `pairnum` pairs from index `pairadr`. All lanes of a block call this function together. `own_pos` and
    `own_quat` are the world poses of the tested bodies. All other bodies have the poses `body_pos` and `body_quat`.
    """
    inside = int(0)
    for pair in range(pairadr + lane, pairadr + pairnum, wp.block_dim()):
        if is_one_inside(program, pair, pair_poses(program, pair, own_pos, own_quat, body_pos, body_quat)):
            inside = 1
            break
    return block_any(inside) != 0
