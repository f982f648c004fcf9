"""Starts, which follow the reach stage: bring the arm to its start, and what it holds with it.

A layout whose kind of start has an arm at an object takes it to the pre-grasp or to the grasp that the reach stage
found. Lifted and held things are tried at several heights and joints; the first that is clear of everything wins. A
restart without one has failed, and the next one follows. A *candidate* here is one such trial, in a `ReachSearch`.
"""

import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.poses import take_joints
from sceniris_gym.layout.reaching.search import IN_HAND, ReachSearch, queue_row, queue_target
from sceniris_gym.layout.reaching.start_poses import TRIALS
from sceniris_gym.layout.reaching.waves import first_passed, keep_grasp
from sceniris_gym.layout.wave.rounds import NEVER, row_of_restart
from sceniris_gym.layout.wave.search import Search, Workspace
from sceniris_gym.placement.kinematics import write_root
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.device_starts import StartPose, Starts

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _queue_starts(
    reach: Reach,
    starts: Starts,
    # Layouts in: start, grasp
    layouts: LayoutsView,
    # Search in: pending, restart, ticket, best, restarts_at_once
    search: Search,
    # ReachSearch in: rows_left, source
    # ReachSearch out: column, number, total, tried, tier, furthest, queue, rows_left
    reach_search: ReachSearch,
):
    worldid = wp.tid()
    kind = layouts.start[worldid]
    if not search.pending[worldid] or search.best[worldid] == NEVER or starts.arm[kind] != reach.number:
        return
    row = row_of_restart(search, worldid, search.best[worldid] - search.restart[worldid])
    lifted = starts.pose[kind] >= StartPose.LIFTED
    for column in range(starts.target.shape[1]):
        if starts.target[kind, column] and layouts.grasp[row, column] >= 0:
            reach_search.tier[row, column] = wp.where(lifted, wp.static(IN_HAND), int(Tier.CLEAR))
            queue_target(reach_search, row, column, wp.where(lifted, wp.static(TRIALS), 1))


def launch_queue_starts(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Queue the worlds whose restart is done and whose start has this arm at an object."""
    work.launch(_queue_starts, work.nworld, [reach, work.starts], work.layouts, work.search, reach_search)


@wp.kernel(grid_stride=False)
def _accept(
    program: Program,
    reach: Reach,
    lanes: int,
    # Layouts in: row_rejections
    # Layouts out: qpos, mocap_pos, mocap_quat, grasp, grasp_qpos, pregrasp_qpos, row_rejections
    layouts: LayoutsView,
    # Search in: best, row_world
    # Search out: best
    search: Search,
    # ReachSearch in: column, number, total, tried, tier, furthest, first, trials, queue, rows_left, source, rows,
    #   grasp, start, failed, grasp_qpos, pregrasp_qpos, qpos, body_pos, body_quat
    # ReachSearch out: number, tried, furthest, queue, rows_left
    reach_search: ReachSearch,
):
    for i in range(wp.tid(), reach_search.rows[0], lanes):
        row = reach_search.queue[reach_search.source[0], i]
        column = reach_search.column[row]
        found = first_passed(reach_search, row)
        if found >= 0:
            take_joints(program, reach.arm_body, reach_search.qpos[found], layouts.qpos[row])
            if reach_search.tier[row, column] == wp.static(IN_HAND):
                obj = reach.reach_obj[column]
                pos = reach_search.body_pos[found, program.obj_body[obj]]
                quat = reach_search.body_quat[found, program.obj_body[obj]]
                write_root(program, obj, pos, quat, layouts.qpos[row], layouts.mocap_pos[row], layouts.mocap_quat[row])
                keep_grasp(reach, layouts, reach_search, row, column, found)
        elif reach_search.number[row] < reach_search.total[row]:
            queue_row(reach_search, row)
        else:
            layouts.row_rejections[row, reach.reach_obj[column], Cause.BLOCKED] += 1
            worldid = search.row_world[row]
            search.best[worldid] = -1 - search.best[worldid]


def launch_accept_starts(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Keep the first candidate of each row that passed. A row without one goes on; out of trials, it has failed.

    The bodies of a row stay posed as they were placed.
    """
    lanes = work.size.lanes
    work.launch(_accept, lanes, [work.program, reach, lanes], work.layouts, work.search, reach_search)
