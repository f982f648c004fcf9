"""Rounds of restarts: every pending world runs one restart, or several where rows are free.

The lowest restart that places everything, and passes the reach stage if there is one, becomes the world's layout; later
restarts of the round are not counted. An unsound layout is never served: its world falls back at once.
"""

import warp as wp

from sceniris_gym.layout.layouts import LayoutsView, Status, close_episode, open_episode
from sceniris_gym.layout.wave.bank import fall_back
from sceniris_gym.layout.wave.groups import draw_groups, next_object
from sceniris_gym.layout.wave.search import Search, Workspace, finish_row, queue_row
from sceniris_gym.layout.wave.soundness import is_sound
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False})

NEVER = wp.constant(1 << 30)
"""Value of `Search.best` of a world without a restart that is done."""
# Worlds that a round is expected to leave, at most. With a reach stage a round costs more, and some worlds are harder.
_LEFT = wp.constant(0.5)
_LEFT_BY_STAGE = wp.constant(0.01)


@wp.func
def _restarts_wanted(worlds: float, left: float, rate: float) -> int:
    """Return the number of restarts after which so many worlds are expected to be left."""
    return int(wp.ceil(wp.log(worlds / left) / -wp.log(rate)))


@wp.func
def _clear_rejections(layouts: LayoutsView, row: int):
    """Reset the rejection counts of a row."""
    for i in range(layouts.row_rejections.shape[1]):
        for j in range(layouts.row_rejections.shape[2]):
            layouts.row_rejections[row, i, j] = 0


@wp.kernel
def _start(
    program: Program,
    mask: wp.array[bool],
    split: wp.uint32,
    # Layouts in: seed, episode, present, next_seed, next_episode, pending_seed, pending_episode
    # Layouts out: attempts, present, pending_seed, pending_episode, row_rejections
    layouts: LayoutsView,
    # Search in: worlds_left
    # Search out: pending, restart, waiting, worlds_left, rows_left, restarts_at_once, candidates
    search: Search,
):
    worldid = wp.tid()
    # These are already clear unless earlier launches were interrupted.
    search.pending[worldid] = False
    for row in range(worldid, search.waiting.shape[0], search.pending.shape[0]):
        search.waiting[row] = False
    if worldid == 0:
        search.rows_left[0] = 0
        search.candidates[0] = 0
        search.restarts_at_once[0] = 0
    if mask:
        if not mask[worldid]:
            return
    open_episode(layouts, worldid)
    layouts.attempts[worldid] = 0
    _clear_rejections(layouts, worldid)
    search.pending[worldid] = True
    search.restart[worldid] = 0
    wp.atomic_add(search.worlds_left, 0, 1)
    seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
    draw_groups(program, worldid, seed, episode, split, layouts.present[worldid])


def launch_start(work: Workspace, mask: wp.array | None) -> None:
    """Mark the masked worlds as pending, each for its next episode."""
    work.search.worlds_left.zero_()
    work.launch(_start, work.nworld, [work.program, mask, work.split], work.layouts, work.search)


@wp.func
def _open_row(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    search: Search,
    row: int,
    worldid: int,
    restart: int,
    staged: bool,
):
    """Begin a restart of a world in a row."""
    nworld = search.pending.shape[0]
    if row >= nworld:
        for i in range(layouts.present.shape[1]):
            layouts.present[row, i] = layouts.present[worldid, i]
        _clear_rejections(layouts, row)
    search.row_world[row] = worldid
    search.row_restart[row] = restart
    search.row_trial[row] = 0
    search.row_attempts[row] = 0
    search.row_object[row] = next_object(program, reach, layouts, row, 0)
    if search.row_object[row] < program.nobject:
        queue_row(search, row)
    else:
        finish_row(search, row, staged)


@wp.func
def row_of_restart(search: Search, worldid: int, number: int) -> int:
    """Return the row of restart `number` of a world, counted within this round."""
    if number == 0:
        return worldid
    return search.pending.shape[0] + search.ticket[worldid] * (search.restarts_at_once[0] - 1) + number - 1


