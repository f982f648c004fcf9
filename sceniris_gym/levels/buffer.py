"""`Buffer`: levels and their scores on the device, and the kernels that choose, update and weigh them."""

from typing import Any

import numpy as np
import warp as wp
from warp.utils import array_scan

from sceniris_gym.device.random import philox, uniform
from sceniris_gym.layout.layouts import LayoutsView, Status
from sceniris_gym.levels.choice import Levels
from sceniris_gym.program.device import allocate

wp.set_module_options({"enable_backward": False})

_TOTAL = wp.constant(float(1 << 30))  # sum of all weights, within an int32
_OCTAVES = wp.constant(24.0)  # scores from 2^-24 to 2^8, below and above alike
_BINS_OF_OCTAVE = wp.constant(16.0)
_BINS = wp.constant(512)
_SHARE = 4  # levels that a world can insert between two refreshes, at most
_LOWEST = 4  # one place of so many can be given to another level between two refreshes


@wp.struct
class Buffer:
    """The levels of a buffer, and what the worlds play, as kernels take them."""

    # of each level:
    seed: wp.array[wp.uint64]
    episode: wp.array[int]
    value: wp.array[float]  # rate of success, or the given score
    stamp: wp.array[int]  # reset in which it was chosen last, -1 where there is no level
    knob: wp.array2d[float]  # numbers of its knobs
    cumulative: wp.array[int]  # sum of the weights up to it
    # of each bin of scores:
    count: wp.array[int]
    weight: wp.array[float]
    # sums over the levels: their number, weights and resets since they were chosen last
    filled: wp.array[int]
    total: wp.array[float]
    age: wp.array[wp.int64]
    lowest: wp.array[int]  # the highest bin of which levels may be replaced, -1 for none
    # of each world:
    base: wp.array[wp.uint64]  # seed that fresh levels are drawn by
    decision: wp.array[int]
    level: wp.array[int]  # place of the level that it plays, -1 for a fresh one
    next_level: wp.array[int]
    next_seed: wp.array[wp.uint64]
    next_episode: wp.array[int]
    base_knob: wp.array2d[float]  # with which fresh levels are made
    next_knob: wp.array2d[float]
    probe: wp.array[int]  # the end of a range that its level is at, -1 for none
    next_probe: wp.array[int]
    inserted: wp.array[int]
    # of each end of the ranges that follow success:
    column: wp.array[int]  # of its number in a row of knobs
    other: wp.array[int]  # of the other end's
    present: wp.array[float]
    start: wp.array[float]
    limit: wp.array[float]
    step: wp.array[float]  # outwards
    band: wp.array[float]  # levels at this end lie between it and so much inwards
    episodes: wp.array[int]
    successes: wp.array[int]
    # of the buffer:
    vacant: wp.array[int]  # places that are empty or have the lowest scores, -1 beyond them
    resets: wp.array[int]
    counts_success: int
    wants_failure: int
    rate: float
    probes: float  # probability that a fresh level is at an end


@wp.func
def _score(buffer: Buffer, i: int) -> float:
    """Return the score of a level, at least 0."""
    value = buffer.value[i]
    if buffer.counts_success == 0:
        return wp.max(value, 0.0)
    if buffer.wants_failure == 1:
        return 1.0 - value
    return value * (1.0 - value)


@wp.func
def _bin(score: float) -> int:
    """Return the bin of a score, sixteen to each power of two."""
    if score <= 0.0:
        return 0
    return wp.clamp(int(_BINS_OF_OCTAVE * (wp.log2(score) + _OCTAVES)), 0, _BINS - 1)


@wp.func
def _first_above(cumulative: wp.array[int], wanted: int) -> int:
    """Return the index of the first sum that is above `wanted`, by bisection."""
    low, high = int(0), cumulative.shape[0] - 1
    while low < high:
        middle = (low + high) // 2
        if cumulative[middle] > wanted:
            high = middle
        else:
            low = middle + 1
    return low


