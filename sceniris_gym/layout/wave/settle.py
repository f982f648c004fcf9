"""End of a round: each world takes its lowest-numbered finished restart, falls back, or waits for the next round.

The lanes of a block add up the counts of a world's rows together, and copy the finished row together. Worlds that run
out of restarts fall back to the bank of valid layouts. The bank has separate rows for each split, so that an evaluation
never gets a layout that training may have seen. Every served layout is finite and within the scene's bounds, with unit
quaternions. Checks on the host reject scenes that are known to break this rule. `is_sound` rejects layouts that break
it for an unknown cause.
"""

import warp as wp

from sceniris_gym.device.blocks import block_any
from sceniris_gym.device.random import BANK_BIT, BANK_STREAM, SPLITS, philox
from sceniris_gym.layout.layouts import LayoutStatus, LayoutsView, copy_layout, layout_width
from sceniris_gym.layout.wave.rounds import NEVER, await_round, row_of_restart
from sceniris_gym.layout.wave.search import Search, Workspace, flip_failed, numbered_stream
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_bank import Bank

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Tolerance of the squared norm of a quaternion. Single precision keeps it to a few times 1e-7.
_UNIT = wp.constant(1.0e-4)


@wp.func
def _is_unit(w: float, x: float, y: float, z: float) -> bool:
    # comparisons with NaN are false
    return wp.abs(w * w + x * x + y * y + z * z - 1.0) <= _UNIT


@wp.func
def is_sound(program: Program, layouts: LayoutsView, row: int, lane: int, lanes: int) -> bool:
    """Return True if a row may be served: it is within the scene's bounds, with unit quaternions.

    Lane `lane` of `lanes` checks its part of the row.
    """
    for i in range(lane, layouts.qpos.shape[1], lanes):
        if not (wp.abs(layouts.qpos[row, i]) <= program.bound_qpos[i]):
            return False
    for i in range(lane, program.quat_qposadr.shape[0], lanes):
        adr = program.quat_qposadr[i]
        qpos = layouts.qpos[row]
        if not _is_unit(qpos[adr], qpos[adr + 1], qpos[adr + 2], qpos[adr + 3]):
            return False
    for i in range(lane, program.bound_mocap.shape[0], lanes):
        pos = layouts.mocap_pos[row, i]
        far = wp.abs(pos[0]) + wp.abs(pos[1]) + wp.abs(pos[2])  # a maximum would ignore NaN
        q = layouts.mocap_quat[row, i]
        if not (far <= program.bound_mocap[i]) or not _is_unit(q[0], q[1], q[2], q[3]):
            return False
    return True


_EVAL = wp.constant(wp.uint32(SPLITS["eval"]))
_BANK_BIT = wp.constant(BANK_BIT)
# Distance of a bank entry with another kind of start, and distance for each differing object of a group with one
# present member. Each differing object of another group adds 1.
_KIND, _ONLY, _FURTHEST = wp.constant(1 << 24), wp.constant(1 << 12), wp.constant((1 << 31) - 1)


@wp.func
def _difference(program: Program, bank: Bank, layouts: LayoutsView, worldid: int, row: int, most: int) -> int:
    """Return how much a bank entry differs from the group members and the kind of start drawn for a world.

    The result grows with each group member that is present only in the entry or only in the world, and with a different
    kind of start. It is at most `most`.
    """
    found = wp.where(bank.start[row] == layouts.start[worldid], 0, _KIND)
    for g in range(program.ngroup):
        group = program.group[worldid, g]
        for i in range(group[0], group[0] + group[1]):
            if layouts.present[worldid, program.group_slot[i]] != bank.present[row, program.group_slot[i]]:
                found += wp.where(group[2] == 1 and group[3] == 1, _ONLY, 1)
            if found >= most:
                return most
    return found


