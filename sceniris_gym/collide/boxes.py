"""Trees of boxes against each other: one step down both of them, and the whole test of a list of pairs.

What overlaps comes back as two smaller pairs of boxes, until leaves are left. The lanes of a block share a stack of
such pairs, and every lane takes one.
"""

from typing import Any

import warp as wp

from sceniris_gym.collide.axes import absolute, gap_across_edges, gap_at_faces
from sceniris_gym.collide.leaves import (
    PairPoses,
    inner_boxes_touch,
    leaves_touch,
    margin_of,
    over_plane,
    pair_poses,
)
from sceniris_gym.device.blocks import block_any
from sceniris_gym.device.transforms import Pose, apply
from sceniris_gym.program.device import Cause, Program

wp.set_module_options({"enable_backward": False})

SHARED_STACK = 512
"""Room for the pairs of nodes that a block's lanes leave behind: one for each lane and level of both trees."""
OWN_STACK = 64
"""Room for those that a lane by itself leaves behind: one for each level of both trees, which are halved at each."""
WAITING = 64
"""Room for pairs of leaves that wait until there is one for every lane: fewer than two a lane, for up to 32 lanes."""
UNPROVEN = -1
"""In place of a cause: there was no room for all of a test."""


@wp.func
def boxes_separated(ca: wp.vec3, ha: wp.vec3, cb: wp.vec3, hb: wp.vec3, rel: Pose, margin: float) -> bool:
    """Is there a separating axis with a gap above `margin` between two boxes (centre, half extents)?

    Box b lies in the frame that `rel` places in a's. S. Gottschalk, M. Lin, D. Manocha, "OBBTree", SIGGRAPH 1996. The
    nine axes across edges are not normalised (their length is at most 1), which errs towards "not separated".
    """
    t = apply(rel, cb) - ca
    r = rel.rot
    f = absolute(r)
    if gap_at_faces(ha, hb, t, f) > margin:
        return True
    tb = wp.transpose(r) * t
    if gap_at_faces(hb, ha, tb, wp.transpose(f)) > margin:
        return True
    for i in range(3):
        for j in range(3):
            if gap_across_edges(ha, hb, t, r, f, i, j) > margin:
                return True
    return False


@wp.func
def _nodes_separated(program: Program, pair: int, na: int, nb: int, poses: PairPoses, margin: float) -> bool:
    """Are the boxes of two nodes of a pair further apart than `margin` [m]?"""
    center = program.node_center[na]
    half = program.node_half[na]
    plane = program.pair_bodies[pair][3]
    if plane >= 0:
        over = over_plane(program, poses.a, poses.b, plane)
        n = over.normal
        reach = wp.abs(n[0]) * half[0] + wp.abs(n[1]) * half[1] + wp.abs(n[2]) * half[2]
        return over.height + wp.dot(n, center) - reach > margin
    # only leaves may be in each other: of boxes no depth is proven
    least = wp.max(margin, 0.0)
    return boxes_separated(center, half, program.node_center[nb], program.node_half[nb], poses.rel, least)


@wp.struct
class Step:
    """What a pair of nodes leads to: nothing, two smaller pairs, or a test of the leaves themselves."""

    inner: bool
    leaf: bool
    left: wp.vec3i
    right: wp.vec3i


@wp.func
def next_step(program: Program, entry: wp.vec3i, poses: PairPoses, margin: float) -> Step:
    """One step down both trees from an entry (pair, node of a, node of b)."""
    step = Step()
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
    if child_b < 0 or (child_a >= 0 and wp.max(program.node_half[na]) > wp.max(program.node_half[nb])):
        step.left = wp.vec3i(pair, child_a, nb)
        step.right = wp.vec3i(pair, child_a + 1, nb)
    else:
        step.left = wp.vec3i(pair, na, child_b)
        step.right = wp.vec3i(pair, na, child_b + 1)
    return step


@wp.func
def leaves_below_touch(
    program: Program, start: wp.vec3i, poses: PairPoses, margin: float, stack: wp.array[wp.vec3i]
) -> bool:
    """Are any leaves below an entry (pair, node of a, node of b) too near? One lane's work, with a stack of its own."""
    stack[0] = start
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
    support: int,
    nodes: Any,
    leaves: Any,
    lane: int,
    own_pos: wp.array[wp.vec3],
    own_quat: wp.array[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> int:
    """Is any pair of a list too near, leaves and all: COLLISION, NONE, or UNPROVEN where a stack had no room for all?

    All lanes of a block call it together, with empty stacks. `own_pos` and `own_quat` pose what is tested, `body_pos`
    and `body_quat` all others; `support` is the body that it stands on, or -1.
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
                if leaves_touch(program, entry, poses, margin_of(program, entry[0], support)):
                    hit = 1
            if block_any(hit) != 0:
                hit = 1
                base = last
                wp.tile_stack_clear(nodes)
                wp.tile_stack_clear(leaves)
        else:
            entry, slot = wp.tile_stack_pop(nodes)
            step = Step()
            if slot >= 0:
                poses = pair_poses(program, entry[0], own_pos, own_quat, body_pos, body_quat)
                step = next_step(program, entry, poses, margin_of(program, entry[0], support))
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
    support: int,
    lane: int,
    own_pos: wp.array[wp.vec3],
    own_quat: wp.array[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> bool:
    """The same where the shared stacks had no room: every lane goes down both trees by itself."""
    hit = int(0)
    stack = wp.zeros(shape=(wp.static(OWN_STACK),), dtype=wp.vec3i)
    for i in range(startadr + lane, startadr + startnum, wp.block_dim()):
        entry = program.broad_pair[i]
        poses = pair_poses(program, entry[0], own_pos, own_quat, body_pos, body_quat)
        if leaves_below_touch(program, entry, poses, margin_of(program, entry[0], support), stack):
            hit = 1
            break
    return block_any(hit) != 0
