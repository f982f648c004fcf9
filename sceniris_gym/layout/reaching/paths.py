"""Paths to a grasp, for the tier `path`: polylines in joint space without collisions, of the robot with itself too.

A path leads from the drawn start pose over at most two vias to the pre-grasp, and on to the grasp. First the straight
path is tried, then paths over a via behind the pre-grasp, then paths over drawn vias. Before the pre-grasp, drawn vias
lead to it, to a free via behind it, or to another drawn via. The first free path counts, so the result does not depend
on how many rows are tried in parallel.
"""

from typing import Any

import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.blocks import block_any, block_sync
from sceniris_gym.device.random import PATH_STREAM, uniforms
from sceniris_gym.device.transforms import z_axis
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.ik import nearest_turns, present_joints, tcp_in_base
from sceniris_gym.layout.reaching.search import PREGRASP_DISTANCE, ReachSearch, ReachStep
from sceniris_gym.layout.reaching.sweeps import APPROACH, LEAF_STACK, NODE_STACK, sweep_touches, write_joints
from sceniris_gym.layout.wave.search import Search, Workspace, numbered_stream
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import ITERATIONS, accepted, refine, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PATHS = 128
"""Number of paths that are tried for a grasp."""
RETREATS = 3
"""Number of paths over a via behind the pre-grasp, after the straight path. Each via is 0.1 m further back."""
MOST_TRIED = 8
"""Maximum number of grasps with joints to search paths for, per object and restart."""
MOST_BLOCKS = 31
"""Maximum number of blocks that share the drawn paths of a candidate."""

_RETREAT = wp.constant(0.1)
_NUMBER_BITS = wp.constant(16)  # of the number of a block
_mat58 = wp.types.matrix(shape=(5, MAX_JOINTS), dtype=float)
# Drawn vias spread by this about the straight path: hinges [rad], slides [m].
_SPREAD = wp.constant(0.6)
_SLIDE_SPREAD = wp.constant(0.2)


@wp.func
def _drawn_via(reach: Reach, seed: wp.uint64, episode: int, stream: wp.uint32, trial: int, k: int, a: vec8, b: vec8):
    """Draw a via about the piece from `a` to `b`. A sum of four uniform numbers is nearly normally distributed."""
    first = (MAX_JOINTS + 1) * k
    share = uniforms(seed, episode, stream, trial, first)[0]
    via = vec8()
    for j in range(MAX_JOINTS):
        if j < reach.arm.njoint:
            u = uniforms(seed, episode, stream, trial, first + 1 + j)
            spread = wp.where(reach.arm.slide[j] != 0, _SLIDE_SPREAD, _SPREAD)
            normal = 1.7320508 * (u[0] + u[1] + u[2] + u[3] - 2.0)
            via[j] = wp.clamp(a[j] + share * (b[j] - a[j]) + spread * normal, reach.arm.lower[j], reach.arm.upper[j])
    return via


@wp.func
def _drawn_vias(
    reach: Reach,
    split: wp.uint32,
    layouts: LayoutsView,
    search: Search,
    reach_search: ReachSearch,
    row: int,
    k: int,
    two: bool,
    start: vec8,
    end: vec8,
):
    """Draw a via between `start` and `end`. If `two`, another drawn via replaces `end`. Return both."""
    seed = layouts.pending_seed[search.row_world[row]]
    episode = layouts.pending_episode[search.row_world[row]]
    stream = numbered_stream(split, wp.static(PATH_STREAM))
    trial = search.row_restart[row] * layouts.grasp.shape[1] + reach_search.column[row]
    last = end
    if two:
        last = _drawn_via(reach, seed, episode, stream, trial, wp.static(PATHS) + k, start, end)
    return _drawn_via(reach, seed, episode, stream, trial, k, start, last), last


@wp.func
def _write_corners(
    reach_search: ReachSearch, block: int, start: vec8, via: vec8, end: vec8, pregrasp: vec8, grasp: vec8
):
    """Write the corners of the path that a block tests."""
    for j in range(MAX_JOINTS):
        reach_search.corner[block, 0, j] = start[j]
        reach_search.corner[block, 1, j] = via[j]
        reach_search.corner[block, 2, j] = end[j]
        reach_search.corner[block, 3, j] = pregrasp[j]
        reach_search.corner[block, 4, j] = grasp[j]


