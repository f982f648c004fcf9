"""The bank of valid layouts on the device, which worlds that run out of restarts fall back on.

Each split has rows of its own, so that an evaluation never gets a layout that training may have seen.
"""

import warp as wp

from sceniris_gym.device.random import BANK_BIT, BANK_STREAM, SPLITS, philox
from sceniris_gym.layout.layouts import LayoutsView, Status, copy_layout
from sceniris_gym.layout.wave.search import numbered_stream
from sceniris_gym.program.device_bank import Bank

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_EVAL = wp.constant(wp.uint32(SPLITS["eval"]))
_BANK_BIT = wp.constant(BANK_BIT)


@wp.func
def _bank_row(bank: Bank, layouts: LayoutsView, worldid: int, split: wp.uint32) -> int:
    """Return the world's entry of its split's bank; -1 while the bank of the scene is still being filled.

    In scenes with kinds of starts it is the next one from there of the world's kind, if there is one.
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
    for i in range(num):
        if bank.start[first + (row + i) % num] == layouts.start[worldid]:
            return first + (row + i) % num
    return first + row


@wp.func
def fall_back(bank: Bank, layouts: LayoutsView, worldid: int, split: wp.uint32, width: int) -> int:
    """Copy the world's entry of the bank with the key of its draws, and return the status of its row."""
    row = _bank_row(bank, layouts, worldid, split)
    if row < 0:
        return 0
    for i in range(width):
        copy_layout(bank, row, layouts, worldid, i)
    layouts.draw_seed[worldid] = bank.seed[row]
    layouts.draw_episode[worldid] = bank.episode[row]
    layouts.draw_stream[worldid] = layouts.stream | _BANK_BIT
    return Status.FALLBACK
