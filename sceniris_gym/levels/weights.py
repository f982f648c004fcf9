"""Weights of levels by their scores, and the places of the lowest ones, where others can be inserted."""

import warp as wp
from warp.utils import array_scan

from sceniris_gym.levels.buffer import BINS, Buffer, score_of
from sceniris_gym.levels.choice import Levels

wp.set_module_options({"enable_backward": False})

_TOTAL = wp.constant(float(1 << 30))  # sum of all weights, within an int32
_OCTAVES = wp.constant(24.0)  # scores from 2^-24 to 2^8, below and above alike
_BINS_OF_OCTAVE = wp.constant(16.0)


@wp.func
def _bin(buffer: Buffer, i: int) -> int:
    """Return the bin of a level by its score, sixteen to each power of two; -1 where there is none."""
    if buffer.age[i] < 0:
        return -1
    octave = wp.log2(wp.max(score_of(buffer, buffer.value[i]), 1.0e-30))
    return wp.clamp(int(_BINS_OF_OCTAVE * (octave + _OCTAVES)), 0, BINS - 1)


@wp.kernel
def _count(
    # Buffer in: value, age, count, ages, score
    # Buffer out: count, ages
    buffer: Buffer,
):
    i = wp.tid()
    if buffer.age[i] >= 0:
        wp.atomic_add(buffer.count, _bin(buffer, i), 1)
        wp.atomic_add(buffer.ages, 0, wp.int64(buffer.age[i]))


@wp.kernel
def _weigh(
    by_rank: bool,
    by_score: bool,
    power: float,
    # Buffer in: count
    # Buffer out: weight, total, lowest
    buffer: Buffer,
):
    # one lane, from the best bin down, so that all devices round alike
    above, total = int(0), float(0.0)
    for i in range(BINS):
        b = BINS - 1 - i
        number = buffer.count[b]
        weight = float(1.0)
        if by_rank:  # the levels of a bin share their mean rank
            weight = wp.pow(float(above) + 0.5 * float(number + 1), -power)
        if by_score:
            weight = wp.pow(2.0, power * ((float(b) + 0.5) / _BINS_OF_OCTAVE - _OCTAVES))
        buffer.weight[b] = weight
        total += weight * float(number)
        above += number
    buffer.total[0] = total
    # empty places are filled first
    lowest, room = int(-1), int(buffer.vacant.shape[0])
    if above == buffer.age.shape[0]:
        while room > 0:
            lowest += 1
            room -= buffer.count[lowest]
    buffer.lowest[0] = lowest


@wp.kernel
def _mark_vacant(
    # Buffer in: value, age, lowest, score
    # Buffer out: cumulative
    buffer: Buffer,
):
    i = wp.tid()
    buffer.cumulative[i] = wp.where(_bin(buffer, i) <= buffer.lowest[0], 1, 0)


@wp.kernel
def _fill(
    staleness: float,
    # Buffer in: value, age, cumulative, weight, total, ages, lowest, score
    # Buffer out: age, cumulative, vacant
    buffer: Buffer,
):
    i = wp.tid()
    b = _bin(buffer, i)
    number = buffer.cumulative[i] - 1
    if b <= buffer.lowest[0] and number < buffer.vacant.shape[0]:
        buffer.vacant[number] = i
    share = float(0.0)
    if b >= 0:
        share = buffer.weight[b] / buffer.total[0]
        if buffer.ages[0] > wp.int64(0):
            old = float(buffer.age[i]) / float(buffer.ages[0])
            share = (1.0 - staleness) * share + staleness * old
        buffer.age[i] = buffer.age[i] + 1
    buffer.cumulative[i] = int(share * _TOTAL)


def launch_refresh(buffer: Buffer, levels: Levels) -> None:
    """Weigh all levels anew, and list the places of the lowest scores."""
    capacity, device = levels.capacity, buffer.base.device
    for array in (buffer.count, buffer.ages, buffer.inserted):
        array.zero_()
    buffer.vacant.fill_(-1)
    wp.launch(_count, capacity, outputs=[buffer], device=device)
    inputs = [levels.priority == "rank", levels.priority == "proportional", 1.0 / levels.temperature]
    wp.launch(_weigh, 1, inputs=inputs, outputs=[buffer], device=device)
    wp.launch(_mark_vacant, capacity, outputs=[buffer], device=device)
    array_scan(buffer.cumulative, buffer.cumulative)
    wp.launch(_fill, capacity, inputs=[levels.staleness], outputs=[buffer], device=device)
    array_scan(buffer.cumulative, buffer.cumulative)