@wp.func
def _bank_row(program: Program, bank: Bank, layouts: LayoutsView, worldid: int, split: wp.uint32) -> int:
    """Return a bank entry of the world's split, or -1 during compilation, while the bank is empty.

    The search begins at a random entry, and returns the first of the entries with the least `_difference`. The kind of
    start counts most, then groups with one present member, such as variants, then other groups.
    """
    first = int(0)
    num = bank.ntrain
    if split == _EVAL:
        first = bank.ntrain
        num = bank.qpos.shape[0] - first
    if num == 0:
        return -1
    stream = numbered_stream(split, BANK_STREAM)
    counter = wp.vec4ui(wp.uint32(layouts.pending_episode[worldid]), stream, wp.uint32(0), wp.uint32(0))
    words = philox(layouts.pending_seed[worldid], counter)
    row = int(words[0] % wp.uint32(num))
    nearest = int(0)
    most = int(_FURTHEST)
    for i in range(num):
        found = _difference(program, bank, layouts, worldid, first + (row + i) % num, most)
        if found < most:
            nearest = i
            most = found
    return first + (row + nearest) % num


@wp.func
def _fall_back(program: Program, bank: Bank, layouts: LayoutsView, worldid: int, split: wp.uint32, width: int) -> int:
    """Copy a bank entry and the key of its draws to a world, and return the new status of the world."""
    row = _bank_row(program, bank, layouts, worldid, split)
    if row < 0:
        return 0
    for i in range(width):
        copy_layout(bank, row, layouts, worldid, i)
    layouts.draw_seed[worldid] = bank.seed[row]
    layouts.draw_episode[worldid] = bank.episode[row]
    layouts.draw_stream[worldid] = layouts.stream | _BANK_BIT
    return LayoutStatus.FALLBACK


@wp.func
def _count_row(layouts: LayoutsView, search: Search, worldid: int, row: int, lane: int, lanes: int):
    """Add the attempts and rejections of a restart to the counts of its world."""
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
    for i in range(lane, layouts.pivot_pose.shape[1], lanes):
        layouts.pivot_pose[worldid, i] = layouts.pivot_pose[row, i]
        layouts.bounds[worldid, i] = layouts.bounds[row, i]
    for i in range(lane, layouts.stable.shape[1], lanes):
        layouts.stable[worldid, i] = layouts.stable[row, i]
    for i in range(lane, layouts.body_pos.shape[1], lanes):
        layouts.body_pos[worldid, i] = layouts.body_pos[row, i]
        layouts.body_quat[worldid, i] = layouts.body_quat[row, i]


@wp.kernel(grid_stride=False)
def _settle(
    blocks: int,
    program: Program,
    bank: Bank,
    split: wp.uint32,
    width: int,
    # Layouts in: pending*, stream; out: draws*, status, first_pass_valid; both: state*, choices*, grasps*, attempts,
    #   row_rejections, stable, pivots*, bodies*
    layouts: LayoutsView,
    # Search in: row_attempts, restarts_at_once; out: waiting; both: worlds*, worlds_left
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
        if best < 0:  # this restart's start is not clear, which ends the round
            best = flip_failed(best)
        # restarts after the best do not count, because the counts would depend on the number of parallel restarts
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
            layouts.status[worldid] = LayoutStatus.VALID
            layouts.first_pass_valid[worldid] = wp.where(best == 0, 1, 0)
            search.pending[worldid] = False
        elif last == program.restarts or unsound != 0:
            if unsound != 0:
                layouts.row_rejections[worldid, wp.max(program.nobject - 1, 0), Cause.UNSOUND] += 1
            layouts.status[worldid] = _fall_back(program, bank, layouts, worldid, split, width)
            layouts.first_pass_valid[worldid] = 0
            search.pending[worldid] = False
        else:
            await_round(search, worldid)


def launch_settle(work: Workspace) -> None:
    """End a round: worlds with a layout are finished, worlds out of restarts fall back, others stay pending."""
    inputs = [work.program, work.compiled.bank, work.split, layout_width(work.layouts), work.layouts, work.search]
    work.launch_blocks(_settle, *inputs, blocks=min(work.size.blocks, work.nworld))