@wp.func
def _set_fresh_knobs(buffer: Buffer, worldid: int):
    """Give the next level of a world the knobs of a fresh one: its own, and the present ranges."""
    buffer.next_probe[worldid] = -1
    for k in range(buffer.next_knob.shape[1]):
        buffer.next_knob[worldid, k] = buffer.base_knob[worldid, k]
    for i in range(buffer.column.shape[0]):
        buffer.next_knob[worldid, buffer.column[i]] = buffer.present[i]


@wp.func
def _probe_end(buffer: Buffer, worldid: int, u: float):
    """Move the next level of a world to one end of one range, with a probability."""
    if u >= buffer.probes:
        return
    ends = buffer.column.shape[0]
    i = wp.min(int(u / buffer.probes * float(ends)), ends - 1)
    buffer.next_probe[worldid] = i
    inner = buffer.present[i] - buffer.band[i]
    far = buffer.next_knob[worldid, buffer.other[i]]
    buffer.next_knob[worldid, buffer.other[i]] = wp.where(buffer.step[i] > 0.0, wp.max(inner, far), wp.min(inner, far))


@wp.kernel
def _tick(
    # Buffer in: resets
    # Buffer out: resets
    buffer: Buffer,
):
    buffer.resets[0] = buffer.resets[0] + 1


@wp.kernel
def _choose(
    mask: wp.array[bool],
    stream: wp.uint32,
    replay: float,
    # Buffer in: seed, episode, knob, cumulative, base, decision, next_level, base_knob, next_knob, next_probe, column,
    #   other, present, step, band, resets, probes
    # Buffer out: stamp, decision, level, next_level, next_seed, next_episode, next_knob, probe, next_probe
    buffer: Buffer,
):
    worldid = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    buffer.level[worldid] = buffer.next_level[worldid]
    buffer.probe[worldid] = buffer.next_probe[worldid]
    counter = wp.vec4ui(wp.uint32(buffer.decision[worldid]), stream, wp.uint32(0), wp.uint32(0))
    words = philox(buffer.base[worldid], counter)
    buffer.decision[worldid] = buffer.decision[worldid] + 1
    total = buffer.cumulative[buffer.cumulative.shape[0] - 1]
    if total == 0 or uniform(words[0]) >= replay:
        buffer.next_level[worldid] = -1
        buffer.next_seed[worldid] = (wp.uint64(words[2]) << wp.uint64(32)) | wp.uint64(words[3])
        buffer.next_episode[worldid] = 0
        _set_fresh_knobs(buffer, worldid)
        _probe_end(buffer, worldid, uniform(words[1]))
        return
    wanted = int((wp.uint64(words[1]) * wp.uint64(total)) >> wp.uint64(32))
    first = _first_above(buffer.cumulative, wanted)
    buffer.next_level[worldid] = first
    buffer.next_seed[worldid] = buffer.seed[first]
    buffer.next_episode[worldid] = buffer.episode[first]
    buffer.next_probe[worldid] = -1
    for k in range(buffer.next_knob.shape[1]):
        buffer.next_knob[worldid, k] = buffer.knob[first, k]
    buffer.stamp[first] = buffer.resets[0]


def launch_choose(buffer: Buffer, mask: wp.array | None, stream: int, replay: float) -> None:
    """Let the masked worlds play the levels that were chosen for them, and choose those that follow.

    Args:
        buffer: The buffer.
        mask: Which worlds, shape (nworld,), bool; all if None.
        stream: Philox stream of the choices.
        replay: Probability of a level out of the buffer.
    """
    nworld, device = buffer.base.shape[0], buffer.base.device
    wp.launch(_tick, 1, outputs=[buffer], device=device)
    wp.launch(_choose, nworld, inputs=[mask, wp.uint32(stream), replay], outputs=[buffer], device=device)


