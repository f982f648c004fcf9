"""Accept candidates: place the valid trial with the lowest number in each row, and move the row to its next object."""

import warp as wp

from sceniris_gym.device.blocks import block_sync
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.groups import next_object
from sceniris_gym.layout.wave.search import Search, Workspace, finish_row, queue_row
from sceniris_gym.placement.kinematics import write_root
from sceniris_gym.program.device import Cause, ObjectKind, Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_PLACED = wp.constant(-1)


@wp.func
def _write_state(
    program: Program,
    search: Search,
    c: int,
    obj: int,
    lane: int,
    lanes: int,
    qpos: wp.array[float],
    mocap_pos: wp.array[wp.vec3],
    mocap_quat: wp.array[wp.quat],
):
    """Write a candidate's joints and root pose. Lane `lane` of `lanes` writes its part."""
    for i in range(lane, program.obj_drawnum[obj], lanes):
        adr = program.draw_qposadr[program.obj_drawadr[obj] + i]
        qpos[adr] = search.qpos[c, adr]
    for i in range(lane, program.obj_follownum[obj], lanes):
        adr = program.follow_qposadr[program.obj_followadr[obj] + i]
        qpos[adr] = search.qpos[c, adr]
    if lane > 0 or program.obj_kind[obj] == ObjectKind.STATIC:
        return
    root = program.obj_body[obj]
    write_root(program, obj, search.body_pos[c, root], search.body_quat[c, root], qpos, mocap_pos, mocap_quat)


@wp.func
def place(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    search: Search,
    c: int,
    row: int,
    obj: int,
    lane: int,
    lanes: int,
):
    """Write a candidate into its row. Lane `lane` of `lanes` writes its part."""
    qpos = layouts.qpos[row]
    _write_state(program, search, c, obj, lane, lanes, qpos, layouts.mocap_pos[row], layouts.mocap_quat[row])
    for i in range(lane, program.obj_bodynum[obj], lanes):
        body = program.body_list[program.obj_bodyadr[obj] + i]
        layouts.body_pos[row, body] = search.body_pos[c, body]
        layouts.body_quat[row, body] = search.body_quat[c, body]
    if lane > 0:
        return
    column = program.obj_column[obj]
    if program.obj_kind[obj] != ObjectKind.STATIC:
        layouts.pivot_pose[row, column] = search.pivot_pose[c]
        layouts.bounds[row, column] = search.bounds[c]
    elif program.obj_measured[obj] != 0:
        layouts.bounds[row, column] = search.bounds[c]
    if search.row_surface.shape[1] > 0:
        search.row_surface[row, obj] = search.surface[c]
        search.row_stable[row, obj] = search.stable_draw[c].stable
    if reach.obj_reach.shape[0] > 0:
        column = reach.obj_reach[obj]
        if column >= 0:
            layouts.stable[row, column] = search.stable_draw[c].stable
            layouts.grasp[row, column] = search.grasp[c]
        for i in range(search.free.shape[1]):
            search.row_free[row, i] = search.free[c, i]


@wp.func
def _had_no_region(cause: int) -> bool:
    """Return True if a candidate was rejected for an empty region, or because no drawn point passed the exact test."""
    return cause == Cause.EMPTY or cause == Cause.REGION


@wp.func
def _is_recorded(layouts: LayoutsView, cause: int) -> bool:
    """Return True if a cause is recorded: a collision, or with `record_all` also any cause after a pose was drawn."""
    if layouts.rejected_object.shape[0] == 0 or cause == Cause.NONE:
        return False
    if cause == Cause.COLLISION:
        return True
    return layouts.record_all != 0 and not _had_no_region(cause)


@wp.func
def _record(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int):
    """Record a rejected candidate if the record has room for it."""
    slot = wp.atomic_add(layouts.rejected_count, 0, 1)
    if slot >= layouts.rejected_object.shape[0]:
        return
    layouts.rejected_object[slot] = obj
    layouts.rejected_cause[slot] = search.cause[c]
    qpos = layouts.rejected_qpos[slot]
    pos = layouts.rejected_mocap_pos[slot]
    quat = layouts.rejected_mocap_quat[slot]
    for i in range(layouts.qpos.shape[1]):
        qpos[i] = layouts.qpos[row, i]
    for i in range(layouts.mocap_pos.shape[1]):
        pos[i] = layouts.mocap_pos[row, i]
        quat[i] = layouts.mocap_quat[row, i]
    _write_state(program, search, c, obj, 0, 1, qpos, pos, quat)


