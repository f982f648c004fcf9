"""Intervals of knobs that follow success: the kernel that moves their ends by what was counted."""

from __future__ import annotations

import numpy as np
import warp as wp

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.knobs import KnobTable
from sceniris_gym.levels.buffer import Buffer
from sceniris_gym.levels.choice import Ranges
from sceniris_gym.program.device import fill_struct

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _move(
    episodes: int,
    low: float,
    high: float,
    # Buffer in: present, start, limit, step, episodes, successes
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
    least, most = wp.min(buffer.start[i], buffer.limit[i]), wp.max(buffer.start[i], buffer.limit[i])
    buffer.present[i] = wp.clamp(moved, least, most)


def launch_move(buffer: Buffer, words: Ranges) -> None:
    """Move the ends at which enough episodes were counted."""
    inputs, device = [words.episodes, words.low, words.high], buffer.base.device
    wp.launch(_move, buffer.column.shape[0], inputs=inputs, outputs=[buffer], device=device)


def set_ranges(buffer: Buffer, words: Ranges, table: KnobTable) -> None:
    """Set the intervals of a buffer to their start.

    Raises:
        UnknownNameError, ArgumentError: A knob that is not in the table or no interval, or a start beyond it.
    """
    columns: dict[str, list] = {name: [] for name in ("column", "other", "present", "limit", "step", "band")}
    for name, value in words.start.items():
        knob = table.knob(name, "Ranges")
        if knob.half == 0:
            raise ArgumentError(f"Ranges: {name} should be an interval, and is not.")
        first, half = table.first[name], knob.half
        for k, (start, limit) in enumerate(zip(knob.checked(value, 1)[0], knob.default, strict=True)):
            other, outwards = (k + half, -1.0) if k < half else (k - half, 1.0)
            step = words.step * abs(float(knob.default[other] - limit))
            if knob.form == "count":
                step = max(1.0, round(step))
            row = (first + k, first + other, start, limit, outwards * step)
            for key, number in zip(columns, (*row, 0.0 if knob.form == "count" else outwards * step), strict=True):
                columns[key].append(number)
    arrays = {name: np.array(values) for name, values in columns.items()} | {"start": np.array(columns["present"])}
    arrays |= {name: np.zeros(len(columns["column"])) for name in ("episodes", "successes")}
    fill_struct(Buffer, buffer, arrays, str(buffer.base.device))
    buffer.probes = words.probe