@wp.kernel
def _forget(
    seeds: wp.array[wp.uint64],
    mask: wp.array[bool],
    restores: bool,
    # Buffer in: base_knob, column, present
    # Buffer out: base, decision, next_level, next_knob, next_probe
    buffer: Buffer,
):
    worldid = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    buffer.next_level[worldid] = -1
    buffer.next_probe[worldid] = -1
    if restores:
        _set_fresh_knobs(buffer, worldid)
    if seeds:
        buffer.base[worldid] = seeds[worldid]
        buffer.decision[worldid] = 0


def launch_forget(buffer: Buffer, seeds: wp.array | None, mask: wp.array | None, *, restores: bool = True) -> None:
    """Forget what was chosen for the masked worlds, and draw their fresh levels by new seeds if there are some.

    Args:
        buffer: The buffer.
        seeds: Seeds, shape (nworld,), uint64; None keeps those there are.
        mask: Which worlds, shape (nworld,), bool; all if None.
        restores: Give the next levels the knobs of fresh ones.
    """
    inputs, device = [seeds, mask, restores], buffer.base.device
    wp.launch(_forget, buffer.base.shape[0], inputs=inputs, outputs=[buffer], device=device)


@wp.func
def _tell(
    buffer: Buffer,
    row: int,
    level: int,
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    outcome: float,
    knob: wp.array2d[float],
):
    """Update the level of a row, or insert it."""
    if level >= 0 and level < buffer.seed.shape[0]:
        if buffer.seed[level] == seed[row] and buffer.episode[level] == episode[row]:
            value = outcome
            if buffer.counts_success == 1:
                value = buffer.value[level] + buffer.rate * (value - buffer.value[level])
            buffer.value[level] = value
            return
    # a fresh level, or one that another has replaced: it takes the next of the places that this row may fill
    nrow = buffer.inserted.shape[0]
    number = row % nrow + buffer.inserted[row % nrow] * nrow
    if number >= buffer.vacant.shape[0]:
        return
    place = buffer.vacant[number]
    if place < 0:
        return
    buffer.inserted[row % nrow] = buffer.inserted[row % nrow] + 1
    old = -1.0
    if buffer.stamp[place] >= 0:
        old = _score(buffer, place)
    before = buffer.value[place]
    value = outcome
    if buffer.counts_success == 1:
        value = 0.5 + buffer.rate * (value - 0.5)
    buffer.value[place] = value
    if _score(buffer, place) < old:
        buffer.value[place] = before
        return
    buffer.seed[place] = seed[row]
    buffer.episode[place] = episode[row]
    buffer.stamp[place] = buffer.resets[0]
    for k in range(buffer.knob.shape[1]):
        buffer.knob[place, k] = knob[row, k]


@wp.kernel
def _update(
    level: wp.array[int],
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    outcome: wp.array[float],
    knob: wp.array2d[float],
    mask: wp.array[bool],
    # Buffer in: seed, episode, value, stamp, inserted, vacant, resets, counts_success, wants_failure, rate
    # Buffer out: seed, episode, value, stamp, knob, inserted
    buffer: Buffer,
):
    row = wp.tid()
    if mask:
        if not mask[row]:
            return
    _tell(buffer, row, level[row], seed, episode, outcome[row], knob)


def launch_update(
    buffer: Buffer,
    level: wp.array,
    seed: wp.array,
    episode: wp.array,
    outcome: wp.array,
    mask: wp.array | None,
    knob: wp.array | None = None,
) -> None:
    """Update levels by the outcomes of episodes, or insert them; see `LevelSampler.launch_update`."""
    inputs = [level, seed, episode, outcome, knob, mask]
    wp.launch(_update, level.shape[0], inputs=inputs, outputs=[buffer], device=buffer.base.device)


