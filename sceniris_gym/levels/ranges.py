"""`RangesView`: intervals of knobs that follow success, on the device, and the kernels that draw and move them."""

from __future__ import annotations

import numpy as np
import warp as wp

from sceniris_gym.device.random import philox, uniform
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.knobs import KnobTable
from sceniris_gym.levels.choice import Ranges
from sceniris_gym.program.device import fill_struct

wp.set_module_options({"enable_backward": False})


@wp.struct
class RangesView:
    """The ends of the intervals, as kernels take them."""

    # of each end:
    column: wp.array[int]  # of its number in a row of knobs
    other: wp.array[int]  # of the other end's
    present: wp.array[float]
    start: wp.array[float]
    limit: wp.array[float]
    step: wp.array[float]  # outwards
    band: wp.array[float]  # levels at this end lie between it and so much inwards
    episodes: wp.array[int]
    successes: wp.array[int]
    # of each world:
    probe: wp.array[int]  # the end that its level is at, -1 for none
    next_probe: wp.array[int]


@wp.kernel
def _probe(
    mask: wp.array[bool],
    stream: wp.uint32,
    share: float,
    base: wp.array[wp.uint64],
    decision: wp.array[int],
    next_level: wp.array[int],
    begins: bool,
    # Ranges in: column, other, present, step, band, next_probe
    # Ranges out: probe, next_probe
    ranges: RangesView,
    # Out:
    next_knob: wp.array2d[float],
):
    worldid = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    if begins:
        ranges.probe[worldid] = ranges.next_probe[worldid]
    ranges.next_probe[worldid] = -1
    if next_level[worldid] >= 0:
        return
    for i in range(ranges.column.shape[0]):
        next_knob[worldid, ranges.column[i]] = ranges.present[i]
    words = philox(base[worldid], wp.vec4ui(wp.uint32(decision[worldid]), stream, wp.uint32(1), wp.uint32(0)))
    if uniform(words[0]) >= share:
        return
    ends = ranges.column.shape[0]
    i = wp.min(int(uniform(words[1]) * float(ends)), ends - 1)
    ranges.next_probe[worldid] = i
    inner = ranges.present[i] - ranges.band[i]
    far = next_knob[worldid, ranges.other[i]]
    next_knob[worldid, ranges.other[i]] = wp.where(ranges.step[i] > 0.0, wp.max(inner, far), wp.min(inner, far))


def launch_probe(
    ranges: RangesView,
    mask: wp.array | None,
    stream: int,
    share: float,
    base: wp.array,
    decision: wp.array,
    next_level: wp.array,
    next_knob: wp.array,
    *,
    begins: bool,
) -> None:
    """Give the masked worlds whose next level is fresh the intervals, or one end of one of them.

    Args:
        ranges: The intervals.
        mask: Which worlds, shape (nworld,), bool; all if None.
        stream: Philox stream of the choices.
        share: Probability of a level at an end.
        base: Seeds of the choices, shape (nworld,).
        decision: Their numbers, shape (nworld,).
        next_level: -1 where the next level is fresh, shape (nworld,).
        next_knob: Numbers of its knobs, written to, shape (nworld, nvalue).
        begins: The level that was chosen before begins.
    """
    inputs = [mask, wp.uint32(stream), share, base, decision, next_level, begins]
    wp.launch(_probe, base.shape[0], inputs=inputs, outputs=[ranges, next_knob], device=base.device)


@wp.kernel
def _count(
    outcome: wp.array[float],
    mask: wp.array[bool],
    # Ranges in: episodes, successes, probe
    # Ranges out: episodes, successes
    ranges: RangesView,
):
    worldid = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    i = ranges.probe[worldid]
    if i >= 0:
        wp.atomic_add(ranges.episodes, i, 1)
        wp.atomic_add(ranges.successes, i, int(outcome[worldid]))


@wp.kernel
def _move(
    episodes: int,
    low: float,
    high: float,
    # Ranges in: present, start, limit, step, episodes, successes
    # Ranges out: present, episodes, successes
    ranges: RangesView,
):
    i = wp.tid()
    if ranges.episodes[i] < episodes:
        return
    rate = float(ranges.successes[i]) / float(ranges.episodes[i])
    ranges.episodes[i] = 0
    ranges.successes[i] = 0
    moved = ranges.present[i]
    if rate >= high:
        moved += ranges.step[i]
    elif rate <= low:
        moved -= ranges.step[i]
    least, most = wp.min(ranges.start[i], ranges.limit[i]), wp.max(ranges.start[i], ranges.limit[i])
    ranges.present[i] = wp.clamp(moved, least, most)


def launch_count(ranges: RangesView, words: Ranges, outcome: wp.array, mask: wp.array | None) -> None:
    """Count the outcomes of the masked worlds' episodes, 1 for a success, and move the ends that have enough."""
    device = outcome.device
    wp.launch(_count, outcome.shape[0], inputs=[outcome, mask], outputs=[ranges], device=device)
    inputs = [words.episodes, words.low, words.high]
    wp.launch(_move, ranges.column.shape[0], inputs=inputs, outputs=[ranges], device=device)


def create_ranges(words: Ranges, table: KnobTable, nworld: int, device: wp.Device) -> RangesView:
    """Allocate the intervals at their start.

    Raises:
        UnknownNameError, ArgumentError: A knob that is not in the table or no interval, or a start beyond it.
    """
    columns: dict[str, list] = {name: [] for name in ("column", "other", "present", "limit", "step", "band")}
    for name, value in words.start.items():
        knob = table.knob(name, "Ranges")
        if knob.form == "weights":
            raise ArgumentError(f"Ranges: {name} should be an interval, and is weights.")
        first, half = table.first[name], len(knob.default) // 2
        for k, (start, limit) in enumerate(zip(knob.checked(value, 1)[0], knob.default, strict=True)):
            other, outwards = (k + half, -1.0) if k < half else (k - half, 1.0)
            step = words.step * abs(float(knob.default[other] - limit))
            if knob.form == "count":
                step = max(1.0, round(step))
            row = (first + k, first + other, start, limit, outwards * step)
            for key, number in zip(columns, (*row, 0.0 if knob.form == "count" else outwards * step), strict=True):
                columns[key].append(number)
    view, count = RangesView(), len(columns["column"])
    arrays = {name: np.array(values) for name, values in columns.items()} | {"start": np.array(columns["present"])}
    arrays |= {name: np.zeros(count) for name in ("episodes", "successes")}
    arrays |= {name: np.full(nworld, -1) for name in ("probe", "next_probe")}
    fill_struct(RangesView, view, arrays, str(device))
    return view


KEPT_RANGES = ("present", "episodes", "successes", "probe", "next_probe")
"""Arrays of a RangesView that change."""
