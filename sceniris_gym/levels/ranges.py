"""Intervals of knobs that follow success: the kernel that moves their ends by what was counted."""

from __future__ import annotations

import numpy as np
import warp as wp

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.knobs import KnobTable
from sceniris_gym.levels.buffer import Buffer
from sceniris_gym.levels.choice import Ranges
from sceniris_gym.program.device import fill_struct

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _move(
    episodes: int,
    low: float,
    high: float,
    # Buffer in: present, least, most, step, episodes, successes
    # Buffer out: present, episodes, successes
    buffer: Buffer,
):
    i = wp.tid()
    if buffer.episodes[i] < episodes:
        return
    rate = float(buffer.successes[i]) / float(buffer.episodes[i])
    buffer.episodes[i] = 0
    buffer.successes[i] = 0
    moved = buffer.present[i]
    if rate >= high:
        moved += buffer.step[i]
    elif rate <= low:
        moved -= buffer.step[i]
    buffer.present[i] = wp.clamp(moved, buffer.least[i], buffer.most[i])


def launch_move(buffer: Buffer, words: Ranges) -> None:
    """Move the ends at which enough episodes were counted."""
    inputs, device = [words.episodes, words.low, words.high], buffer.base.device
    wp.launch(_move, buffer.column.shape[0], inputs=inputs, outputs=[buffer], device=device)


def set_ranges(buffer: Buffer, words: Ranges, table: KnobTable) -> None:
    """Set the intervals of a buffer to their start.

    Raises:
        UnknownNameError, ArgumentError: A knob that is not in the table or no interval, or a start beyond it.
    """
    names, parts = ("column", "other", "present", "least", "most", "step", "band"), []
    for name, value in words.start.items():
        knob = table.knob(name, "Ranges")
        if knob.half == 0:
            raise ArgumentError(f"Ranges: {name} should be an interval, and is not.")
        start, limit, is_count = knob.checked(value, 1)[0], knob.default, knob.form == "count"
        own = np.arange(len(limit))
        other, outwards = np.roll(own, knob.half), np.where(own < knob.half, -1.0, 1.0)
        step = words.step * np.abs(limit[other] - limit)
        step = outwards * (np.maximum(1.0, np.round(step)) if is_count else step)
        first = table.first[name]
        ends = np.minimum(start, limit), np.maximum(start, limit)
        parts.append((first + own, first + other, start, *ends, step, 0.0 * step if is_count else step))
    arrays = dict(zip(names, np.concatenate(parts, axis=1), strict=True))
    arrays |= {name: np.zeros(len(arrays["column"])) for name in ("episodes", "successes")}
    fill_struct(Buffer, buffer, arrays, str(buffer.base.device))
    buffer.probes = words.probe
