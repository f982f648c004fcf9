"""Waves of the reach stage: create candidates for waiting rows, and keep each row's first candidate that passes.

A candidate is one grasp with initial joint positions for the inverse kinematics. Candidates after the kept candidate
are ignored, so the result does not depend on the number of candidates tried in parallel.
"""

import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.transforms import pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.ik import start_joints
from sceniris_gym.layout.reaching.search import (
    GRASPED,
    MOST_AT_ONCE,
    STARTS,
    ReachSearch,
    ReachStep,
    begin_reach_wave,
    candidate_num,
    fail_grasp,
    needs_pregrasp,
    queue_row,
    queue_target,
    takes_step,
)
from sceniris_gym.layout.wave.rounds import row_of_restart
from sceniris_gym.layout.wave.search import Search, Workspace
from sceniris_gym.layout.wave.settle import is_sound
from sceniris_gym.placement.grasps import first_accepted, passes_map
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach, StartPose, Starts, reaches
from sceniris_gym.reach.arm import MAX_JOINTS

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _take_first_through(reach: Reach, layouts: LayoutsView, row: int, column: int):
    """Write the first grasp that the map accepts, for a target that was placed before the arm's base."""
    body_pos = layouts.body_pos[row]
    body_quat = layouts.body_quat[row]
    base = pose_of(body_pos[reach.base_body], body_quat[reach.base_body])
    grasp = first_accepted(reach, column, layouts.stable[row, column], base, body_pos, body_quat)
    layouts.grasp[row, column] = wp.max(grasp, layouts.grasp[row, column])


@wp.func
def _skip_blocked(reach: Reach, layouts: LayoutsView, search: Search, row: int, column: int):
    """Write a target's first free grasp, if the target's free grasps were tracked while objects were placed."""
    for early in range(reach.early_grasp.shape[0]):
        grasp = reach.early_grasp[reach.early_grasp.shape[0] - 1 - early]
        if reach.grasp_reach[grasp] == column and search.row_free[row, reach.early_grasp.shape[0] - 1 - early]:
            layouts.grasp[row, column] = grasp - reach.reach_graspadr[column]


@wp.func
def _first_grasp(reach: Reach, layouts: LayoutsView, row: int, column: int) -> int:
    """Return the index of the first grasp to try for a target. Placing found that no earlier grasp can be used."""
    return reach.reach_graspadr[column] + layouts.grasp[row, column]


@wp.func
def _move_to(reach: Reach, layouts: LayoutsView, search: Search, reach_search: ReachSearch, row: int, column: int):
    """Move a row to the arm's next target of tier `ik` or `clear` that is present, from `column` on.

    Absent targets before this target get no grasp. After the last target, the row moves to the next arm. After the last
    arm, the row is finished. Its restart then becomes the best of its world, unless an earlier restart has finished.
    """
    found = int(column)
    columns = layouts.grasp.shape[1]
    while found < columns:
        if layouts.present[row, reach.reach_slot[found]] == 0:
            layouts.grasp[row, found] = -1
        elif reach.reach_arm[found] == reach.number:
            if reach_search.tier[row, found] >= Tier.IK:
                break
            if reach.reach_late[found] != 0:
                _take_first_through(reach, layouts, row, found)
        found += 1
    if found == columns:
        reach_search.arm[row] = reach.number + 1
        if reach.number == reach.last:
            search.waiting[row] = False
            wp.atomic_min(search.best, search.row_world[row], search.row_restart[row])
        return
    if reach.reach_early[found]:
        _skip_blocked(reach, layouts, search, row, found)
    stable = layouts.stable[row, found]
    last = reach.stable_graspadr[stable] + reach.stable_graspnum[stable]
    queue_target(reach_search, row, found, (last - _first_grasp(reach, layouts, row, found)) * wp.static(STARTS))


