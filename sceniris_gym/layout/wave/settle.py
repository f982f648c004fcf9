"""End of a round: worlds take the layout of their lowest restart that is done, fall back, or await the next round.

The lanes of a block share the counts and the copy of a world's rows.
"""

import warp as wp

from sceniris_gym.device.blocks import block_any
from sceniris_gym.layout.layouts import LayoutsView, Status, copy_layout, layout_width
from sceniris_gym.layout.wave.bank import fall_back
from sceniris_gym.layout.wave.rounds import NEVER, await_round, row_of_restart
from sceniris_gym.layout.wave.search import Search, Workspace
from sceniris_gym.layout.wave.soundness import is_sound
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_bank import Bank

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _count_row(layouts: LayoutsView, search: Search, worldid: int, row: int, lane: int, lanes: int):
    """Add the attempts and rejections of a restart to those of its world."""
    if lane == 0:
        layouts.attempts[worldid] += search.row_attempts[row]
    if row != worldid:
        causes = layouts.row_rejections.shape[2]
        for i in range(lane, layouts.row_rejections.shape[1] * causes, lanes):
            obj, cause = i // causes, i % causes
            layouts.row_rejections[worldid, obj, cause] += layouts.row_rejections[row, obj, cause]


@wp.func
def _copy_row(layouts: LayoutsView, row: int, worldid: int, width: int, lane: int, lanes: int):
    """Copy a finished row into the row of its world."""
    for i in range(lane, width, lanes):
        copy_layout(layouts, row, layouts, worldid, i)
    for i in range(lane, layouts.place.shape[1], lanes):
        layouts.place[worldid, i] = layouts.place[row, i]
        layouts.bounds[worldid, i] = layouts.bounds[row, i]
    for i in range(lane, layouts.variant.shape[1], lanes):
        layouts.variant[worldid, i] = layouts.variant[row, i]
    for i in range(lane, layouts.body_pos.shape[1], lanes):
        layouts.body_pos[worldid, i] = layouts.body_pos[row, i]
        layouts.body_quat[worldid, i] = layouts.body_quat[row, i]


@wp.kernel(grid_stride=False)
def _settle(
    program: Program,
    bank: Bank,
    split: wp.uint32,
    width: int,
    blocks: int,
    # Layouts in: qpos, mocap_pos, mocap_quat, attempts, start, present, grasp, grasp_qpos, pregrasp_qpos, stream,
    #   pending_seed, pending_episode, row_rejections, place, bounds, variant, body_pos, body_quat
    # Layouts out: qpos, mocap_pos, mocap_quat, status, attempts, first_pass_valid, start, present, grasp, grasp_qpos,
    #   pregrasp_qpos, draw_seed, draw_episode, draw_stream, row_rejections, place, bounds, variant, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: pending, restart, ticket, best, row_attempts, worlds_left, restarts_at_once
    # Search out: pending, restart, ticket, best, waiting, worlds_left
    search: Search,
):
    block, lane = wp.tid()
    lanes = wp.block_dim()
    for worldid in range(block, search.pending.shape[0], blocks):
        if not search.pending[worldid]:
            continue
        first = search.restart[worldid]
        best = int(search.best[worldid])
        placed = best >= 0 and best < NEVER
        if best < 0:  # this restart has no start that is clear, and ends the round
            best = -1 - best
        last = wp.min(wp.min(first + search.restarts_at_once[0] - 1, program.restarts), best)
        row = int(worldid)
        for i in range(last - first + 1):
            row = row_of_restart(search, worldid, i)
            _count_row(layouts, search, worldid, row, lane, lanes)
        unsound = block_any(int(placed and not is_sound(program, layouts, row, lane, lanes)))
        if placed and unsound == 0 and row != worldid:
            _copy_row(layouts, row, worldid, width, lane, lanes)
        if lane > 0:
            continue
        for i in range(search.restarts_at_once[0]):
            search.waiting[row_of_restart(search, worldid, i)] = False
        search.restart[worldid] = last + 1
        if placed and unsound == 0:
            layouts.status[worldid] = Status.VALID
            layouts.first_pass_valid[worldid] = wp.where(best == 0, 1, 0)
            search.pending[worldid] = False
        elif last == program.restarts or unsound != 0:
            if unsound != 0:
                layouts.row_rejections[worldid, wp.max(program.nobject - 1, 0), Cause.UNSOUND] += 1
            layouts.status[worldid] = fall_back(program, bank, layouts, worldid, split, width)
            layouts.first_pass_valid[worldid] = 0
            search.pending[worldid] = False
        else:
            await_round(search, worldid)


def launch_settle(work: Workspace) -> None:
    """End a round: worlds with a layout are done, worlds out of restarts fall back, all others stay pending."""
    inputs = [work.program, work.bank, work.split, layout_width(work.layouts), work.size.blocks]
    work.launch_blocks(_settle, inputs, work.layouts, work.search)