@wp.kernel
def _plan_round(
    program: Program,
    staged: bool,
    busy: int,
    # Search in: worlds_left, restarts_at_once
    # Search out: worlds_left, tickets, restarts_at_once
    search: Search,
):
    worlds = wp.max(search.worlds_left[0], 1)
    extra = search.row_world.shape[0] - search.pending.shape[0]
    room = extra // worlds + 1
    left = wp.where(staged, _LEFT_BY_STAGE, _LEFT)
    wanted = _restarts_wanted(float(worlds), left, program.restart_rate)
    wanted = wp.max(wanted, 2 * search.restarts_at_once[0])  # twice as many as were too few
    failing = float(worlds) * program.restart_rate
    # another round follows anyway, or all rows take longer in the stage than it does
    if failing > left and (wanted > room or (staged and 2 * worlds >= busy)):
        if failing * float(_restarts_wanted(failing, left, program.restart_rate)) <= float(extra):
            room = 1  # the next one has room for all that fail in this one
    search.restarts_at_once[0] = wp.clamp(wp.min(room, wanted), 1, program.restarts + 1)
    search.worlds_left[0] = 0
    search.tickets[0] = 0


@wp.kernel
def _open_rows(
    program: Program,
    reach: Reach,
    staged: bool,
    # Layouts in: qpos, present, body_pos, body_quat
    # Layouts out: qpos, mocap_pos, mocap_quat, present, grasp, row_rejections, place, bounds, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: pending, restart, ticket, best, row_world, row_restart, row_object, rows_left, tickets,
    #   restarts_at_once, source
    # Search out: ticket, best, waiting, row_world, row_restart, row_object, row_trial, row_attempts, queue, rows_left,
    #   tickets
    search: Search,
):
    worldid = wp.tid()
    if not search.pending[worldid]:
        return
    search.ticket[worldid] = wp.atomic_add(search.tickets, 0, 1)
    search.best[worldid] = NEVER
    for i in range(search.restarts_at_once[0]):
        restart = search.restart[worldid] + i
        if restart <= program.restarts:
            _open_row(program, reach, layouts, search, row_of_restart(search, worldid, i), worldid, restart, staged)


def launch_open_rows(work: Workspace, staged: bool) -> None:
    """Open rows for the pending worlds, one for each restart of this round."""
    work.launch(_plan_round, 1, [work.program, staged, work.size.busy], work.search)
    work.launch(_open_rows, work.nworld, [work.program, work.reach, staged], work.layouts, work.search)


@wp.kernel(grid_stride=False)
def _open_candidates(
    program: Program,
    busy: int,
    lanes: int,
    # Search in: row_object, row_trial, queue, rows_left, source, candidates
    # Search out: row_first, row_trials, candidates, row, obj, trial
    search: Search,
):
    rows = search.rows_left[0]
    scale = float(busy) / float(wp.max(rows, 1))
    capacity = search.cause.shape[0]
    for i in range(wp.tid(), rows, lanes):
        row = search.queue[1 - search.source[0], i]
        obj = search.row_object[row]
        trials = wp.clamp(int(scale * program.obj_effort[obj]), 1, program.attempts - search.row_trial[row])
        first = wp.atomic_add(search.candidates, 0, trials)
        trials = wp.clamp(capacity - first, 0, trials)
        search.row_first[row] = first
        search.row_trials[row] = trials
        for t in range(trials):
            search.row[first + t] = row
            search.obj[first + t] = obj
            search.trial[first + t] = search.row_trial[row] + t


def launch_open_candidates(work: Workspace) -> None:
    """Open candidates for the queued rows: more per row if few rows are left or their objects usually need more."""
    size = work.size
    work.launch(_open_candidates, size.lanes, [work.program, size.busy, size.lanes], work.search)


@wp.func
def _count_row(layouts: LayoutsView, search: Search, worldid: int, row: int):
    """Add the attempts and rejections of a restart to those of its world."""
    layouts.attempts[worldid] += search.row_attempts[row]
    if row != worldid:
        for i in range(layouts.row_rejections.shape[1]):
            for j in range(layouts.row_rejections.shape[2]):
                layouts.row_rejections[worldid, i, j] += layouts.row_rejections[row, i, j]