@wp.func
def _first_waiting(reach: Reach, search: Search, row: int) -> int:
    """Return the row that the world of `row` tries next, or -1 if there is no such row.

    With one arm, restarts are tried one after the other, so the next row is the world's first waiting restart. With
    several arms, all restarts are tried, so the next row is `row` itself.
    """
    if reach.last > 0:
        return row
    worldid = search.row_world[row]
    for i in range(search.restarts_at_once[0]):
        other = row_of_restart(search, worldid, i)
        if search.waiting[other]:
            return other
    return -1


@wp.func
def _ask_tiers(starts: Starts, reach: Reach, layouts: LayoutsView, search: Search, reach_search: ReachSearch, row: int):
    """Set the required tier of each target of a row, and reset the joints of the grasps to NaN.

    If the kind of start takes the arm to a target, this target requires the tier `clear`, or only its tests of the
    grasp, or a path. Other targets keep the tier of the scene file.
    """
    kind = layouts.start[search.row_world[row]]
    for column in range(reach_search.tier.shape[1]):
        reach_search.tier[row, column] = reach.reach_tier[column]
        if starts.pose.shape[0] > 0:
            if reaches(starts, kind, column) and reach.reach_tier[column] < Tier.CLEAR:
                tier = wp.where(starts.pregrasp[kind], int(Tier.CLEAR), wp.static(GRASPED))
                reach_search.tier[row, column] = tier
            if reaches(starts, kind, column) and starts.pose[kind] == StartPose.PATH:
                reach_search.tier[row, column] = int(Tier.PATH)
        for i in range(MAX_JOINTS):
            layouts.grasp_qpos[row, column, i] = wp.nan
            layouts.pregrasp_qpos[row, column, i] = wp.nan
        for i in range(layouts.path.shape[2]):
            layouts.path[row, column, i] = wp.nan


@wp.kernel
def _open_rows(
    program: Program,
    reach: Reach,
    starts: Starts,
    # Layouts in: state*, choices*, stable, bodies*; out: grasp_qpos, pregrasp_qpos, path; both: grasp
    layouts: LayoutsView,
    # Search in: ticket, restarts*, row_free, restarts_at_once; both: best, waiting
    search: Search,
    # ReachSearch in: source; out: column, number, total, tried, paths, furthest, queue, candidates; both: arm, tier,
    #   rows_left
    reach_search: ReachSearch,
):
    row = wp.tid()
    if row == 0:
        reach_search.candidates[0] = 0  # an interrupt of earlier launches may have left candidates
    if reach.number == 0:
        reach_search.arm[row] = 0
        if search.waiting[row]:
            _ask_tiers(starts, reach, layouts, search, reach_search, row)
        # the world of an unsound row falls back, so the row skips the stage
        if search.waiting[row] and not is_sound(program, layouts, row, 0, 1):
            search.waiting[row] = False
            wp.atomic_min(search.best, search.row_world[row], search.row_restart[row])
    if search.waiting[row] and reach_search.arm[row] == reach.number and _first_waiting(reach, search, row) == row:
        _move_to(reach, layouts, search, reach_search, row, 0)


