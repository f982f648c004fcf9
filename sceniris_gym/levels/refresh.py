"""Kernels that update the weights of levels, list the slots for new levels, and move the ends of ADR intervals."""

import numpy as np
import warp as wp

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.params import ParamTable
from sceniris_gym.levels.buffer import BINS, NO_SLOT, Buffer, score_of
from sceniris_gym.levels.curriculum import ADR, LevelReplay
from sceniris_gym.program.device import fill_struct

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_TOTAL = wp.constant(float(1 << 30))  # sum of all weights, within an int32
_UNIT = wp.constant(float(2.0**-32))  # sums of weights are integers in this unit, so their order does not matter
_OCTAVES = wp.constant(8.0)  # bins cover scores from 2^8 down to 2^-24, and the outer bins hold all scores beyond
_BINS_OF_OCTAVE = wp.constant(16.0)


@wp.func
def _bin(buffer: Buffer, i: int) -> int:
    """Return the score bin of slot `i`, or BINS if the slot is empty. Scores s and 2 s are 16 bins apart."""
    if buffer.age[i] < 0:
        return BINS
    octave = wp.log2(wp.max(score_of(buffer, buffer.value[i]), 1.0e-30))
    return wp.clamp(int(_BINS_OF_OCTAVE * (_OCTAVES - octave)), 0, BINS - 1)


@wp.func
def _is_vacant(buffer: Buffer, b: int) -> bool:
    """Return whether new levels may take the slots in score bin `b`.

    While there are empty slots, only these may be taken. Afterwards, the slots with the lowest scores may be taken.
    """
    filled, room = buffer.better[BINS - 1], buffer.vacant.shape[0]
    if filled < buffer.age.shape[0]:
        return b == BINS
    return b >= wp.lower_bound(buffer.better, filled - room + 1)


@wp.kernel
def _count(
    # Buffer in: value, age, score; both: count, ages
    buffer: Buffer,
):
    i = wp.tid()
    if buffer.age[i] >= 0:
        b = _bin(buffer, i)
        wp.atomic_add(buffer.count, b, 1)
        wp.atomic_add(buffer.ages, b, wp.int64(buffer.age[i]))


@wp.kernel
def _weigh(
    rank_power: float,
    score_power: float,
    # Buffer in: count, better, ages; out: weight; both: total_weight, total_age
    buffer: Buffer,
):
    b = wp.tid()
    number = buffer.count[b]
    if number == 0:
        return
    # Weights are relative to the weight of the best bin. All levels of a bin get the mean rank of the bin.
    best = wp.lower_bound(buffer.better, 1)
    rank = float(buffer.better[b] - number) + 0.5 * float(number + 1)
    weight = wp.pow(0.5 * float(buffer.better[best] + 1) / rank, rank_power)
    weight *= wp.pow(2.0, score_power * float(best - b) / _BINS_OF_OCTAVE)
    buffer.weight[b] = weight
    wp.atomic_add(buffer.total_weight, 0, wp.int64(weight * float(number) / _UNIT))
    wp.atomic_add(buffer.total_age, 0, buffer.ages[b])


@wp.kernel
def _mark_vacant(
    # Buffer in: value, age, better, score; out: cumulative
    buffer: Buffer,
):
    i = wp.tid()
    buffer.cumulative[i] = wp.where(_is_vacant(buffer, _bin(buffer, i)), 1, 0)


@wp.kernel
def _fill(
    staleness_coef: float,
    # Buffer in: value, better, weight, total_weight, total_age, score; out: vacant; both: age, cumulative
    buffer: Buffer,
):
    i = wp.tid()
    b = _bin(buffer, i)
    number = buffer.cumulative[i] - 1
    if number < buffer.vacant.shape[0] and _is_vacant(buffer, b):
        buffer.vacant[number] = i
    share = float(0.0)
    if b < BINS:
        share = buffer.weight[b] / (float(buffer.total_weight[0]) * _UNIT)
        if buffer.total_age[0] > wp.int64(0):
            old = float(buffer.age[i]) / float(buffer.total_age[0])
            share = (1.0 - staleness_coef) * share + staleness_coef * old
        buffer.age[i] = buffer.age[i] + 1
    buffer.cumulative[i] = int(share * _TOTAL)


