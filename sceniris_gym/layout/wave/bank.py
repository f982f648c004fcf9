"""The bank of valid layouts on the device, which worlds that run out of restarts fall back on.

Each split has rows of its own, so that an evaluation never gets a layout that training may have seen.
"""

import warp as wp

from sceniris_gym.device.random import BANK_STREAM, SPLITS, philox
from sceniris_gym.layout.layouts import LayoutsView, Status
from sceniris_gym.layout.wave.search import numbered_stream
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False})

_EVAL = wp.constant(wp.uint32(SPLITS["eval"]))


@wp.func
def _bank_row(program: Program, bank_start: wp.array[int], layouts: LayoutsView, worldid: int, split: wp.uint32) -> int:
    """Return the world's entry of its split's bank; -1 while the bank of the scene is still being filled.

    In scenes with kinds of starts it is the next one from there of the world's kind, if there is one.
    """
    first = int(0)
    num = program.bank_ntrain
    if split == _EVAL:
        first = program.bank_ntrain
        num = program.bank_qpos.shape[0] - first
    if num == 0:
        return -1
    stream = numbered_stream(split, BANK_STREAM)
    words = philox(
        layouts.pending_seed[worldid],
        wp.vec4ui(wp.uint32(layouts.pending_episode[worldid]), stream, wp.uint32(0), wp.uint32(0)),
    )
    row = int(words[0] % wp.uint32(num))
    if bank_start:
        for i in range(num):
            if bank_start[first + (row + i) % num] == layouts.start[worldid]:
                return first + (row + i) % num
    return first + row


@wp.func
def _take(program: Program, layouts: LayoutsView, worldid: int, row: int):
    """Copy an entry of the bank into a world."""
    for i in range(layouts.qpos.shape[1]):
        layouts.qpos[worldid, i] = program.bank_qpos[row, i]
    for i in range(program.bank_mocap_pos.shape[1]):
        layouts.mocap_pos[worldid, i] = program.bank_mocap_pos[row, i]
        q = program.bank_mocap_quat[row, i]
        layouts.mocap_quat[worldid, i] = wp.quat(q[0], q[1], q[2], q[3])
    for i in range(layouts.present.shape[1]):
        layouts.present[worldid, i] = program.bank_present[row, i]


@wp.func
def _take_grasps(reach: Reach, layouts: LayoutsView, worldid: int, row: int):
    """Copy the grasps of an entry of the bank into a world."""
    for r in range(layouts.grasp.shape[1]):
        layouts.grasp[worldid, r] = reach.bank_grasp[row, r]
        for i in range(layouts.grasp_qpos.shape[2]):
            layouts.grasp_qpos[worldid, r, i] = reach.bank_grasp_qpos[row, r, i]
            layouts.pregrasp_qpos[worldid, r, i] = reach.bank_pregrasp_qpos[row, r, i]


@wp.func
def fall_back(
    program: Program, reach: Reach, bank_start: wp.array[int], layouts: LayoutsView, worldid: int, split: wp.uint32
) -> int:
    """Copy the world's entry of the bank, and return the status of its row."""
    row = _bank_row(program, bank_start, layouts, worldid, split)
    if row < 0:
        return 0
    _take(program, layouts, worldid, row)
    _take_grasps(reach, layouts, worldid, row)
    if bank_start:
        layouts.start[worldid] = bank_start[row]
    return Status.FALLBACK
