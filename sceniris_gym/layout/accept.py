"""Candidates are accepted: the lowest trial that passed every test stays, and its row goes on to the next object."""

import warp as wp

from sceniris_gym.layout.groups import next_object
from sceniris_gym.layout.kinematics import write_root
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.search import Search, queue_row
from sceniris_gym.program.device import Cause, ObjectKind, Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False})

_STATIC = wp.constant(int(ObjectKind.STATIC))
_NONE = wp.constant(int(Cause.NONE))
_EMPTY = wp.constant(int(Cause.EMPTY))
_REGION = wp.constant(int(Cause.REGION))
_COLLISION = wp.constant(int(Cause.COLLISION))


@wp.func
def _write_state(
    program: Program,
    search: Search,
    c: int,
    obj: int,
    qpos: wp.array(dtype=float),
    mocap_pos: wp.array(dtype=wp.vec3),
    mocap_quat: wp.array(dtype=wp.quat),
):
    """Write a candidate's joints and the pose of its root."""
    for i in range(program.obj_drawadr[obj], program.obj_drawadr[obj] + program.obj_drawnum[obj]):
        adr = program.draw_qposadr[i]
        qpos[adr] = search.qpos[c, adr]
    for i in range(program.obj_followadr[obj], program.obj_followadr[obj] + program.obj_follownum[obj]):
        adr = program.follow_qposadr[i]
        qpos[adr] = search.qpos[c, adr]
    if program.obj_kind[obj] == _STATIC:
        return
    root = program.obj_body[obj]
    write_root(program, obj, search.body_pos[c, root], search.body_quat[c, root], qpos, mocap_pos, mocap_quat)


@wp.func
def _place(program: Program, reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int, obj: int):
    """Write a candidate into its row."""
    _write_state(program, search, c, obj, layouts.qpos[row], layouts.mocap_pos[row], layouts.mocap_quat[row])
    for i in range(program.obj_bodyadr[obj], program.obj_bodyadr[obj] + program.obj_bodynum[obj]):
        body = program.body_list[i]
        layouts.body_pos[row, body] = search.body_pos[c, body]
        layouts.body_quat[row, body] = search.body_quat[c, body]
    slot = program.obj_slot[obj]
    if program.obj_kind[obj] != _STATIC:
        layouts.place[row, slot] = search.place[c]
        layouts.bounds[row, slot] = search.bounds[c]
    elif program.obj_measured[obj] != 0:
        layouts.bounds[row, slot] = search.bounds[c]
    if reach.obj_reach.shape[0] > 0:
        column = reach.obj_reach[obj]
        if column >= 0:
            layouts.variant[row, column] = search.turn[c].variant
            layouts.grasp[row, column] = search.grasp[c]


@wp.func
def _record(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int):
    """Keep a candidate that was rejected for collision, as long as there is room for it."""
    slot = wp.atomic_add(layouts.rejected_count, 0, 1)
    if slot >= layouts.rejected_object.shape[0]:
        return
    layouts.rejected_object[slot] = obj
    for i in range(layouts.qpos.shape[1]):
        layouts.rejected_qpos[slot, i] = layouts.qpos[row, i]
    for i in range(layouts.mocap_pos.shape[1]):
        layouts.rejected_mocap_pos[slot, i] = layouts.mocap_pos[row, i]
        layouts.rejected_mocap_quat[slot, i] = layouts.mocap_quat[row, i]
    _write_state(
        program,
        search,
        c,
        obj,
        layouts.rejected_qpos[slot],
        layouts.rejected_mocap_pos[slot],
        layouts.rejected_mocap_quat[slot],
    )


@wp.func
def _count_rejection(layouts: LayoutsView, search: Search, row: int, obj: int, cause: int):
    """Count a rejection: at once in the row of a world, else in case the row's restart is reached."""
    nworld = search.pending.shape[0]
    if row < nworld:
        wp.atomic_add(layouts.rejections, obj, cause, 1)
    else:
        search.row_rejections[row - nworld, obj, cause] += 1


@wp.func
def _go_on(search: Search, row: int, trial: int):
    """Queue a row for its next trial, unless an earlier restart of its world has placed everything already."""
    search.row_trial[row] = trial
    if search.best[search.row_world[row]] > search.row_restart[row]:
        queue_row(search, row)


@wp.func
def _leaves_nothing(cause: int) -> bool:
    """Was nothing of the region left to draw from?"""
    if cause == _EMPTY:
        return True
    return cause == _REGION


@wp.func
def _accept_first(
    program: Program, reach: Reach, layouts: LayoutsView, search: Search, row: int, first: int, trials: int
) -> int:
    """Place the first of a row's candidates that passed. Returns the row's next trial, 0 if one was placed."""
    obj = search.row_object[row]
    for t in range(trials):
        cause = search.cause[first + t]
        search.row_attempts[row] += 1
        if cause == _NONE:
            _place(program, reach, layouts, search, first + t, row, obj)
            return 0
        _count_rejection(layouts, search, row, obj, cause)
        if cause == _COLLISION and layouts.rejected_object.shape[0] > 0:
            _record(program, layouts, search, first + t, row, obj)
        # what no draw of the object itself can open, only a new start can
        if program.obj_retry_if_empty[obj] == 0 and _leaves_nothing(cause):
            return program.attempts
    return search.row_trial[row] + trials


@wp.kernel(grid_stride=False)
def _accept(
    program: Program,
    reach: Reach,
    lanes: int,
    # Layouts in and out:
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    if wp.tid() == 0:
        search.candidates[0] = 0  # of the next wave
    for i in range(wp.tid(), search.rows[0], lanes):
        row = search.queue[search.source[0], i]
        trials = search.row_trials[row]
        if trials == 0:  # the wave had no room for it
            _go_on(search, row, search.row_trial[row])
            continue
        trial = _accept_first(program, reach, layouts, search, row, search.row_first[row], trials)
        if trial == 0:
            obj = next_object(program, reach, layouts, row, search.row_object[row] + 1)
            search.row_object[row] = obj
            if obj == program.nobject:
                wp.atomic_min(search.best, search.row_world[row], search.row_restart[row])
        if search.row_object[row] < program.nobject and trial < program.attempts:
            _go_on(search, row, trial)


def launch_accept(
    program: Program, reach: Reach, lanes: int, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Accept the candidates of this wave that passed every test."""
    wp.launch(_accept, dim=lanes, inputs=[program, reach, lanes], outputs=[layouts, search], device=device)
