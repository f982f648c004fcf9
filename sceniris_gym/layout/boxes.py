"""Trees of boxes against each other: which leaves of a candidate come near what stands already?

The lanes of a block share a candidate: a stack holds the pairs of nodes still to be looked at, every lane takes one,
and what overlaps comes back as two smaller pairs. Leaves that come near each other wait in a queue for lanes of their
own. Candidates for which it has no room, and those of triangles, where most leaves near each other mean a hit soon,
are tested as a whole instead.
"""

from typing import Any

import warp as wp

from sceniris_gym.layout.blocks import block_any, block_sync
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.leaves import (
    PairPoses,
    candidate_poses,
    launch_test_leaves,
    leaves_touch,
    margin_of,
    over_plane,
    pair_poses,
    support_of,
)
from sceniris_gym.layout.screen import why_not
from sceniris_gym.layout.search import UNPROVEN, Search, SearchSize, candidate_num
from sceniris_gym.layout.transforms import Pose, apply, relative
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False})

SHARED_STACK = 512
"""Room for the pairs of nodes that a block's lanes leave behind: one for each lane and level of both trees."""
OWN_STACK = 64
"""Room for those that a lane by itself leaves behind: one for each level of both trees, which are halved at each."""
WAITING = 64
"""Room for pairs of leaves that wait until there is one for every lane; there are fewer than two a lane."""
_OWN_STACK = wp.constant(OWN_STACK)
_NONE = wp.constant(int(Cause.NONE))
_COLLISION = wp.constant(int(Cause.COLLISION))
_UNPROVEN = wp.constant(UNPROVEN)


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
def _nodes_separated(program: Program, pair: int, na: int, nb: int, poses: PairPoses, margin: float) -> bool:
    """Are the boxes of two nodes of a pair further apart than `margin` [m]?"""
    center = program.node_center[na]
    half = program.node_half[na]
    plane = program.collider_plane[program.pair_b[pair]]
    if plane >= 0:
        over = over_plane(program, poses.a, poses.b, plane)
        n = over.normal
        reach = wp.abs(n[0]) * half[0] + wp.abs(n[1]) * half[1] + wp.abs(n[2]) * half[2]
        return over.height + wp.dot(n, center) - reach > margin
    rel = relative(poses.a, poses.b)
    # only leaves may be in each other: of boxes no depth is proven
    return boxes_separated(center, half, program.node_center[nb], program.node_half[nb], rel, wp.max(margin, 0.0))


@wp.struct
class _Step:
    """What a pair of nodes leads to: nothing, two smaller pairs, or a test of the leaves themselves."""

    inner: bool
    leaf: bool
    left: wp.vec3i
    right: wp.vec3i


@wp.func
def _step(program: Program, entry: wp.vec3i, poses: PairPoses, margin: float) -> _Step:
    """One step down both trees from an entry (pair, node of a, node of b)."""
    step = _Step()
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
def _passes_screen(program: Program, reach: Reach, search: Search, c: int, lane: int) -> bool:
    """Does a candidate pass the screen? If not, the cause is kept. All lanes of a block call it together."""
    cause = search.cause[c]
    block_sync()  # all lanes have read it
    if cause == _NONE:
        cause = why_not(program, reach, search, c, search.obj[c])
        if lane == 0 and cause != _NONE:
            search.cause[c] = cause
    return cause == _NONE