def launch_refresh(buffer: Buffer, replay: LevelReplay) -> None:
    """Update the weights of all levels, and list the slots that new levels may take."""
    capacity, device = replay.capacity, buffer.base.device
    for array in (buffer.count, buffer.ages, buffer.total_weight, buffer.total_age, buffer.inserted):
        array.zero_()
    buffer.vacant.fill_(NO_SLOT)
    wp.launch(_count, capacity, outputs=[buffer], device=device)
    wp.utils.array_scan(buffer.count, buffer.better)
    power = 1.0 / replay.temperature
    inputs = [power if replay.prioritization == name else 0.0 for name in ("rank", "proportional")]
    wp.launch(_weigh, BINS, inputs=inputs, outputs=[buffer], device=device)
    wp.launch(_mark_vacant, capacity, outputs=[buffer], device=device)
    wp.utils.array_scan(buffer.cumulative, buffer.cumulative)
    wp.launch(_fill, capacity, inputs=[replay.staleness_coef], outputs=[buffer], device=device)
    wp.utils.array_scan(buffer.cumulative, buffer.cumulative)


@wp.kernel
def _move(
    queue_length: int,
    threshold_low: float,
    threshold_high: float,
    # Buffer in: least, most, delta; both: present, episodes, successes
    buffer: Buffer,
):
    i = wp.tid()
    if buffer.episodes[i] < queue_length:
        return
    rate = float(buffer.successes[i]) / float(buffer.episodes[i])
    buffer.episodes[i] = 0
    buffer.successes[i] = 0
    moved = buffer.present[i]
    if rate >= threshold_high:
        moved += buffer.delta[i]
    elif rate <= threshold_low:
        moved -= buffer.delta[i]
    buffer.present[i] = wp.clamp(moved, buffer.least[i], buffer.most[i])


def launch_move(buffer: Buffer, adr: ADR) -> None:
    """Move each interval end at which enough episodes were counted."""
    inputs, device = [adr.queue_length, adr.threshold_low, adr.threshold_high], buffer.base.device
    wp.launch(_move, buffer.column.shape[0], inputs=inputs, outputs=[buffer], device=device)


def set_ranges(buffer: Buffer, adr: ADR, table: ParamTable) -> None:
    """Set the intervals of a buffer to the `init_range` of an ADR.

    Raises:
        UnknownNameError, ArgumentError: The worlds do not have a param, the scene file gives the param no interval,
            or its initial range exceeds the scene file's interval.
    """
    names, parts = ("column", "other", "present", "least", "most", "delta", "band"), []
    for name, value in adr.init_range.items():
        param = table.param(name, "ADR")
        if param.half == 0:
            raise ArgumentError(f"ADR: init_range: '{name}' should be a param whose value is an interval.")
        start, limit, is_count = param.checked(value, 1)[0], param.default, param.form == "count"
        own = np.arange(len(limit))
        other, outwards = np.roll(own, param.half), np.where(own < param.half, -1.0, 1.0)
        delta = adr.delta * np.abs(limit[other] - limit)
        delta = outwards * (np.maximum(1.0, np.round(delta)) if is_count else delta)
        first = table.first[name]
        ends = np.minimum(start, limit), np.maximum(start, limit)
        parts.append((first + own, first + other, start, *ends, delta, 0.0 * delta if is_count else delta))
    arrays = dict(zip(names, np.concatenate(parts, axis=1), strict=True))
    arrays |= {name: np.zeros(len(arrays["column"])) for name in ("episodes", "successes")}
    fill_struct(Buffer, buffer, arrays, str(buffer.base.device))
    buffer.boundary_fraction = adr.boundary_fraction