@wp.func
def _copy_row(layouts: LayoutsView, row: int, worldid: int):
    """Copy a finished row into the row of its world."""
    for i in range(layouts.qpos.shape[1]):
        layouts.qpos[worldid, i] = layouts.qpos[row, i]
    for i in range(layouts.mocap_pos.shape[1]):
        layouts.mocap_pos[worldid, i] = layouts.mocap_pos[row, i]
        layouts.mocap_quat[worldid, i] = layouts.mocap_quat[row, i]
    for i in range(layouts.place.shape[1]):
        layouts.place[worldid, i] = layouts.place[row, i]
        layouts.bounds[worldid, i] = layouts.bounds[row, i]
    for i in range(layouts.grasp.shape[1]):
        layouts.grasp[worldid, i] = layouts.grasp[row, i]
        layouts.variant[worldid, i] = layouts.variant[row, i]
        for j in range(layouts.grasp_qpos.shape[2]):
            layouts.grasp_qpos[worldid, i, j] = layouts.grasp_qpos[row, i, j]
            layouts.pregrasp_qpos[worldid, i, j] = layouts.pregrasp_qpos[row, i, j]
    for i in range(layouts.body_pos.shape[1]):
        layouts.body_pos[worldid, i] = layouts.body_pos[row, i]
        layouts.body_quat[worldid, i] = layouts.body_quat[row, i]


@wp.kernel
def _settle(
    program: Program,
    reach: Reach,
    bank_start: wp.array[int],  # the kinds of starts of the bank, if there are some
    split: wp.uint32,
    # Layouts in: qpos, mocap_pos, mocap_quat, attempts, start, grasp, grasp_qpos, pregrasp_qpos, pending_seed,
    #   pending_episode, row_rejections, place, bounds, variant, body_pos, body_quat
    # Layouts out: qpos, mocap_pos, mocap_quat, status, attempts, first_pass_valid, start, present, grasp, grasp_qpos,
    #   pregrasp_qpos, row_rejections, place, bounds, variant, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: pending, restart, ticket, best, row_attempts, worlds_left, restarts_at_once
    # Search out: pending, restart, waiting, worlds_left
    search: Search,
):
    worldid = wp.tid()
    if not search.pending[worldid]:
        return
    first = search.restart[worldid]
    best = int(search.best[worldid])
    placed = best >= 0 and best < NEVER
    if best < 0:  # this restart has no start that is clear, and ends the round
        best = -1 - best
    last = wp.min(wp.min(first + search.restarts_at_once[0] - 1, program.restarts), best)
    row = worldid
    for i in range(last - first + 1):
        row = row_of_restart(search, worldid, i)
        _count_row(layouts, search, worldid, row)
    search.restart[worldid] = last + 1
    for i in range(search.restarts_at_once[0]):
        search.waiting[row_of_restart(search, worldid, i)] = False
    sound = True
    if placed:
        sound = is_sound(program, layouts, row)
    if placed and sound:
        if row != worldid:
            _copy_row(layouts, row, worldid)
        layouts.status[worldid] = Status.VALID
        layouts.first_pass_valid[worldid] = wp.where(best == 0, 1, 0)
        search.pending[worldid] = False
    elif last == program.restarts or not sound:
        if not sound:
            layouts.row_rejections[worldid, wp.max(program.nobject - 1, 0), Cause.UNSOUND] += 1
        layouts.status[worldid] = fall_back(program, reach, bank_start, layouts, worldid, split)
        layouts.first_pass_valid[worldid] = 0
        search.pending[worldid] = False
    else:
        wp.atomic_add(search.worlds_left, 0, 1)


def launch_settle(work: Workspace) -> None:
    """End a round: worlds with a layout are done, worlds out of restarts fall back, all others stay pending."""
    bank_start = None if work.starts is None else work.starts.bank_start
    inputs = [work.program, work.reach, bank_start, work.split]
    work.launch(_settle, work.nworld, inputs, work.layouts, work.search)


@wp.func
def count_rejections(made: LayoutsView, worldid: int, obj: int, rejections: wp.array2d[wp.int64]):
    """Add the rejections of an object in a served layout to the running counts."""
    for cause in range(made.row_rejections.shape[2]):
        number = made.row_rejections[worldid, obj, cause]
        if number > 0:
            wp.atomic_add(rejections, obj, cause, wp.int64(number))


@wp.kernel
def _finish(
    mask: wp.array[bool],
    # Layouts in: status, rejections, pending_seed, pending_episode, next_knob, default_knob, row_rejections
    # Layouts out: seed, episode, knob, rejections, next_episode
    layouts: LayoutsView,
):
    worldid, obj = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    if obj == 0:
        close_episode(layouts, layouts, worldid)
    count_rejections(layouts, worldid, obj, layouts.rejections)


def launch_finish(work: Workspace, mask: wp.array | None) -> None:
    """Advance the masked worlds to their pending episodes, all at once, and add up their rejections."""
    work.launch(_finish, (work.nworld, work.layouts.rejections.shape[0]), [mask], work.layouts)
