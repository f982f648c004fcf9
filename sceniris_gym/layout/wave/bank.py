"""The bank of valid layouts on the device, which worlds that run out of restarts fall back on.

Each split has rows of its own, so that an evaluation never gets a layout that training may have seen.
"""

import warp as wp

from sceniris_gym.device.random import BANK_BIT, BANK_STREAM, SPLITS, philox
from sceniris_gym.layout.layouts import LayoutsView, Status, copy_layout
from sceniris_gym.layout.wave.search import numbered_stream
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_bank import Bank

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_EVAL = wp.constant(wp.uint32(SPLITS["eval"]))
_BANK_BIT = wp.constant(BANK_BIT)
# Distances for another kind of start, and for an object of a group with one present member. Of other groups it is 1.
_KIND, _ONLY, _FURTHEST = wp.constant(1 << 24), wp.constant(1 << 12), wp.constant((1 << 31) - 1)


@wp.func
def _difference(program: Program, bank: Bank, layouts: LayoutsView, worldid: int, row: int, most: int) -> int:
    """Return how far an entry of the bank is from the draw of a world, `most` at most."""
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
    """Return the world's entry of its split's bank; -1 while the bank of the scene is still being filled.

    It is the next entry, from a random one on, of those nearest to the draw of the world: by the kind of start, then by
    groups with one present member, such as variants, then by other groups.
    """
    first = int(0)
    num = bank.ntrain
    if split == _EVAL:
        first = bank.ntrain
        num = bank.qpos.shape[0] - first
    if num == 0:
        return -1
    stream = numbered_stream(split, BANK_STREAM)
    words = philox(
        layouts.pending_seed[worldid],
        wp.vec4ui(wp.uint32(layouts.pending_episode[worldid]), stream, wp.uint32(0), wp.uint32(0)),
    )
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
def fall_back(program: Program, bank: Bank, layouts: LayoutsView, worldid: int, split: wp.uint32, width: int) -> int:
    """Copy the world's entry of the bank with the key of its draws, and return the status of its row."""
    row = _bank_row(program, bank, layouts, worldid, split)
    if row < 0:
        return 0
    for i in range(width):
        copy_layout(bank, row, layouts, worldid, i)
    layouts.draw_seed[worldid] = bank.seed[row]
    layouts.draw_episode[worldid] = bank.episode[row]
    layouts.draw_stream[worldid] = layouts.stream | _BANK_BIT
    return Status.FALLBACK