@wp.kernel
def _finish(
    success: wp.array[bool],
    finished: wp.array[bool],
    # Layouts in: seed, episode, status, knob
    layouts: LayoutsView,
    # Buffer in: seed, episode, value, stamp, level, probe, inserted, episodes, successes, vacant, resets,
    #   counts_success, wants_failure, rate
    # Buffer out: seed, episode, value, stamp, knob, inserted, episodes, successes
    buffer: Buffer,
):
    worldid = wp.tid()
    if not finished[worldid] or layouts.status[worldid] == Status.FALLBACK:
        return
    if buffer.counts_success == 1:
        outcome = wp.where(success[worldid], 1.0, 0.0)
        _tell(buffer, worldid, buffer.level[worldid], layouts.seed, layouts.episode, outcome, layouts.knob)
    end = buffer.probe[worldid]
    if end >= 0:
        wp.atomic_add(buffer.episodes, end, 1)
        wp.atomic_add(buffer.successes, end, wp.where(success[worldid], 1, 0))


def launch_finish(buffer: Buffer, layouts: LayoutsView, success: wp.array, finished: wp.array) -> None:
    """Count how episodes ended: update or insert their levels, and count for the ends that they were at.

    Args:
        buffer: The buffer.
        layouts: The layouts of the episodes; those from the bank are no levels.
        success: Worlds that succeeded, shape (nworld,), bool.
        finished: Worlds whose episode ended, shape (nworld,), bool.
    """
    inputs, device = [success, finished, layouts], buffer.base.device
    wp.launch(_finish, buffer.base.shape[0], inputs=inputs, outputs=[buffer], device=device)


@wp.func
def _is_vacant(buffer: Buffer, i: int, empty: bool) -> bool:
    """Tell whether a place is empty; or else, whether it has a level that is one of the lowest."""
    if buffer.stamp[i] < 0 or empty:
        return buffer.stamp[i] < 0 and empty
    return _bin(_score(buffer, i)) <= buffer.lowest[0]


@wp.kernel
def _count(
    # Buffer in: value, stamp, count, filled, age, resets, counts_success, wants_failure
    # Buffer out: count, filled, age
    buffer: Buffer,
):
    i = wp.tid()
    if buffer.stamp[i] >= 0:
        wp.atomic_add(buffer.count, _bin(_score(buffer, i)), 1)
        wp.atomic_add(buffer.filled, 0, 1)
        wp.atomic_add(buffer.age, 0, wp.int64(buffer.resets[0] - buffer.stamp[i]))


@wp.kernel
def _weigh(
    by_rank: bool,
    by_score: bool,
    power: float,
    # Buffer in: count
    # Buffer out: weight
    buffer: Buffer,
):
    b = wp.tid()
    number = buffer.count[b]
    weight = float(1.0)
    if by_rank:  # the levels of a bin share their mean rank
        above = int(0)
        for other in range(b + 1, _BINS):
            above += buffer.count[other]
        weight = wp.pow(float(above) + 0.5 * float(number + 1), -power)
    if by_score:
        weight = wp.pow(2.0, power * ((float(b) + 0.5) / _BINS_OF_OCTAVE - _OCTAVES))
    buffer.weight[b] = weight


@wp.kernel
def _sum_up(
    # Buffer in: count, weight, filled
    # Buffer out: total, lowest
    buffer: Buffer,
):
    # one lane, from the best bin down, so that all devices round alike
    above, total = int(0), float(0.0)
    room = buffer.vacant.shape[0] - (buffer.stamp.shape[0] - buffer.filled[0])
    lowest = int(-1)
    for i in range(_BINS):
        b = _BINS - 1 - i
        number = buffer.count[b]
        total += buffer.weight[b] * float(number)
        above += number
        if number > 0 and lowest < 0 and buffer.filled[0] - above < room:
            lowest = b
    buffer.total[0] = total
    buffer.lowest[0] = lowest


@wp.kernel
def _mark_vacant(
    empty: bool,
    # Buffer in: value, stamp, lowest, counts_success, wants_failure
    # Buffer out: cumulative
    buffer: Buffer,
):
    i = wp.tid()
    buffer.cumulative[i] = wp.where(_is_vacant(buffer, i, empty), 1, 0)


