"""Candidates of a wave are tested for collision with what stands in their row.

With `geometry: physics` the lanes of a block go down the trees of a candidate, and leaves that come near each other
wait in a queue for lanes of their own. With `geometry: visual`, where most leaves near each other mean a hit soon, a
block tests its candidate as a whole. What finds no room is tested by one lane.
"""

import warp as wp

from sceniris_gym.collide.boxes import (
    OWN_STACK,
    SHARED_STACK,
    UNPROVEN,
    WAITING,
    Step,
    collides,
    leaves_below_touch,
    next_step,
)
from sceniris_gym.collide.leaves import inner_boxes_touch, margin_of, pieces_touch, support_of
from sceniris_gym.device.blocks import block_sync
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.posing import candidate_poses
from sceniris_gym.layout.wave.prefilter import reject_cause
from sceniris_gym.layout.wave.search import Search, SearchSize, candidate_num, narrow_pair_num
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False})


@wp.func
def _passes_prefilter(program: Program, reach: Reach, search: Search, c: int, lane: int) -> bool:
    """Does a candidate pass the screen? If not, the cause is kept. All lanes of a block call it together."""
    cause = search.cause[c]
    block_sync()  # all lanes have read it
    if cause == Cause.NONE:
        cause = reject_cause(program, reach, search, c, search.obj[c])
        if lane == 0 and cause != Cause.NONE:
            search.cause[c] = cause
    return cause == Cause.NONE


@wp.func
def _miss(search: Search, c: int):
    """Write down that there was no room for all of a candidate's test."""
    search.missed[c] = 1
    search.unproven[0] = 1


