"""Candidates of a wave are tested for collision: against what stands in their row, and against their rivals.

With `geometry: physics` the lanes of a block go down the trees of a candidate, and leaves that come near each other
wait in a queue for lanes of their own. A candidate for which it has no room is tested by one lane as a whole. With
`geometry: visual`, where most leaves near each other mean a hit soon, a block tests its candidate as a whole.
"""

import warp as wp

from sceniris_gym.layout.blocks import block_sync
from sceniris_gym.layout.boxes import (
    SHARED_STACK,
    WAITING,
    Step,
    against,
    collides,
    leaves_below_touch,
    next_step,
)
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.leaves import candidate_poses, margin_of, pieces_touch, support_of
from sceniris_gym.layout.screen import why_not
from sceniris_gym.layout.search import UNPROVEN, QueuedLeaves, Search, SearchSize, candidate_num, rival_num
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False})

_NONE = wp.constant(int(Cause.NONE))
_COLLISION = wp.constant(int(Cause.COLLISION))
_UNPROVEN = wp.constant(UNPROVEN)


@wp.func
def _standing_num(program: Program, search: Search, row: int, obj: int) -> int:
    """With how many starts the test of a row's object begins against what stands: they come first."""
    return program.obj_startbefore[obj, search.row_object[row]]


@wp.func
def _start(program: Program, search: Search, c: int, row: int, obj: int, index: int) -> wp.vec4i:
    """What a candidate's test begins with: an entry against what stands, or a rival; its pair is -1 if it is void."""
    adr = program.obj_startadr[obj]
    standing = _standing_num(program, search, row, obj)
    if index < standing:
        return against(program.start[adr + index], -1)
    most = program.obj_startmost[obj]
    rival = search.row_first[row] + (index - standing) // most
    other = search.obj[rival]
    at = program.obj_startbefore[obj, other] + (index - standing) % most
    if at >= program.obj_startbefore[obj, other + 1]:
        return wp.vec4i(-1)
    return against(program.start[adr + at], rival)


@wp.func
def _start_num(program: Program, search: Search, c: int, row: int, obj: int) -> int:
    """How many of them there are."""
    return _standing_num(program, search, row, obj) + rival_num(search, row, c) * program.obj_startmost[obj]


@wp.func
def _is_open(search: Search, c: int, rival: int) -> bool:
    """May a candidate, and the rival if there is one, still be placed?"""
    cause = search.cause[c]
    if cause == _NONE and rival >= 0:
        cause = search.cause[rival]
    return cause == _NONE


@wp.func
def _keep_hit(search: Search, c: int, row: int, rival: int):
    """Write down that a candidate collides, with a rival or with what stands."""
    if rival < 0:
        search.cause[c] = _COLLISION
    else:
        wp.atomic_or(search.conflicts, c, wp.uint64(1) << wp.uint64(rival - search.row_first[row]))


@wp.func
def _is_wanted(program: Program, reach: Reach, search: Search, c: int, lane: int) -> bool:
    """Does a candidate pass the screen? If not, the cause is kept. All lanes of a block call it together."""
    cause = search.cause[c]
    block_sync()  # all lanes have read it
    if cause == _NONE:
        cause = why_not(program, reach, search, c, search.obj[c])
        if lane == 0 and cause != _NONE:
            search.cause[c] = cause
    return cause == _NONE


@wp.func
def _queue(search: Search, leaves: QueuedLeaves) -> bool:
    """Queue two leaves, the first of each candidate apart from the others. Returns whether there was room."""
    c = leaves.candidate
    if leaves.entry[3] < 0 and wp.atomic_add(search.leaf_num, c, 1) == 0:
        search.first_leaf[wp.atomic_add(search.first_leaves, 0, 1)] = leaves
        return True
    at = wp.atomic_add(search.leaves, 0, 1)
    if at >= search.leaf.shape[0]:
        return False
    search.leaf[at] = leaves
    return True


@wp.kernel(module="unique", grid_stride=False)
def _queue_leaves(
    program: Program,
    reach: Reach,
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec4i)
    for c in range(block, candidate_num(search), blocks):
        if not _is_wanted(program, reach, search, c, lane):
            continue
        row = search.row[c]
        obj = search.obj[c]
        support = support_of(program, obj)
        last = _start_num(program, search, c, row, obj)
        for base in range(0, last, wp.block_dim()):
            first = _start(program, search, c, row, obj, wp.min(base + lane, last - 1))
            wp.tile_stack_push(nodes, first, base + lane < last and first[0] >= 0)
            while wp.tile_stack_count(nodes) > 0:
                entry, slot = wp.tile_stack_pop(nodes)
                step = Step()
                if slot >= 0:
                    poses = candidate_poses(program, layouts, search, c, row, entry[0], entry[3])
                    step = next_step(program, entry, poses, margin_of(program, entry[0], support))
                at_left = wp.tile_stack_push(nodes, step.left, step.inner)
                at_right = wp.tile_stack_push(nodes, step.right, step.inner)
                missed = step.inner and wp.min(at_left, at_right) < 0
                if step.leaf:
                    leaves = QueuedLeaves()
                    leaves.candidate = c
                    leaves.entry = entry
                    missed = not _queue(search, leaves)
                if missed:
                    search.missed[c] = 1
                    search.unproven[0] = 1