@wp.kernel
def _list_vacant(
    empty: bool,
    # Buffer in: value, stamp, cumulative, filled, lowest, counts_success, wants_failure
    # Buffer out: vacant
    buffer: Buffer,
):
    i = wp.tid()
    number = buffer.cumulative[i] - 1
    if _is_vacant(buffer, i, empty):
        if not empty:
            number += buffer.stamp.shape[0] - buffer.filled[0]
        if number < buffer.vacant.shape[0]:
            buffer.vacant[number] = i


@wp.kernel
def _fill(
    staleness: float,
    # Buffer in: value, stamp, weight, total, age, resets, counts_success, wants_failure
    # Buffer out: cumulative
    buffer: Buffer,
):
    i = wp.tid()
    share = float(0.0)
    if buffer.stamp[i] >= 0:
        share = buffer.weight[_bin(_score(buffer, i))] / buffer.total[0]
        if buffer.age[0] > wp.int64(0):
            old = float(buffer.resets[0] - buffer.stamp[i]) / float(buffer.age[0])
            share = (1.0 - staleness) * share + staleness * old
    buffer.cumulative[i] = int(share * _TOTAL)


def launch_refresh(buffer: Buffer, levels: Levels) -> None:
    """Weigh all levels anew, and list the places of the lowest scores."""
    capacity, device = levels.capacity, buffer.base.device
    for array in (buffer.count, buffer.filled, buffer.age, buffer.inserted):
        array.zero_()
    buffer.vacant.fill_(-1)
    wp.launch(_count, capacity, outputs=[buffer], device=device)
    inputs = [levels.priority == "rank", levels.priority == "proportional", 1.0 / levels.temperature]
    wp.launch(_weigh, _BINS, inputs=inputs, outputs=[buffer], device=device)
    wp.launch(_sum_up, 1, outputs=[buffer], device=device)
    for empty in (True, False):  # empty places come first
        wp.launch(_mark_vacant, capacity, inputs=[empty], outputs=[buffer], device=device)
        array_scan(buffer.cumulative, buffer.cumulative)
        wp.launch(_list_vacant, capacity, inputs=[empty], outputs=[buffer], device=device)
    wp.launch(_fill, capacity, inputs=[levels.staleness], outputs=[buffer], device=device)
    array_scan(buffer.cumulative, buffer.cumulative)


def create_buffer(levels: Levels, nworld: int, device: wp.Device, nknob: int = 0) -> Buffer:
    """Allocate an empty buffer of levels with so many numbers of knobs."""
    buffer, capacity = Buffer(), levels.capacity
    sizes: dict[str, Any] = {
        "seed episode value stamp cumulative": capacity,
        "count weight": _BINS,
        "filled total age lowest resets": 1,
        "base decision level next_level next_seed next_episode inserted probe next_probe": nworld,
        "knob": (capacity, nknob),
        "column other present start limit step band episodes successes": 0,
        "base_knob next_knob": (nworld, nknob),
    }
    for names, size in sizes.items():
        with wp.ScopedDevice(device):
            allocate(Buffer, buffer, size, names)
    for array in (buffer.stamp, buffer.level, buffer.next_level, buffer.probe, buffer.next_probe):
        array.fill_(-1)
    vacant = min(-(-capacity // _LOWEST), _SHARE * nworld)
    buffer.vacant = wp.array(np.arange(vacant), dtype=int, device=device)
    buffer.counts_success, buffer.wants_failure = int(levels.score != "given"), int(levels.score == "failure")
    buffer.rate = levels.rate
    return buffer


KEPT = (
    *("seed", "episode", "value", "stamp", "base", "decision", "level", "next_level", "next_seed", "next_episode"),
    *("resets", "knob", "base_knob", "next_knob", "probe", "next_probe", "present", "episodes", "successes"),
)
"""Arrays of a Buffer from which all others follow."""
