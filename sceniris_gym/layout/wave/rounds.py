"""Rounds of restarts: every pending world runs one restart, or several in parallel if rows are free.

If several restarts of a world place all objects and pass the reach stage, the restart with the lowest number becomes
the world's layout. Later restarts of the round are ignored. An unsound layout (see `is_sound`) is never served. Its
world falls back to the bank at once.
"""

import warp as wp

from sceniris_gym.device.transforms import log_of
from sceniris_gym.layout.layouts import LayoutsView, open_episode
from sceniris_gym.layout.masks import selects
from sceniris_gym.layout.wave.groups import draw_groups, next_object
from sceniris_gym.layout.wave.search import MANY_ROWS, Search, Workspace, finish_row, queue_row
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach, Starts

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NEVER = wp.constant(1 << 30)
"""Value of `Search.best` for a world without a finished restart."""
# Expected number of worlds that a round may leave pending. With a reach stage, a round costs more and some worlds are
# harder.
_LEFT = wp.constant(0.5)
_LEFT_BY_STAGE = wp.constant(0.01)
# A round of few rows takes as long as this number of rows takes in a later round.
_ROWS_OF_ROUND = wp.constant(2048.0)


@wp.func
def _restarts_wanted(worlds: float, left: float, rate: float) -> int:
    """Return the number of restarts per world after which only `left` worlds are expected to be pending.

    Args:
        worlds: Number of pending worlds now.
        left: Expected number of pending worlds afterwards.
        rate: Probability that a restart fails.
    """
    return int(wp.ceil(log_of(worlds / left) / -log_of(rate)))


@wp.func
def _clear_rejections(layouts: LayoutsView, row: int):
    """Reset the rejection counts of a row."""
    for i in range(layouts.row_rejections.shape[1]):
        for j in range(layouts.row_rejections.shape[2]):
            layouts.row_rejections[row, i, j] = 0


@wp.func
def await_round(search: Search, worldid: int):
    """Add a pending world to the next round, under the next free index."""
    search.best[worldid] = NEVER
    search.ticket[worldid] = wp.atomic_add(search.worlds_left, 0, 1)


@wp.kernel
def _begin_episodes(
    program: Program,
    mask: wp.array[bool],
    split: wp.uint32,
    # Layouts in: seed, episode, next*, stream; out: draws*, attempts, row_rejections; both: present, pending*
    layouts: LayoutsView,
    # Search out: worlds*, waiting, rows_left, restarts_at_once, opened; both: worlds_left
    search: Search,
):
    worldid = wp.tid()
    # An interrupt of earlier launches may have left these set.
    search.pending[worldid] = False
    for row in range(worldid, search.waiting.shape[0], search.pending.shape[0]):
        search.waiting[row] = False
    if worldid == 0:
        search.rows_left[0] = 0
        search.opened[0] = 0
        search.restarts_at_once[0] = 0
    if not selects(mask, worldid):
        return
    open_episode(layouts, worldid)
    layouts.attempts[worldid] = 0
    _clear_rejections(layouts, worldid)
    search.pending[worldid] = True
    search.restart[worldid] = 0
    await_round(search, worldid)
    seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
    draw_groups(program, worldid, seed, episode, split, layouts.present[worldid])


def launch_begin_episodes(work: Workspace, mask: wp.array | None) -> None:
    """Mark the masked worlds as pending, and set the seeds and episodes of the layouts to make for them."""
    work.search.worlds_left.zero_()
    work.launch(_begin_episodes, work.nworld, work.program, mask, work.split, work.layouts, work.search)


@wp.func
def row_of_restart(search: Search, worldid: int, number: int) -> int:
    """Return the row of a world's restart `number`. Restarts are numbered from 0 in each round."""
    if number == 0:
        return worldid
    return search.pending.shape[0] + search.ticket[worldid] * (search.restarts_at_once[0] - 1) + number - 1