def launch_open_rows(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Queue the waiting rows whose current arm is `reach`."""
    work.launch(_open_rows, work.nrow, work.program, reach, work.kinds, work.layouts, work.search, reach_search)


@wp.kernel(grid_stride=False)
def _open_candidates(
    lanes: int,
    reach: Reach,
    busy: int,
    # Layouts in: grasp
    layouts: LayoutsView,
    # ReachSearch in: column, number, total, tried, queue, rows_left, source; out: first, trials, row, grasp, ik_start,
    #   failed; both: candidates
    reach_search: ReachSearch,
):
    rows = reach_search.rows_left[0]
    for i in range(wp.tid(), rows, lanes):
        row = reach_search.queue[1 - reach_search.source[0], i]
        column = reach_search.column[row]
        number = reach_search.number[row]
        # Few rows that have failed before share twice the room.
        room = wp.min(busy * wp.where(number > 0 and 8 * rows < busy, 2, 1), reach_search.failed.shape[0])
        at_once = wp.clamp(room // rows, 1, wp.static(MOST_AT_ONCE))
        # Try half the number of starts that have failed so far. This wastes at most 50% more starts, and takes far
        # fewer waves. On a CPU core, a wave costs 10 to 20 us and a start 4 us.
        trials = wp.clamp(reach_search.tried[row] // 2, at_once, wp.static(MOST_AT_ONCE))
        trials = wp.min(trials, reach_search.total[row] - number)
        first = wp.atomic_add(reach_search.candidates, 0, trials)
        trials = wp.clamp(reach_search.failed.shape[0] - first, 0, trials)
        reach_search.first[row] = first
        reach_search.trials[row] = trials
        for t in range(trials):
            start = number + t
            reach_search.row[first + t] = row
            reach_search.grasp[first + t] = _first_grasp(reach, layouts, row, column) + start // wp.static(STARTS)
            reach_search.ik_start[first + t] = start % wp.static(STARTS)
            reach_search.failed[first + t] = ReachStep.PASSED


@wp.kernel(grid_stride=False)
def _look_up(
    lanes: int,
    reach: Reach,
    starts: Starts,
    split: wp.uint32,
    # Layouts in: qpos, start, pending*, bodies*
    layouts: LayoutsView,
    # Search in: restarts*
    search: Search,
    # ReachSearch in: column, tier, first, trials, candidates, row, grasp, ik_start; out: rows, grasp_qpos, hard_num;
    #   both: rows_left, source, failed
    reach_search: ReachSearch,
):
    if wp.tid() == 0:
        begin_reach_wave(reach_search)
    for c in range(wp.tid(), candidate_num(reach_search), lanes):
        if takes_step(reach_search, c, ReachStep.MAP):
            row = reach_search.row[c]
            body_pos = layouts.body_pos[row]
            body_quat = layouts.body_quat[row]
            base = pose_of(body_pos[reach.base_body], body_quat[reach.base_body])
            column = reach_search.column[row]
            grasp = reach_search.grasp[c]
            passes = passes_map(reach, column, grasp, base, body_pos, body_quat)
            if passes and starts.pose.shape[0] > 0:
                kind = layouts.start[search.row_world[row]]
                if reaches(starts, kind, column):
                    passes = starts.grasp[kind, grasp]
            if not passes:
                fail_grasp(reach_search, c, ReachStep.MAP)
        if reach_search.failed[c] > ReachStep.MAP:
            reach_search.grasp_qpos[c] = start_joints(reach, layouts, search, reach_search, split, c)


def launch_open_wave(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Create candidates for the queued rows. The fewer rows are left, the more candidates each row gets."""
    work.launch_lanes(_open_candidates, reach, work.size.busy, work.layouts, reach_search)


def launch_look_up(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Choose the initial joints of each candidate.

    If the arm's map rejects a grasp, or the kind of start cannot use the grasp, its candidates are rejected.
    """
    work.launch_lanes(_look_up, reach, work.kinds, work.split, work.layouts, work.search, reach_search)


@wp.func
def keep_grasp(reach: Reach, layouts: LayoutsView, reach_search: ReachSearch, row: int, column: int, c: int):
    """Write the grasp and the joints of a candidate that passed. Only the tier `clear` has pre-grasps."""
    layouts.grasp[row, column] = reach_search.grasp[c] - reach.reach_graspadr[column]
    clear = needs_pregrasp(reach_search.tier[row, column])
    for i in range(MAX_JOINTS):
        there = i < reach.arm.njoint
        layouts.grasp_qpos[row, column, i] = wp.where(there, reach_search.grasp_qpos[c][i], wp.nan)
        layouts.pregrasp_qpos[row, column, i] = wp.where(there and clear, reach_search.pregrasp_qpos[c][i], wp.nan)
    if reach_search.tier[row, column] == wp.static(int(Tier.PATH)):
        for corner in range(3):
            for i in range(reach.arm.njoint):
                layouts.path[row, column, corner * MAX_JOINTS + i] = reach_search.path[c, corner][i]


@wp.func
def first_passed(reach_search: ReachSearch, row: int) -> int:
    """Return a row's first candidate that passed.

    If no candidate passed, move the row on to its next grasp or initial joint positions, and return -1.
    """
    number = reach_search.number[row]
    first = reach_search.first[row]
    after = int(number)
    furthest = int(reach_search.furthest[row])
    tried = int(0)
    for c in range(first, first + reach_search.trials[row]):
        failed = reach_search.failed[c]
        if failed == ReachStep.DEFERRED:
            break
        furthest = wp.max(furthest, failed)
        if failed == ReachStep.PASSED:
            return c
        after = number + c + 1 - first
        if failed < ReachStep.IK_AT_GRASP:  # all starts of this grasp fail
            after += wp.static(STARTS) - 1 - reach_search.ik_start[c]
        else:
            tried += 1
    reach_search.number[row] = after
    reach_search.furthest[row] = furthest
    reach_search.tried[row] += tried
    return -1


@wp.func
def _reject_cause(reach: Reach, reach_search: ReachSearch, row: int) -> int:
    """Return the cause for which the current target of a row failed: NO_IK, BLOCKED or NO_PATH.

    The cause is BLOCKED only from the tier `clear` on: if all candidates failed before the inverse kinematics, or if at
    least one candidate passed the robot's test for self-collision.
    """
    furthest = reach_search.furthest[row]
    if furthest == ReachStep.PATH:
        return Cause.NO_PATH
    if reach_search.tier[row, reach_search.column[row]] >= Tier.CLEAR and (
        furthest < ReachStep.IK_AT_GRASP or furthest > ReachStep.SELF_AT_GRASP
    ):
        return Cause.BLOCKED
    return Cause.NO_IK


@wp.kernel(grid_stride=False)
def _accept(
    lanes: int,
    reach: Reach,
    # Layouts in: present, stable, bodies*; out: grasp_qpos, pregrasp_qpos, path; both: grasp, row_rejections
    layouts: LayoutsView,
    # Search in: ticket, restarts*, row_free, restarts_at_once; both: best, waiting
    search: Search,
    # ReachSearch in: tier, first, trials, source, rows, grasp, ik_start, failed, grasp_qpos, pregrasp_qpos, path; out:
    #   arm, paths, candidates; both: column, number, total, tried, furthest, queue, rows_left
    reach_search: ReachSearch,
):
    if wp.tid() == 0:
        reach_search.candidates[0] = 0  # of the next wave
    for i in range(wp.tid(), reach_search.rows[0], lanes):
        row = reach_search.queue[reach_search.source[0], i]
        column = reach_search.column[row]
        found = first_passed(reach_search, row)
        if found >= 0:
            keep_grasp(reach, layouts, reach_search, row, column, found)
            _move_to(reach, layouts, search, reach_search, row, column + 1)
        elif search.best[search.row_world[row]] < search.row_restart[row]:
            search.waiting[row] = False  # an earlier restart of the world has finished
        elif reach_search.number[row] < reach_search.total[row]:
            queue_row(reach_search, row)
        else:
            layouts.row_rejections[row, reach.reach_obj[column], _reject_cause(reach, reach_search, row)] += 1
            search.waiting[row] = False
            following = _first_waiting(reach, search, row)
            if following >= 0 and following != row:
                _move_to(reach, layouts, search, reach_search, following, 0)


def launch_accept_grasps(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Keep the first candidate of each row that passed.

    Rows without such a candidate continue with their next candidates, or fail if no candidates are left.
    """
    work.launch_lanes(_accept, reach, work.layouts, work.search, reach_search)