@wp.func
def _ends_row(program: Program, obj: int, cause: int) -> bool:
    """Return True if a trial is the object's last trial: the trial passed, or further trials cannot pass."""
    if cause == Cause.NONE:
        return True
    return program.obj_retry_if_empty[obj] == 0 and _had_no_region(cause)


@wp.func
def _accept_first(
    program: Program, reach: Reach, layouts: LayoutsView, search: Search, row: int, obj: int, lane: int, lanes: int
) -> int:
    """Place the first valid candidate of a row's object. Return the object's next trial, or _PLACED.

    Either a single lane calls this, or all lanes of a block call it together.
    """
    first = search.row_first[row]
    trials = search.row_trials[row]
    if obj < search.row_object[row]:  # drawn ahead
        first += obj - search.row_object[row]
        trials = 1
    end = int(trials)  # the lowest trial that ends the object, independent of the number of parallel trials
    for t in range(lane, trials, lanes):
        if t < end and _ends_row(program, obj, search.cause[first + t]):
            end = t
    if lanes > 1:
        end = wp.tile_extract(wp.tile_min(wp.tile(end)), 0)
    for t in range(lane, wp.min(end + 1, trials), lanes):
        cause = search.cause[first + t]
        if cause != Cause.NONE:
            wp.atomic_add(layouts.row_rejections, row, obj, cause, 1)
        if _is_recorded(layouts, cause):
            _record(program, layouts, search, first + t, row, obj)
    if lane == 0:
        search.row_attempts[row] += wp.min(end + 1, trials)
    if end == trials:
        return search.row_trial[row] + trials
    if search.cause[first + end] != Cause.NONE:
        return program.attempts
    if obj == search.row_object[row]:  # objects drawn ahead are already placed
        place(program, reach, layouts, search, first + end, row, obj, lane, lanes)
    return _PLACED


@wp.func
def _advance(program: Program, reach: Reach, layouts: LayoutsView, search: Search, row: int, trial: int, staged: bool):
    """Queue a row for the next trial of its object, or for its next object. Finish a row if all objects are placed.

    The row ends without a layout if the trials run out, or if an earlier restart of its world has finished. `trial` is
    the object's next trial, or _PLACED. `staged` is as in `finish_row`.
    """
    following = int(trial)
    if trial == _PLACED:
        search.row_object[row] = next_object(program, reach, layouts, row, search.row_object[row] + 1)
        following = 0
    search.row_trial[row] = following
    if search.row_object[row] == program.nobject:
        finish_row(search, row, staged)
    elif following < program.attempts and search.best[search.row_world[row]] > search.row_restart[row]:
        queue_row(program, search, row, 0)


@wp.kernel(grid_stride=False)
def _accept(
    blocks: int,
    program: Program,
    reach: Reach,
    staged: bool,
    # Layouts in: present, record_all; out: grasp, stable, pivots*, record*; both: state*, row_rejections, bodies*,
    #   rejected_count
    layouts: LayoutsView,
    # Search in: restarts*, busy, source, rows, rows_before, cause, stable_draw, surface, grasp, free, pivots*, poses*;
    #   out: waiting, row_free, placed*, cutting, trials*; both: best, row_object, row_trial, row_attempts, queue,
    #   shares*, rows_left, opened
    search: Search,
):
    block, lane = wp.tid()
    # A block per row is faster for few rows, and a lane per row for many rows.
    first = int(block)
    step = int(blocks)
    lanes = int(wp.block_dim())
    if search.rows[0] > blocks:
        first = block * lanes + lane
        step = blocks * lanes
        lane = 0
        lanes = 1
    for i in range(first, search.rows[0], step):
        row = search.queue[search.source[0], i]
        obj = search.row_object[row] - search.row_ahead[row] - 1
        trial = int(_PLACED)
        while trial == _PLACED and obj < search.row_object[row]:
            obj += 1
            trial = _accept_first(program, reach, layouts, search, row, obj, lane, lanes)
        if lanes > 1:
            block_sync()  # lane 0 changes the row only after all lanes have finished with it
        if lane == 0:
            search.row_object[row] = obj
            _advance(program, reach, layouts, search, row, trial, staged)


def launch_accept(work: Workspace, staged: bool) -> None:
    """Place the valid candidates of this wave, and queue the rows that continue."""
    work.launch_blocks(_accept, work.program, work.reaches[0], staged, work.layouts, work.search)