@wp.kernel
def _plan_round(
    program: Program,
    staged: bool,
    busy: int,
    # Search out: busy, rows; both: worlds_left, restarts_at_once, many_rows
    search: Search,
):
    worlds = wp.max(search.worlds_left[0], 1)
    extra = search.row_world.shape[0] - search.pending.shape[0]
    room = extra // worlds + 1
    left = wp.where(staged, _LEFT_BY_STAGE, _LEFT)
    wanted = _restarts_wanted(float(worlds), left, program.restart_rate)
    wanted = wp.max(wanted, 2 * search.restarts_at_once[0])  # the number in the last round was too low, so double it
    failing = float(worlds) * program.restart_rate
    # If another round follows anyway, or costs less than all rows in the reach stage, one restart per world suffices.
    # The next round should then have room for the worlds that are expected to fail.
    if failing > left and (wanted > room or (staged and 2 * worlds >= busy)):
        if failing * float(_restarts_wanted(failing, left, program.restart_rate)) <= float(extra):
            room = 1
    # The risk of yet another round is at most worlds * restart_rate^wanted. One more restart takes `worlds` rows.
    if search.restarts_at_once[0] > 0 and not staged:
        wanted += int(float(wanted) * log_of(program.restart_rate) > -log_of(_ROWS_OF_ROUND))
    search.restarts_at_once[0] = wp.clamp(wp.min(room, wanted), 1, program.restarts + 1)
    search.worlds_left[0] = 0
    rows = worlds * search.restarts_at_once[0]
    search.rows[0] = rows
    search.many_rows[0] = int(rows >= MANY_ROWS)
    search.busy[0] = busy << search.many_rows[0]


@wp.kernel(grid_stride=False)
def _open_rows(
    lanes: int,
    program: Program,
    reach: Reach,
    starts: Starts,
    staged: bool,
    ahead: int,
    # Layouts out: mocap_pos, mocap_quat, grasp, row_rejections, pivots*; both: qpos, choices*, bodies*
    layouts: LayoutsView,
    # Search in: pending, restart, ticket, restarts_at_once, busy, source, rows, rows_before; out: waiting,
    #   row_attempts, queue, shares*, cutting, trials*; both: best, restarts*, row_object, row_trial, rows_left, opened
    search: Search,
):
    nworld = search.pending.shape[0]
    for i in range(wp.tid(), nworld * search.restarts_at_once[0], lanes):
        worldid = i % nworld
        number = i // nworld
        restart = search.restart[worldid] + number
        if not search.pending[worldid] or restart > program.restarts:
            continue
        row = row_of_restart(search, worldid, number)
        if row != worldid:
            layouts.start[row] = layouts.start[worldid]
            for k in range(layouts.present.shape[1]):
                layouts.present[row, k] = layouts.present[worldid, k]
            _clear_rejections(layouts, row)
        for k in range(starts.robot_qposadr.shape[0]):  # starts of earlier layouts may have moved the robots
            adr = starts.robot_qposadr[k]
            layouts.qpos[row, adr] = program.home_qpos[adr]
        search.row_world[row] = worldid
        search.row_restart[row] = restart
        search.row_trial[row] = 0
        search.row_attempts[row] = 0
        search.row_object[row] = next_object(program, reach, layouts, row, program.ngiven)
        if search.row_object[row] == program.nobject:
            finish_row(search, row, staged)
            continue
        num = int(0)  # number of objects ahead, up to the first absent object
        if search.row_object[row] == 0:
            while num < ahead and layouts.present[row, program.obj_slot[num + 1]] != 0:
                num += 1
        search.row_object[row] += num
        queue_row(program, search, row, num)


def launch_open_rows(work: Workspace, staged: bool) -> None:
    """Begin a round: decide how many restarts each pending world runs, and prepare a row for each restart."""
    program, state = work.program, [work.layouts, work.search]
    work.launch(_plan_round, 1, program, staged, work.size.busy, work.search)
    work.launch_lanes(_open_rows, program, work.reaches[0], work.kinds, staged, work.ahead, *state)
