"""Kinds of starts while placing: the kind of each world, joints that it draws otherwise, and objects at markers.

The kind belongs to the episode, not to a restart: otherwise restarts would favour kinds that are easier to place.
"""

import warp as wp

from sceniris_gym.device.random import START_STREAM, uniforms
from sceniris_gym.layout.layouts import LayoutsView, knobs_differ
from sceniris_gym.layout.wave.draw import draw_static
from sceniris_gym.layout.wave.posing import pose_candidate
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num, numbered_stream, stream_of, trial_of
from sceniris_gym.placement.kinematics import follow_joints, joint_uniform
from sceniris_gym.placement.measure import measure
from sceniris_gym.program.device import Cause, ObjectKind, Program
from sceniris_gym.program.device_starts import Starts, is_drawn

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _weighted_kind(layouts: LayoutsView, worldid: int, column: int, num: int, u: float, usual: int) -> int:
    """Return the kind at share `u` of the weights that knobs give; the usual one where these are as in the file."""
    if not knobs_differ(layouts, worldid, column, num):
        return usual
    total = float(0.0)
    for k in range(column, column + num):
        total += layouts.next_knob[worldid, k]
    kind = int(0)
    below = layouts.next_knob[worldid, column]
    while kind < num - 1 and u * total >= below:
        kind += 1
        below += layouts.next_knob[worldid, column + kind]
    return kind


@wp.kernel
def _draw_kinds(
    starts: Starts,
    mask: wp.array[bool],
    split: wp.uint32,
    column: int,
    # Layouts in: pending_seed, pending_episode, next_knob, default_knob
    # Layouts out: start
    layouts: LayoutsView,
):
    worldid = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    stream = numbered_stream(split, START_STREAM)
    u = uniforms(layouts.pending_seed[worldid], layouts.pending_episode[worldid], stream, 0, 0)[0]
    kind = int(0)
    while kind < starts.cdf.shape[0] - 1 and u >= starts.cdf[kind]:
        kind += 1
    if column >= 0:
        kind = _weighted_kind(layouts, worldid, column, starts.cdf.shape[0], u, kind)
    layouts.start[worldid] = kind


def launch_draw_kinds(work: Workspace, starts: Starts, mask: wp.array | None, column: int = -1) -> None:
    """Draw the kind of start of the masked worlds, once they have their pending episodes.

    Args:
        work: The arrays of the generator.
        starts: The kinds.
        mask: Which worlds, shape (nworld,), bool; all if None.
        column: First column of their weights in a row of knobs, -1 for none.
    """
    work.launch(_draw_kinds, work.nworld, [starts, mask, work.split, column], work.layouts)


@wp.kernel(grid_stride=False)
def _redraw_joints(
    program: Program,
    starts: Starts,
    split: wp.uint32,
    lanes: int,
    # Layouts in: start, present, pending_seed, pending_episode, place
    layouts: LayoutsView,
    # Search in: row_world, row_restart, candidates, row, obj, trial, cause, turn, heading, point, qpos, body_pos,
    #   body_quat
    # Search out: turn, place, bounds, grasp, covered, overhanging, qpos, body_pos, body_quat
    search: Search,
):
    for c in range(wp.tid(), candidate_num(search), lanes):
        row = search.row[c]
        obj = search.obj[c]
        worldid = search.row_world[row]
        kind = layouts.start[worldid]
        seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
        stream, trial = stream_of(program, split, obj), trial_of(program, search, c)
        adr = program.obj_drawadr[obj]
        drawn = bool(False)
        for i in range(program.obj_drawnum[obj]):
            interval = starts.draw_range[kind, adr + i]
            if is_drawn(interval):
                u = joint_uniform(seed, episode, stream, trial, i)
                search.qpos[c, program.draw_qposadr[adr + i]] = interval[0] + u * (interval[1] - interval[0])
                drawn = True
        if not drawn:
            continue
        follow_joints(program, obj, search.qpos[c])
        if program.obj_kind[obj] == ObjectKind.STATIC:
            draw_static(program, layouts, search, c, row, obj)
            continue
        if program.obj_measured[obj] != 0:
            turn = measure(program, obj, search.turn[c], search.qpos[c], search.body_pos[c], search.body_quat[c])
            search.turn[c] = turn
        if program.obj_cutnum[obj] == 0 and search.cause[c] == Cause.NONE:
            pose_candidate(program, layouts, search, c, row, obj)


def launch_redraw_joints(work: Workspace, starts: Starts) -> None:
    """Draw the joints of this wave's candidates that their kind of start draws from other intervals."""
    lanes = work.size.lanes
    work.launch(_redraw_joints, lanes, [work.program, starts, work.split, lanes, work.layouts], work.search)


@wp.kernel(grid_stride=False)
def _put_at_markers(
    program: Program,
    starts: Starts,
    lanes: int,
    # Layouts in: start, present, place
    layouts: LayoutsView,
    # Search in: row_world, row_surface, candidates, row, obj, turn, heading, point, qpos, body_pos, body_quat
    # Search out: cause, point, surface, place, bounds, grasp, covered, overhanging, body_pos, body_quat
    search: Search,
):
    for c in range(wp.tid(), candidate_num(search), lanes):
        row = search.row[c]
        obj = search.obj[c]
        marker = starts.marker[layouts.start[search.row_world[row]], obj]
        if marker < 0:
            continue
        place = layouts.place[row, program.obj_place[marker]]
        point = wp.vec3(place[0], place[1], place[2] - program.obj_gap[marker])
        search.cause[c] = Cause.NONE
        search.point[c] = point
        search.surface[c] = search.row_surface[row, marker]
        pose_candidate(program, layouts, search, c, row, obj)


def launch_put_at_markers(work: Workspace, starts: Starts) -> None:
    """Move the candidates of this wave that their kind of start places at a marker there."""
    lanes = work.size.lanes
    work.launch(_put_at_markers, lanes, [work.program, starts, lanes, work.layouts], work.search)