@wp.kernel(grid_stride=False)
def _queue_leaves(
    program: Program,
    reach: Reach,
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    for c in range(block, candidate_num(search), blocks):
        if not _passes_screen(program, reach, search, c, lane):
            continue
        row = search.row[c]
        tests = search.obj[c]
        support = support_of(program, tests)
        last = program.obj_startadr[tests] + program.obj_startnum[tests]
        for base in range(program.obj_startadr[tests], last, wp.block_dim()):
            wp.tile_stack_push(nodes, program.start[wp.min(base + lane, last - 1)], base + lane < last)
            while wp.tile_stack_count(nodes) > 0:
                entry, slot = wp.tile_stack_pop(nodes)
                step = _Step()
                if slot >= 0:
                    poses = candidate_poses(program, layouts, search, c, row, entry[0])
                    step = _step(program, entry, poses, margin_of(program, entry[0], support))
                at_left = wp.tile_stack_push(nodes, step.left, step.inner)
                at_right = wp.tile_stack_push(nodes, step.right, step.inner)
                if step.inner and wp.min(at_left, at_right) < 0:
                    search.cause[c] = _UNPROVEN
                    search.unproven[0] = 1
                if step.leaf:
                    at = wp.atomic_add(search.leaves, 0, 1)
                    if at < search.leaf.shape[0]:
                        search.leaf[at] = wp.vec4i(c, entry[0], entry[1], entry[2])
                    else:
                        search.cause[c] = _UNPROVEN
                        search.unproven[0] = 1


@wp.func
def _leaves_below_touch(program: Program, start: wp.vec3i, poses: PairPoses, margin: float) -> bool:
    """Are any leaves below an entry (pair, node of a, node of b) too near? A lane goes down both trees by itself."""
    stack = wp.zeros(shape=(_OWN_STACK,), dtype=wp.vec3i)
    stack[0] = start
    count = int(1)
    while count > 0:
        count -= 1
        entry = stack[count]
        step = _step(program, entry, poses, margin)
        if step.leaf:
            if leaves_touch(program, entry, poses, margin):
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
    own_pos: wp.array(dtype=wp.vec3),
    own_quat: wp.array(dtype=wp.vec4),
    body_pos: wp.array(dtype=wp.vec3),
    body_quat: wp.array(dtype=wp.vec4),
) -> bool:
    """Is any pair of a list too near, leaves and all? All lanes of a block call it together, with empty stacks.

    `own_pos` and `own_quat` pose what is tested, `body_pos` and `body_quat` all others; `support` is the body that it
    stands on, or -1.
    """
    base = int(startadr)
    last = base + startnum
    hit = int(0)
    while base < last or wp.tile_stack_count(nodes) + wp.tile_stack_count(leaves) > 0:
        if wp.tile_stack_count(nodes) == 0 and base < last:
            wp.tile_stack_push(nodes, program.start[wp.min(base + lane, last - 1)], base + lane < last)
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
            step = _Step()
            if slot >= 0:
                poses = pair_poses(program, entry[0], own_pos, own_quat, body_pos, body_quat)
                step = _step(program, entry, poses, margin_of(program, entry[0], support))
            at_left = wp.tile_stack_push(nodes, step.left, step.inner)
            at_right = wp.tile_stack_push(nodes, step.right, step.inner)
            wp.tile_stack_push(leaves, entry, step.leaf)
            if step.inner and wp.min(at_left, at_right) < 0:  # no room: this lane sees to it by itself
                poses = pair_poses(program, entry[0], own_pos, own_quat, body_pos, body_quat)
                if _leaves_below_touch(program, entry, poses, margin_of(program, entry[0], support)):
                    hit = 1
    return block_any(hit) != 0


@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _test_together(
    program: Program,
    reach: Reach,
    blocks: int,
    unproven: bool,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(WAITING), dtype=wp.vec3i)
    if unproven and search.unproven[0] == 0:
        return
    for c in range(block, candidate_num(search), blocks):
        wanted = bool(False)
        if unproven:
            wanted = search.cause[c] == _UNPROVEN
            block_sync()  # all lanes have read it
        else:
            wanted = _passes_screen(program, reach, search, c, lane)
        if wanted:
            row = search.row[c]
            obj = search.obj[c]
            adr = program.obj_startadr[obj]
            num = program.obj_startnum[obj]
            support = support_of(program, obj)
            own_pos = search.body_pos[c]
            own_quat = search.body_quat[c]
            pos = layouts.body_pos[row]
            quat = layouts.body_quat[row]
            hit = collides(program, adr, num, support, nodes, leaves, lane, own_pos, own_quat, pos, quat)
            if lane == 0:
                search.cause[c] = wp.where(hit, _COLLISION, _NONE)


@wp.kernel
def _test_alone(
    program: Program,
    reach: Reach,
    lanes: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    for c in range(wp.tid(), candidate_num(search), lanes):
        row = search.row[c]
        tests = search.obj[c]
        if search.cause[c] == _NONE:
            search.cause[c] = why_not(program, reach, search, c, tests)
        if search.cause[c] == _NONE:
            for s in range(program.obj_startadr[tests], program.obj_startadr[tests] + program.obj_startnum[tests]):
                start = program.start[s]
                poses = candidate_poses(program, layouts, search, c, row, start[0])
                margin = margin_of(program, start[0], support_of(program, tests))
                if _leaves_below_touch(program, start, poses, margin):
                    search.cause[c] = _COLLISION
                    break


def launch_test_boxes(
    program: Program, reach: Reach, size: SearchSize, faces: bool, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Test the candidates that pass the screen against all that stands."""
    if size.block_dim == 1:
        inputs = [program, reach, size.lanes, layouts, search]
        wp.launch(_test_alone, dim=size.lanes, inputs=inputs, device=device)
        return
    blocks = {"dim": [size.blocks], "block_dim": size.block_dim, "device": device}
    if not faces:
        wp.launch_tiled(_queue_leaves, inputs=[program, reach, size.blocks, layouts, search], **blocks)
        launch_test_leaves(program, size.lanes, layouts, search, device)
    wp.launch_tiled(_test_together, inputs=[program, reach, size.blocks, not faces, layouts, search], **blocks)
