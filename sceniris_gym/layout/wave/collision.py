"""Collision test of a wave's candidates against the objects already placed in their rows.

With `geometry: physics`, the lanes of a block traverse the bounding-volume trees of a candidate, and queue close leaves
as narrow-phase pairs. One lane then tests each pair. With `geometry: visual`, close leaves usually collide, so a block
tests its candidate completely and stops at the first hit. If the queue or a block's stack overflows, a single lane
repeats the candidate's test. A surface may also enclose another surface without intersecting it, which a second test
finds.
"""

import warp as wp

from sceniris_gym.collide.boxes import (
    NARROW_STACK,
    OWN_STACK,
    SHARED_STACK,
    UNPROVEN,
    Step,
    collides,
    is_one_inside,
    leaves_below_touch,
    next_step,
)
from sceniris_gym.collide.leaves import inner_boxes_touch, margin_of, pieces_touch, support_of
from sceniris_gym.device.blocks import block_sync
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.posing import candidate_poses
from sceniris_gym.layout.wave.prefilter import reject_cause
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num, narrow_pair_num
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach

_OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(_OPTIONS)

# Narrow-phase pairs are spread over up to this number of blocks before a block takes more than one pair.
_SPREAD = wp.constant(1024)


@wp.func
def may_collide(cause: int) -> bool:
    """Return True if a candidate with this cause has to be tested for collision.

    The test for standing may run at the same time. If a candidate falls and collides, COLLISION is its cause.
    """
    return cause == Cause.NONE or cause == Cause.FALLS


@wp.func
def _passes_prefilter(program: Program, reach: Reach, search: Search, c: int, lane: int) -> bool:
    """Return True if a candidate passes the prefilter. Otherwise, write the cause of its rejection and return False.

    All lanes of a block call this together.
    """
    cause = search.cause[c]
    block_sync()  # every lane reads the cause before lane 0 writes it
    if cause == Cause.NONE:
        cause = reject_cause(program, reach, search, c, search.obj[c])
        if lane == 0 and cause != Cause.NONE:
            search.cause[c] = cause
    return may_collide(cause)


@wp.func
def _mark_overflow(search: Search, c: int):
    """Mark a candidate whose narrow-phase pairs overflowed a stack or the queue."""
    search.overflowed[c] = 1
    search.any_overflowed[0] = 1


@wp.func
def _margin(program: Program, search: Search, c: int, pair: int) -> float:
    """Return the least allowed distance [m] of a candidate's pair."""
    return margin_of(program, search.row_world[search.row[c]], pair, support_of(program, search.obj[c]))


@wp.func
def collides_alone(program: Program, layouts: LayoutsView, search: Search, c: int) -> bool:
    """Return True if a candidate collides. A single lane calls this."""
    row = search.row[c]
    obj = search.obj[c]
    support = support_of(program, obj)
    stack = wp.zeros(shape=(wp.static(OWN_STACK),), dtype=wp.vec3i)
    for s in range(program.obj_broadadr[obj], program.obj_broadadr[obj] + program.obj_broadnum[obj]):
        first = program.broad_pair[s]
        poses = candidate_poses(program, layouts, search, c, row, first[0])
        margin = margin_of(program, search.row_world[row], first[0], support)
        if leaves_below_touch(program, first, poses, margin, stack):
            return True
    return False