@wp.func
def _test(program: Program, layouts: LayoutsView, search: Search, leaves: QueuedLeaves):
    """Test two leaves, unless what they belong to is rejected already."""
    c = leaves.candidate
    entry = leaves.entry
    if _is_open(search, c, entry[3]):
        row = search.row[c]
        poses = candidate_poses(program, layouts, search, c, row, entry[0], entry[3])
        if pieces_touch(program, entry, poses, margin_of(program, entry[0], support_of(program, search.obj[c]))):
            _keep_hit(search, c, row, entry[3])


# With all the registers that it would take, a multiprocessor holds few warps, and each waits for its own arithmetic.
@wp.kernel(module="unique", grid_stride=False, cuda_max_registers=128)
def _test_leaves(
    program: Program,
    lanes: int,
    first: bool,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    if first:
        for i in range(wp.tid(), search.first_leaves[0], lanes):
            _test(program, layouts, search, search.first_leaf[i])
    else:
        for i in range(wp.tid(), wp.min(search.leaves[0], search.leaf.shape[0]), lanes):
            _test(program, layouts, search, search.leaf[i])


@wp.kernel(module="unique", grid_stride=False, cuda_max_registers=128)
def _test_together(
    program: Program,
    reach: Reach,
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec4i)
    leaves = wp.tile_stack(capacity=wp.static(WAITING), dtype=wp.vec4i)
    for c in range(block, candidate_num(search), blocks):
        if _is_wanted(program, reach, search, c, lane):
            row = search.row[c]
            own_pos = search.body_pos[c]
            own_quat = search.body_quat[c]
            pos = layouts.body_pos[row]
            quat = layouts.body_quat[row]
            obj = search.obj[c]
            adr = program.obj_startadr[obj]
            num = program.obj_startnum[obj]
            support = support_of(program, obj)
            found = collides(program, adr, num, support, nodes, leaves, lane, own_pos, own_quat, pos, quat)
            if lane == 0 and found == _COLLISION:
                search.cause[c] = _COLLISION
            if lane == 0 and found == _UNPROVEN:
                search.missed[c] = 1
                search.unproven[0] = 1


@wp.func
def _test_by_itself(program: Program, layouts: LayoutsView, search: Search, c: int):
    """Test a candidate as a whole. One lane's work."""
    row = search.row[c]
    obj = search.obj[c]
    for i in range(_start_num(program, search, c, row, obj)):
        if search.cause[c] == _COLLISION:
            break
        entry = _start(program, search, c, row, obj, i)
        if entry[0] >= 0 and _is_open(search, c, entry[3]):
            poses = candidate_poses(program, layouts, search, c, row, entry[0], entry[3])
            if leaves_below_touch(program, entry, poses, margin_of(program, entry[0], support_of(program, obj))):
                _keep_hit(search, c, row, entry[3])


@wp.kernel(module="unique", grid_stride=False)
def _test_alone(
    program: Program,
    reach: Reach,
    lanes: int,
    unproven: bool,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    if unproven and search.unproven[0] == 0:
        return
    for c in range(wp.tid(), candidate_num(search), lanes):
        if not unproven and search.cause[c] == _NONE:
            search.cause[c] = why_not(program, reach, search, c, search.obj[c])
        if search.cause[c] == _NONE and (not unproven or search.missed[c] != 0):
            _test_by_itself(program, layouts, search, c)


def lane_kernels(faces: bool) -> list[wp.Kernel]:
    """The kernels that a GPU launches by lanes."""
    return [_test_alone] if faces else [_test_leaves, _test_alone]


def block_kernel(faces: bool) -> wp.Kernel:
    """The one that it launches by blocks."""
    return _test_together if faces else _queue_leaves


def launch_test_collisions(
    program: Program, reach: Reach, size: SearchSize, faces: bool, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Test the candidates that pass the screen."""
    together = size.block_dim > 1
    blocks = {"dim": [size.blocks], "block_dim": size.block_dim, "device": device}
    lanes = {"dim": size.lanes, "device": device}
    if together and faces:
        wp.launch_tiled(block_kernel(faces), inputs=[program, reach, size.blocks, layouts, search], **blocks)
    elif together:
        wp.launch_tiled(block_kernel(faces), inputs=[program, reach, size.blocks, layouts, search], **blocks)
        for first in (True, False):  # most candidates that collide are known by their first leaves
            wp.launch(_test_leaves, inputs=[program, size.lanes, first, layouts, search], **lanes)
    wp.launch(_test_alone, inputs=[program, reach, size.lanes, together, layouts, search], **lanes)
