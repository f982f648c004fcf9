"""Draw the kind of start of each world. Write the kind's joint intervals, and place objects at the kind's markers.

The kind belongs to the episode, not to a restart. Otherwise restarts would favour kinds that are easier to place.
"""

import warp as wp

from sceniris_gym.device.random import START_STREAM, uniforms
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.masks import selects
from sceniris_gym.layout.wave.posing import pose_candidate
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num, numbered_stream
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Starts, is_drawn

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _draw_kinds(
    program: Program,
    starts: Starts,
    mask: wp.array[bool],
    split: wp.uint32,
    # Layouts in: pending*; out: start
    layouts: LayoutsView,
    # Out, by world:
    draw_range: wp.array2d[wp.vec2],
):
    worldid = wp.tid()
    if not selects(mask, worldid):
        return
    stream = numbered_stream(split, START_STREAM)
    u = uniforms(layouts.pending_seed[worldid], layouts.pending_episode[worldid], stream, 0, 0)[0]
    total = float(0.0)
    for k in range(program.start_weight.shape[1]):
        total += program.start_weight[worldid, k]
    kind = int(0)
    below = program.start_weight[worldid, 0]
    while kind < program.start_weight.shape[1] - 1 and u * total >= below:
        kind += 1
        below += program.start_weight[worldid, kind]
    layouts.start[worldid] = kind
    for i in range(starts.draw_range.shape[1]):
        if is_drawn(starts.draw_range[kind, i]):
            draw_range[worldid, i] = starts.draw_range[kind, i]


def launch_draw_kinds(work: Workspace, mask: wp.array | None) -> None:
    """Draw the kind of start of the masked worlds.

    The draw depends on `pending_seed` and `pending_episode`, so set these before the call.

    Args:
        work: The arrays of the generator. If a kind of start draws joints, `program.draw_range` should have a row per
            world.
        mask: Selected worlds, shape (nworld,), bool. None selects all.
    """
    inputs = [work.program, work.compiled.starts, mask, work.split, work.layouts, work.program.draw_range]
    work.launch(_draw_kinds, work.nworld, *inputs)


@wp.kernel(grid_stride=False)
def _put_at_markers(
    lanes: int,
    program: Program,
    starts: Starts,
    end: int,
    # Layouts in: choices*, pivot_pose, body_quat
    layouts: LayoutsView,
    # Search in: row_world, row_surface, candidates, row, obj, stable_draw, heading, qpos; out: cause, surface, grasp,
    #   pivots*, flags*; both: point, body_pos, body_quat
    search: Search,
):
    for c in range(wp.tid(), candidate_num(search), lanes):
        obj = search.obj[c]
        if obj >= end:
            continue
        row = search.row[c]
        marker = starts.marker[layouts.start[search.row_world[row]], obj]
        if marker < 0 or layouts.present[row, program.obj_slot[wp.max(marker, 0)]] == 0:
            continue
        pivot_pose = layouts.pivot_pose[row, program.obj_column[marker]]
        point = wp.vec3(pivot_pose[0], pivot_pose[1], pivot_pose[2] - program.obj_gap[marker])
        search.cause[c] = Cause.NONE
        search.point[c] = point
        search.surface[c] = search.row_surface[row, marker]
        pose_candidate(program, layouts, search, c, row, obj)


def launch_put_at_markers(work: Workspace, end: int) -> None:
    """Move candidates of this wave to the markers of their kind of start.

    Only objects with an index below `end` can start at a marker.
    """
    work.launch_lanes(_put_at_markers, work.program, work.compiled.starts, end, work.layouts, work.search)