@wp.func
def _keep_path(reach_search: ReachSearch, c: int, block: int):
    """Let a candidate have the path that a block has tested."""
    corners = _mat58()
    for k in range(5):
        for j in range(MAX_JOINTS):
            corners[k, j] = reach_search.corner[block, k, j]
    for k in range(3):
        reach_search.path[c, k] = corners[k]
    reach_search.pregrasp_qpos[c] = corners[3]
    reach_search.grasp_qpos[c] = corners[4]


@wp.func
def _reject_path(reach_search: ReachSearch, c: int):
    """Let a candidate fail, because none of its paths is free."""
    reach_search.failed[c] = ReachStep.PATH
    reach_search.paths[reach_search.row[c]] += 1


@wp.func
def _blocks_of_path(reach_search: ReachSearch, blocks: int) -> int:
    """Return how many blocks share the drawn paths of a candidate."""
    return wp.clamp(blocks // wp.max(reach_search.hard_num[0], 1), 1, wp.static(MOST_BLOCKS))


@wp.func
def _first_free(
    program: Program,
    reach: Reach,
    split: wp.uint32,
    layouts: LayoutsView,
    search: Search,
    reach_search: ReachSearch,
    nodes: Any,
    leaves: Any,
    c: int,
    block: int,
    lane: int,
    drawn: bool,
    offset: int,
    stride: int,
) -> int:
    """Find the first free path to the grasp of a candidate, and write its corners. Freely turning joints turn least.

    If `drawn`, each `stride`-th drawn path from `offset` on is tried, otherwise the paths before. Return the number of
    the path, -1 if the way from the pre-grasp to the grasp is not free, or PATHS if no path is free.
    """
    row = reach_search.row[c]
    start = present_joints(reach, layouts, row)
    pregrasp, _near = nearest_turns(reach.arm, start, reach_search.pregrasp_qpos[c])
    there, _near = nearest_turns(reach.arm, pregrasp, reach_search.grasp_qpos[c])
    if lane == 0:
        write_joints(reach, layouts, reach_search, c, block)
    pos, quat = tcp_in_base(reach, layouts, row, reach_search.grasp[c])
    if lane == 0 and not drawn:
        reach_search.ends[row, 0] = pregrasp
        reach_search.end_num[row] = 1
    retreat = pregrasp
    is_behind = bool(False)  # the piece from `retreat` to the pre-grasp is free
    k = int(wp.where(drawn, wp.static(RETREATS) + 1 + offset, -1))
    while k <= wp.where(drawn, wp.static(PATHS) - 1, wp.static(RETREATS)):
        via = pregrasp
        end = pregrasp  # the second via
        first = int(0)
        pieces = int(1)  # to prove, from `first`
        if k < 0:
            first = wp.static(APPROACH)
        elif drawn:
            if block_any(int(lane == 0 and reach_search.best_path[row] >> _NUMBER_BITS < k)) != 0:
                return PATHS  # another block has found an earlier path
            end_num = reach_search.end_num[row]
            end = reach_search.ends[row, k % end_num]
            pieces = 2 + (k // end_num) % 2
            via, end = _drawn_vias(reach, split, layouts, search, reach_search, row, k, pieces == 3, start, end)
        elif k > 0:
            if not is_behind:
                back = wp.static(PREGRASP_DISTANCE) + float(k) * _RETREAT
                found = refine(reach.arm, pos - back * z_axis(quat), quat, retreat, wp.static(ITERATIONS))
                if not accepted(found):
                    k += 1
                    continue
                retreat, _near = nearest_turns(reach.arm, retreat, found.q)
                first = 1
            via = retreat
        block_sync()
        if lane == 0:
            _write_corners(reach_search, block, start, via, end, pregrasp, there)
        block_sync()
        touches = sweep_touches(program, reach, layouts, reach_search, nodes, leaves, c, block, first, pieces, lane)
        if (k < 0 and touches) or (first == 0 and not touches):
            return k
        is_behind = k > 0 and not touches
        if is_behind and lane == 0:
            reach_search.ends[row, reach_search.end_num[row]] = retreat
            reach_search.end_num[row] += 1
        if not is_behind:
            k += stride
    return PATHS


@wp.func
def _note_path(reach_search: ReachSearch, c: int, last: int, block: int, drawn: bool, share: int, k: int):
    """Note what `_first_free` returned for a candidate."""
    row = reach_search.row[c]
    if k < 0:
        _reject_path(reach_search, c)
    elif k < wp.static(PATHS):
        if share == 1:
            _keep_path(reach_search, c, block)
        if drawn:
            wp.atomic_min(reach_search.best_path, row, (k << _NUMBER_BITS) + block)
    elif not drawn:
        reach_search.hard[wp.atomic_add(reach_search.hard_num, 0, 1)] = c
        reach_search.best_path[row] = wp.static(PATHS) << _NUMBER_BITS
        if c + 1 < last:
            reach_search.failed[c + 1] = ReachStep.DEFERRED


@wp.kernel(grid_stride=False)
def _test_paths(
    blocks: int,
    drawn: bool,
    program: Program,
    reach: Reach,
    split: wp.uint32,
    # Layouts in: qpos, pending*, bodies*
    layouts: LayoutsView,
    # Search in: restarts*
    search: Search,
    # ReachSearch in: column, tier, first, trials, queue, source, rows, row, grasp, body_pos, body_quat; out: path;
    #   both: paths, ends, end_num, best_path, failed, grasp_qpos, pregrasp_qpos, hard_num, hard, blocks*
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(NODE_STACK), dtype=wp.vec4i)
    leaves = wp.tile_stack(capacity=wp.static(LEAF_STACK), dtype=wp.vec4i)
    share = int(1)
    items = int(reach_search.rows[0])
    if drawn:
        share = _blocks_of_path(reach_search, blocks)
        items = share * reach_search.hard_num[0]
    for i in range(block, items, blocks):
        c = int(0)
        last = int(0)
        if drawn:
            c = reach_search.hard[i // share]
            last = c + 1
        else:
            row = reach_search.queue[reach_search.source[0], i]
            if reach_search.tier[row, reach_search.column[row]] == wp.static(int(Tier.PATH)):
                c = reach_search.first[row]
                last = c + reach_search.trials[row]
        while c < last:
            failed = reach_search.failed[c]
            row = reach_search.row[c]
            following = int(c + 1)
            if failed == ReachStep.DEFERRED:
                following = last
            elif failed == ReachStep.PASSED:
                k = int(-1)
                if reach_search.paths[row] < wp.static(MOST_TRIED):
                    k = _first_free(
                        program,
                        reach,
                        split,
                        layouts,
                        search,
                        reach_search,
                        nodes,
                        leaves,
                        c,
                        block,
                        lane,
                        drawn,
                        i % share,
                        share,
                    )
                following = wp.where(k < 0, following, last)
                block_sync()
                if lane == 0:
                    _note_path(reach_search, c, last, block, drawn, share, k)
                block_sync()
            c = following


@wp.kernel(grid_stride=False)
def _keep_paths(
    lanes: int,
    blocks: int,
    # ReachSearch in: best_path, row, hard_num, hard, corner; out: failed, grasp_qpos, pregrasp_qpos, path; both: paths
    reach_search: ReachSearch,
):
    for i in range(wp.tid(), reach_search.hard_num[0], lanes):
        c = reach_search.hard[i]
        best = reach_search.best_path[reach_search.row[c]]
        if best >> _NUMBER_BITS == wp.static(PATHS):
            _reject_path(reach_search, c)
        elif _blocks_of_path(reach_search, blocks) > 1:
            _keep_path(reach_search, c, best % (1 << _NUMBER_BITS))


def launch_test_paths(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Find a path for the first candidate of each row that has passed all other steps. Candidates without one fail.

    First, a block tries the paths before the drawn paths of a row, one candidate after the other. Then several blocks
    share the drawn paths of each candidate without a path so far. The row's later candidates wait for the next wave.
    """
    state = work.layouts, work.search, reach_search
    work.launch_blocks(_test_paths, False, work.program, reach, work.split, *state)
    blocks = max(work.size.blocks // 4, 1)  # most waves have few such candidates, and idle blocks only take time
    work.launch_blocks(_test_paths, True, work.program, reach, work.split, *state, blocks=blocks)
    work.launch_lanes(_keep_paths, blocks, reach_search)
