"""Paths to a grasp, for the tier `path`: polylines in joint space without collisions, of the robot with itself too.

A path leads from the drawn start pose over at most two vias to the pre-grasp, and on to the grasp. First the straight
path is tried, then paths over a via behind the pre-grasp, then paths over drawn vias. Before the pre-grasp, drawn vias
lead to it, to a free via behind it, or to another drawn via. The first free path counts, so the result does not depend
on how many rows are tried in parallel.
"""

from typing import Any

import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.blocks import block_sync
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

_RETREAT = wp.constant(0.1)
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
def _find_path(
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
) -> bool:
    """Find the first free path to the grasp of a candidate, and write its corners. Freely turning joints turn least."""
    row = reach_search.row[c]
    column = reach_search.column[row]
    start = present_joints(reach, layouts, row)
    pregrasp, _near = nearest_turns(reach.arm, start, reach_search.pregrasp_qpos[c])
    there, _near = nearest_turns(reach.arm, pregrasp, reach_search.grasp_qpos[c])
    if lane == 0:
        write_joints(reach, layouts, reach_search, c, block)
    pos, quat = tcp_in_base(reach, layouts, row, reach_search.grasp[c])
    worldid = search.row_world[row]
    seed = layouts.pending_seed[worldid]
    episode = layouts.pending_episode[worldid]
    stream = numbered_stream(split, wp.static(PATH_STREAM))
    trial = search.row_restart[row] * layouts.grasp.shape[1] + column
    ends = _mat58()  # the pre-grasp, and vias behind it from which the way to it is free
    ends[0] = pregrasp
    nend = int(1)
    retreat = pregrasp
    is_behind = bool(False)  # the piece from `retreat` to the pre-grasp is proven
    k = int(-1)
    while k < wp.static(PATHS):
        via = pregrasp
        end = pregrasp  # the second via
        first = int(0)
        pieces = int(1)  # to prove, from `first`
        if k < 0:
            first = wp.static(APPROACH)
        elif k > wp.static(RETREATS):
            end = ends[k % nend]
            pieces = 2
            if (k // nend) % 2 == 1:
                pieces = 3
                end = _drawn_via(reach, seed, episode, stream, trial, wp.static(PATHS) + k, start, end)
            via = _drawn_via(reach, seed, episode, stream, trial, k, start, end)
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
        free = not sweep_touches(program, reach, layouts, reach_search, nodes, leaves, c, block, first, pieces, lane)
        if free and first == 0:
            if lane == 0:
                reach_search.path[c, 0] = start
                reach_search.path[c, 1] = via
                reach_search.path[c, 2] = end
                reach_search.pregrasp_qpos[c] = pregrasp
                reach_search.grasp_qpos[c] = there
            return True
        if k < 0 and not free:
            return False  # all paths end with this piece
        is_behind = k > 0 and free
        if is_behind:
            ends[nend] = retreat
            nend += 1
        else:
            k += 1
    return False


@wp.kernel(grid_stride=False)
def _test_paths(
    blocks: int,
    program: Program,
    reach: Reach,
    split: wp.uint32,
    # Layouts in: qpos, pending*, bodies*
    layouts: LayoutsView,
    # Search in: restarts*
    search: Search,
    # ReachSearch in: column, tier, first, trials, queue, source, rows, row, grasp, body_pos, body_quat; out: path;
    #   both: paths, failed, grasp_qpos, pregrasp_qpos, blocks*
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(NODE_STACK), dtype=wp.vec4i)
    leaves = wp.tile_stack(capacity=wp.static(LEAF_STACK), dtype=wp.vec4i)
    for i in range(block, reach_search.rows[0], blocks):
        row = reach_search.queue[reach_search.source[0], i]
        if reach_search.tier[row, reach_search.column[row]] == wp.static(int(Tier.PATH)):
            c = int(reach_search.first[row])
            last = c + reach_search.trials[row]
            while c < last:
                failed = reach_search.failed[c]
                if failed == ReachStep.DEFERRED:
                    c = last
                elif failed == ReachStep.PASSED:
                    free = bool(False)
                    if reach_search.paths[row] < wp.static(MOST_TRIED):
                        free = _find_path(
                            program, reach, split, layouts, search, reach_search, nodes, leaves, c, block, lane
                        )
                    block_sync()
                    if free:
                        c = last
                    elif lane == 0:
                        reach_search.failed[c] = ReachStep.PATH
                        reach_search.paths[row] += 1
                    block_sync()
                c += 1


def launch_test_paths(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Find a path for the first candidate of each row that has passed all other steps. Candidates without one fail."""
    state = work.layouts, work.search, reach_search
    work.launch_blocks(_test_paths, work.program, reach, work.split, *state)