@wp.kernel(module="unique", enable_backward=False, grid_stride=False)
def _queue_narrow_pairs(
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
        if not _passes_prefilter(program, reach, search, c, lane):
            continue
        row = search.row[c]
        obj = search.obj[c]
        support = support_of(program, obj)
        last = program.obj_broadadr[obj] + program.obj_broadnum[obj]
        for base in range(program.obj_broadadr[obj], last, wp.block_dim()):
            wp.tile_stack_push(nodes, program.broad_pair[wp.min(base + lane, last - 1)], base + lane < last)
            while wp.tile_stack_count(nodes) > 0:
                entry, slot = wp.tile_stack_pop(nodes)
                step = Step()
                if slot >= 0:
                    poses = candidate_poses(program, layouts, search, c, row, entry[0])
                    step = next_step(program, entry, poses, margin_of(program, entry[0], support))
                at_left = wp.tile_stack_push(nodes, step.left, step.inner)
                at_right = wp.tile_stack_push(nodes, step.right, step.inner)
                if step.inner and wp.min(at_left, at_right) < 0:
                    _miss(search, c)
                if step.leaf:
                    at = wp.atomic_add(search.narrow_pairs, 0, 1)
                    if at >= 0 and at < search.narrow_pair.shape[0]:  # the count may go on beyond all numbers
                        search.narrow_pair[at] = wp.vec4i(c, entry[0], entry[1], entry[2])
                    else:
                        _miss(search, c)


@wp.kernel(module="unique", enable_backward=False, grid_stride=False)
def _test_inner_boxes(
    program: Program,
    lanes: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    for i in range(wp.tid(), narrow_pair_num(search), lanes):
        c = search.narrow_pair[i][0]
        entry = wp.vec3i(search.narrow_pair[i][1], search.narrow_pair[i][2], search.narrow_pair[i][3])
        if search.cause[c] == Cause.NONE:
            poses = candidate_poses(program, layouts, search, c, search.row[c], entry[0])
            if inner_boxes_touch(
                program, entry, poses, margin_of(program, entry[0], support_of(program, search.obj[c]))
            ):
                search.cause[c] = Cause.COLLISION


# With all the registers that it would take, a multiprocessor holds few warps, and each waits for its own arithmetic.
@wp.kernel(module="unique", enable_backward=False, grid_stride=False, cuda_max_registers=128)
def _test_narrow_pairs(
    program: Program,
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    block, lane = wp.tid()
    num = narrow_pair_num(search)
    # Most leaves are of candidates that collide for certain by now: the others wait until there is one for every lane.
    waiting = wp.tile_stack(capacity=wp.static(WAITING), dtype=int)
    base = int(block * wp.block_dim())
    while base < num or wp.tile_stack_count(waiting) > 0:
        if base < num and wp.tile_stack_count(waiting) < wp.block_dim():
            i = wp.min(base + lane, num - 1)
            c = search.narrow_pair[i][0]
            undecided = base + lane < num and search.cause[c] == Cause.NONE
            if wp.tile_stack_push(waiting, i, undecided) < 0 and undecided:
                _miss(search, c)
            base += blocks * wp.block_dim()
        else:
            i, slot = wp.tile_stack_pop(waiting)
            if slot >= 0:
                c = search.narrow_pair[i][0]
                entry = wp.vec3i(search.narrow_pair[i][1], search.narrow_pair[i][2], search.narrow_pair[i][3])
                poses = candidate_poses(program, layouts, search, c, search.row[c], entry[0])
                if pieces_touch(
                    program, entry, poses, margin_of(program, entry[0], support_of(program, search.obj[c]))
                ):
                    search.cause[c] = Cause.COLLISION


@wp.kernel(module="unique", enable_backward=False, grid_stride=False, cuda_max_registers=128)
def _test_by_block(
    program: Program,
    reach: Reach,
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(WAITING), dtype=wp.vec3i)
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
            found = collides(program, adr, num, support, nodes, leaves, lane, own_pos, own_quat, pos, quat)
            if lane == 0 and found == Cause.COLLISION:
                search.cause[c] = Cause.COLLISION
            if lane == 0 and found == UNPROVEN:
                _miss(search, c)


@wp.func
def _collides_alone(program: Program, layouts: LayoutsView, search: Search, c: int) -> bool:
    """Does a candidate collide? One lane's work."""
    row = search.row[c]
    obj = search.obj[c]
    support = support_of(program, obj)
    stack = wp.zeros(shape=(wp.static(OWN_STACK),), dtype=wp.vec3i)
    for s in range(program.obj_broadadr[obj], program.obj_broadadr[obj] + program.obj_broadnum[obj]):
        start = program.broad_pair[s]
        poses = candidate_poses(program, layouts, search, c, row, start[0])
        if leaves_below_touch(program, start, poses, margin_of(program, start[0], support), stack):
            return True
    return False


@wp.kernel(module="unique", enable_backward=False, grid_stride=False)
def _test_alone(
    program: Program,
    reach: Reach,
    lanes: int,
    missed: bool,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    if missed and search.unproven[0] == 0:
        return
    for c in range(wp.tid(), candidate_num(search), lanes):
        if not missed and search.cause[c] == Cause.NONE:
            search.cause[c] = reject_cause(program, reach, search, c, search.obj[c])
        if search.cause[c] == Cause.NONE and (not missed or search.missed[c] != 0):
            if _collides_alone(program, layouts, search, c):
                search.cause[c] = Cause.COLLISION


def lane_kernels(visual: bool, block_dim: int) -> tuple[wp.Kernel, ...]:
    """Return the kernels that are launched by lanes."""
    return (_test_inner_boxes, _test_alone) if block_dim > 1 and not visual else (_test_alone,)


def block_kernels(visual: bool, block_dim: int) -> tuple[wp.Kernel, ...]:
    """Return the kernels that are launched by blocks."""
    if block_dim == 1:
        return ()
    return (_test_by_block,) if visual else (_queue_narrow_pairs, _test_narrow_pairs)


def launch_test_collisions(
    program: Program, reach: Reach, size: SearchSize, visual: bool, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Test the candidates that pass the prefilter."""
    lanes = {"dim": size.lanes, "device": device}
    blocks = {"dim": [size.blocks], "block_dim": size.block_dim, "device": device}
    if size.block_dim > 1 and visual:
        wp.launch_tiled(_test_by_block, inputs=[program, reach, size.blocks, layouts, search], **blocks)
    elif size.block_dim > 1:
        wp.launch_tiled(_queue_narrow_pairs, inputs=[program, reach, size.blocks, layouts, search], **blocks)
        wp.launch(_test_inner_boxes, inputs=[program, size.lanes, layouts, search], **lanes)
        wp.launch_tiled(_test_narrow_pairs, inputs=[program, size.blocks, layouts, search], **blocks)
    wp.launch(_test_alone, inputs=[program, reach, size.lanes, size.block_dim > 1, layouts, search], **lanes)