@wp.kernel(module="unique", module_options=_OPTIONS, grid_stride=False)
def _queue_narrow_pairs(
    blocks: int,
    program: Program,
    reach: Reach,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: row_world, candidates, row, obj, grasp, flags*, body_pos, body_quat; out: any_overflowed, overflowed,
    #   narrow_pair; both: narrow_pairs, cause
    search: Search,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    for c in range(block, candidate_num(search), blocks):
        if not _passes_prefilter(program, reach, search, c, lane):
            continue
        row = search.row[c]
        obj = search.obj[c]
        worldid = search.row_world[row]
        support = support_of(program, obj)
        last = program.obj_broadadr[obj] + program.obj_broadnum[obj]
        for base in range(program.obj_broadadr[obj], last, wp.block_dim()):
            wp.tile_stack_push(nodes, program.broad_pair[wp.min(base + lane, last - 1)], base + lane < last)
            while wp.tile_stack_count(nodes) > 0:
                entry, slot = wp.tile_stack_pop(nodes)
                step = Step()  # pyrefly: ignore[missing-argument]
                if slot >= 0:
                    poses = candidate_poses(program, layouts, search, c, row, entry[0])
                    step = next_step(program, entry, poses, margin_of(program, worldid, entry[0], support))
                at_left = wp.tile_stack_push(nodes, step.left, step.inner)
                at_right = wp.tile_stack_push(nodes, step.right, step.inner)
                if step.inner and wp.min(at_left, at_right) < 0:
                    _mark_overflow(search, c)
                if step.leaf:
                    at = wp.atomic_add(search.narrow_pairs, 0, 1)
                    if at >= 0 and at < search.narrow_pair.shape[0]:  # the count may overflow
                        search.narrow_pair[at] = wp.vec4i(c, entry[0], entry[1], entry[2])
                    else:
                        _mark_overflow(search, c)


# With unlimited registers, a multiprocessor holds too few warps to hide the latency of the arithmetic.
@wp.kernel(module="unique", module_options=_OPTIONS, grid_stride=False, cuda_max_registers=128)
def _test_narrow_pairs(
    blocks: int,
    program: Program,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: row_world, narrow_pairs, row, obj, body_pos, body_quat, narrow_pair; both: cause
    search: Search,
):
    block, lane = wp.tid()
    num = narrow_pair_num(search)
    # Lanes of a block wait for each other, so a small number of pairs is spread over several blocks per multiprocessor.
    most = wp.clamp(num // _SPREAD + 1, 1, wp.min(wp.block_dim(), NARROW_STACK))
    # Most pairs belong to candidates that are already known to collide. The others wait until every lane has a pair.
    waiting = wp.tile_stack(capacity=wp.static(NARROW_STACK), dtype=int)
    base = int(block * most)
    while base < num or wp.tile_stack_count(waiting) > 0:
        if base < num and wp.tile_stack_count(waiting) < wp.min(wp.block_dim(), NARROW_STACK - most + 1):
            i = wp.min(base + lane, num - 1)
            c = search.narrow_pair[i][0]
            wp.tile_stack_push(waiting, i, lane < wp.min(most, num - base) and may_collide(search.cause[c]))
            base += blocks * most
        else:
            i, slot = wp.tile_stack_pop(waiting)
            if slot >= 0:
                c = search.narrow_pair[i][0]
                entry = wp.vec3i(search.narrow_pair[i][1], search.narrow_pair[i][2], search.narrow_pair[i][3])
                poses = candidate_poses(program, layouts, search, c, search.row[c], entry[0])
                if pieces_touch(program, entry, poses, _margin(program, search, c, entry[0])):
                    search.cause[c] = Cause.COLLISION


@wp.kernel(module="unique", module_options=_OPTIONS, grid_stride=False, cuda_max_registers=128)
def _test_by_block(
    blocks: int,
    program: Program,
    reach: Reach,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: row_world, candidates, row, obj, grasp, flags*, body_pos, body_quat; out: any_overflowed, overflowed;
    #   both: cause
    search: Search,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(NARROW_STACK), dtype=wp.vec3i)
    for c in range(block, candidate_num(search), blocks):
        if _passes_prefilter(program, reach, search, c, lane):
            row = search.row[c]
            obj = search.obj[c]
            adr = program.obj_broadadr[obj]
            num = program.obj_broadnum[obj]
            support = support_of(program, obj)
            own_pos = search.body_pos[c]
            own_quat = search.body_quat[c]
            pos = layouts.body_pos[row]
            quat = layouts.body_quat[row]
            worldid = search.row_world[row]
            found = collides(program, adr, num, worldid, support, nodes, leaves, lane, own_pos, own_quat, pos, quat)
            if lane == 0 and found == Cause.COLLISION:
                search.cause[c] = Cause.COLLISION
            if lane == 0 and found == UNPROVEN:
                _mark_overflow(search, c)


# First, inner boxes prove most collisions of queued pairs. Then lanes test the candidates whose pairs overflowed.
@wp.kernel(module="unique", module_options=_OPTIONS, grid_stride=False, cuda_max_registers=128)
def _test_alone(
    lanes: int,
    program: Program,
    reach: Reach,
    queued: bool,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: row_world, candidates, narrow_pairs, any_overflowed, row, obj, grasp, overflowed, flags*, body_pos,
    #   body_quat, narrow_pair; both: cause
    search: Search,
):
    for i in range(wp.tid(), narrow_pair_num(search), lanes):
        c = search.narrow_pair[i][0]
        entry = wp.vec3i(search.narrow_pair[i][1], search.narrow_pair[i][2], search.narrow_pair[i][3])
        if may_collide(search.cause[c]):
            poses = candidate_poses(program, layouts, search, c, search.row[c], entry[0])
            if inner_boxes_touch(program, entry, poses, _margin(program, search, c, entry[0])):
                search.cause[c] = Cause.COLLISION
    if queued and search.any_overflowed[0] == 0:
        return
    for c in range(wp.tid(), candidate_num(search), lanes):
        if not queued and search.cause[c] == Cause.NONE:
            search.cause[c] = reject_cause(program, reach, search, c, search.obj[c])
        if may_collide(search.cause[c]) and (not queued or search.overflowed[c] != 0):
            if collides_alone(program, layouts, search, c):
                search.cause[c] = Cause.COLLISION


def launch_test_collisions(work: Workspace) -> None:
    """Test the candidates that pass the prefilter for collision, and for containment with `geometry: visual`."""
    program, reach, shared, state = work.program, work.reaches[0], work.size.block_dim > 1, [work.layouts, work.search]
    if shared and program.visual:
        work.launch_blocks(_test_by_block, program, reach, *state)
        # few candidates overflow, and each lane of this kernel needs many registers
        work.launch(_test_alone, work.size.blocks, work.size.blocks, program, reach, True, *state)
    elif shared:
        work.launch_blocks(_queue_narrow_pairs, program, reach, *state)
        work.launch_lanes(_test_alone, program, reach, True, *state)
        work.launch_blocks(_test_narrow_pairs, program, *state)
    else:
        work.launch_lanes(_test_alone, program, reach, False, *state)
    if program.visual:
        launch_test_containment(work)


@wp.kernel(module="unique", module_options=_OPTIONS, grid_stride=False)
def _test_containment(
    lanes: int,
    program: Program,
    parts: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: candidates, row, obj, body_pos, body_quat; both: cause
    search: Search,
):
    for i in range(wp.tid(), parts * candidate_num(search), lanes):
        c = i // parts
        adr = program.obj_pairadr[search.obj[c]]
        for pair in range(adr + i % parts, adr + program.obj_pairnum[search.obj[c]], parts):
            if may_collide(search.cause[c]):
                if is_one_inside(program, pair, candidate_poses(program, layouts, search, c, search.row[c], pair)):
                    search.cause[c] = Cause.COLLISION  # all lanes write the same value


def launch_test_containment(work: Workspace) -> None:
    """Reject candidates that enclose a placed object or lie inside one. Only for `geometry: visual`."""
    work.launch_lanes(_test_containment, work.program, work.size.parts, work.layouts, work.search)
