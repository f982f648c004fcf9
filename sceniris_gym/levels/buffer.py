"""`Buffer`: levels on the device, with their success rates or scores, and kernels that choose and update levels."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from sceniris_gym.device.random import philox, uniform
from sceniris_gym.layout.layouts import ADVANCE, LayoutStatus, LayoutsView
from sceniris_gym.layout.masks import selects
from sceniris_gym.levels.curriculum import FRESH, SCORES, LevelReplay
from sceniris_gym.program.compiled import MOST_EPISODES
from sceniris_gym.program.device import allocate, fill_struct

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_LEARNABILITY, _CUSTOM = (wp.constant(SCORES.index(name)) for name in ("learnability", "custom"))
_MOST_FLOAT = wp.constant(float(np.finfo(np.float32).max))
BINS = wp.constant(512)
"""Number of bins into which scores are sorted."""
EMPTY = wp.constant(-1)
"""The age of a slot without a level."""
NO_SLOT = wp.constant(-1)
"""Fills the list of vacant slots."""
NO_END = wp.constant(-1)
"""The `boundary` of a level that is not at an end of an ADR interval."""
_SHARE = 4  # most levels that each world can insert between two refreshes
_LOWEST = 4  # at most a quarter of the slots can get a new level between two refreshes


@wp.struct
class Buffer:
    """Struct that kernels take: the stored levels, each world's current and next level, and the ADR intervals."""

    # of each level:
    seed: wp.array[wp.uint64]
    episode: wp.array[int]
    value: wp.array[float]  # success rate, or the custom score
    age: wp.array[int]  # refreshes since the level was last chosen, EMPTY without a level
    param: wp.array2d[float]  # param values
    cumulative: wp.array[int]  # sum of the weights up to this level
    # of each bin of scores, from the highest bin down:
    count: wp.array[int]
    better: wp.array[int]  # number of levels up to this bin
    ages: wp.array[wp.int64]  # sum of the ages of the bin's levels
    weight: wp.array[float]  # per level
    # of all levels:
    total_weight: wp.array[wp.int64]  # in units of 2^-32
    total_age: wp.array[wp.int64]
    vacant: wp.array[int]  # slots that are empty or have the lowest scores, then NO_SLOT
    # of each world:
    base: wp.array[wp.uint64]  # seed of fresh levels
    decision: wp.array[int]
    level: wp.array[int]  # index of the current level, or FRESH
    next_level: wp.array[int]
    next_seed: wp.array[wp.uint64]
    next_episode: wp.array[int]
    base_param: wp.array2d[float]  # params of fresh levels
    next_param: wp.array2d[float]
    boundary: wp.array[int]  # index of the interval end of the current level, or NO_END
    next_boundary: wp.array[int]
    inserted: wp.array[int]
    # of each end of the ADR intervals:
    column: wp.array[int]  # column of this end in a row of params
    other: wp.array[int]  # column of the other end
    present: wp.array[float]
    least: wp.array[float]
    most: wp.array[float]
    delta: wp.array[float]  # outwards
    band: wp.array[float]  # width of the levels at this end, inwards
    episodes: wp.array[int]
    successes: wp.array[int]
    # of the buffer:
    score: int
    alpha: float
    boundary_fraction: float  # probability that a fresh level is at an end


class Episodes(NamedTuple):
    """Finished episodes, one per row.

    Attributes:
        level: Index that the level had in the buffer when it was played, or -1 for a fresh level, shape (n,), int32.
            Rows with -2 (layouts from the bank) do not count.
        seed: Seed of the level, shape (n,), uint64.
        episode: Episode of the level, shape (n,), int32. Rows with an invalid episode do not count.
        outcome: 1 for a success and 0 for a failure, or the score if scores are "custom", shape (n,), float32.
        param: Param values of the level, shape (n, nvalue), float32. None if the worlds have no params.
        mask: Rows that count, shape (n,), bool. If None, all rows count.
        status: `LayoutStatus` of the layouts, shape (n,), int32. Layouts from the bank do not count. None means that
            all layouts are valid.
        boundary: Index of the ADR interval end that the level tests, or -1, shape (n,), int32. The outcome also counts
            for this end. If `boundary` is given, `outcome` holds 0 or 1, even if scores are "custom". Custom scores do
            not change then.
    """

    level: wp.array
    seed: wp.array
    episode: wp.array
    outcome: wp.array
    param: wp.array | None = None
    mask: wp.array | None = None
    status: wp.array | None = None
    boundary: wp.array | None = None


@wp.func
def score_of(buffer: Buffer, value: float) -> float:
    """Return the score, at least 0, of a level. `value` is the level's success rate or custom score."""
    if buffer.score == _CUSTOM:
        return wp.max(value, 0.0)
    return (1.0 - value) * wp.where(buffer.score == _LEARNABILITY, value, 1.0)


@wp.kernel
def _choose(
    mask: wp.array[bool],
    stream: wp.uint32,
    replay_prob: float,
    # Buffer in: seed, episode, cumulative, base, boundary_fraction; out: age, level, next_seed, next_episode, boundary;
    #   both: decision, next_level, next_boundary
    buffer: Buffer,
):
    worldid = wp.tid()
    if not selects(mask, worldid):
        return
    buffer.level[worldid] = buffer.next_level[worldid]
    buffer.boundary[worldid] = buffer.next_boundary[worldid]
    buffer.next_boundary[worldid] = NO_END
    counter = wp.vec4ui(wp.uint32(buffer.decision[worldid]), stream, wp.uint32(0), wp.uint32(0))
    words = philox(buffer.base[worldid], counter)
    buffer.decision[worldid] = buffer.decision[worldid] + 1
    total = buffer.cumulative[buffer.cumulative.shape[0] - 1]
    if total == 0 or uniform(words[0]) >= replay_prob:
        buffer.next_level[worldid] = FRESH
        buffer.next_seed[worldid] = (wp.uint64(words[2]) << wp.uint64(32)) | wp.uint64(words[3])
        buffer.next_episode[worldid] = 0
        u = uniform(words[1])
        if u < buffer.boundary_fraction:
            ends = buffer.column.shape[0]
            buffer.next_boundary[worldid] = wp.min(int(u / buffer.boundary_fraction * float(ends)), ends - 1)
        return
    wanted = int((wp.uint64(words[1]) * wp.uint64(total)) >> wp.uint64(32))
    first = wp.lower_bound(buffer.cumulative, wanted + 1)
    buffer.next_level[worldid] = first
    buffer.next_seed[worldid] = buffer.seed[first]
    buffer.next_episode[worldid] = buffer.episode[first]
    buffer.age[first] = 0


def launch_choose(buffer: Buffer, mask: wp.array | None, stream: int, replay_prob: float) -> None:
    """Give each masked world the level that was chosen for it earlier, and choose its next level.

    Args:
        buffer: The buffer.
        mask: Selected worlds, shape (nworld,), bool. None selects all.
        stream: Philox stream of the choices.
        replay_prob: Probability that the next level comes from the buffer. Otherwise, it is fresh.
    """
    nworld, device = buffer.base.shape[0], buffer.base.device
    wp.launch(_choose, nworld, inputs=[mask, wp.uint32(stream), replay_prob], outputs=[buffer], device=device)
    _launch_set_params(buffer, mask)


@wp.kernel
def _forget(
    seeds: wp.array[wp.uint64],
    mask: wp.array[bool],
    # Buffer out: base, decision, next_level, next_boundary
    buffer: Buffer,
):
    worldid = wp.tid()
    if not selects(mask, worldid):
        return
    buffer.next_level[worldid] = FRESH
    buffer.next_boundary[worldid] = NO_END
    if seeds:
        buffer.base[worldid] = seeds[worldid]
        buffer.decision[worldid] = 0


def launch_forget(buffer: Buffer, seeds: wp.array | None, mask: wp.array | None) -> None:
    """Replace the chosen next levels of the masked worlds by fresh levels.

    Args:
        buffer: The buffer.
        seeds: Seeds to draw later fresh levels, shape (nworld,), uint64. If None, the old seeds are kept.
        mask: Selected worlds, shape (nworld,), bool. None selects all.
    """
    device = buffer.base.device
    wp.launch(_forget, buffer.base.shape[0], inputs=[seeds, mask], outputs=[buffer], device=device)
    _launch_set_params(buffer, mask)


@wp.kernel
def _set_params(
    mask: wp.array[bool],
    # Buffer in: param, next_level, base_param, next_boundary, column, other, present, delta, band; out: next_param
    buffer: Buffer,
):
    worldid, k = wp.tid()
    if not selects(mask, worldid):
        return
    level, end = buffer.next_level[worldid], buffer.next_boundary[worldid]
    if level >= 0:
        buffer.next_param[worldid, k] = buffer.param[level, k]
        return
    # a fresh level has the params of its world, within the present intervals, or in a band at the end of an interval
    value = buffer.base_param[worldid, k]
    for i in range(buffer.column.shape[0]):
        if buffer.column[i] == k:
            value = buffer.present[i]
    if end >= 0:
        if buffer.other[end] == k:
            inner = buffer.present[end] - buffer.band[end]
            value = wp.where(buffer.delta[end] > 0.0, wp.max(inner, value), wp.min(inner, value))
    buffer.next_param[worldid, k] = value


def _launch_set_params(buffer: Buffer, mask: wp.array | None) -> None:
    """Write the params of the masked worlds' next levels."""
    wp.launch(_set_params, buffer.next_param.shape, inputs=[mask], outputs=[buffer], device=buffer.base.device)


@wp.func
def _moved(buffer: Buffer, value: float, outcome: float) -> float:
    """Return a level's value after an outcome: the new custom score, or the success rate moved towards the outcome."""
    return wp.where(buffer.score == _CUSTOM, outcome, value + buffer.alpha * (outcome - value))


@wp.kernel
def _update(
    level: wp.array[int],
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    outcome: wp.array[float],
    param: wp.array2d[float],
    mask: wp.array[bool],
    status: wp.array[int],
    boundary: wp.array[int],
    # Buffer in: vacant, score, alpha; out: param; both: seed, episode, value, age, inserted, episodes, successes
    buffer: Buffer,
):
    row = wp.tid()
    if not selects(mask, row):
        return
    if status:
        if status[row] == LayoutStatus.FALLBACK:
            return
    if not (outcome[row] >= 0.0 and outcome[row] <= _MOST_FLOAT):
        return
    if boundary:
        end = boundary[row]
        if end >= 0 and end < buffer.episodes.shape[0]:
            wp.atomic_add(buffer.episodes, end, 1)
            wp.atomic_add(buffer.successes, end, int(outcome[row]))
        if buffer.score == _CUSTOM:
            return
    slot = level[row]
    if slot < FRESH or episode[row] < 0 or episode[row] >= MOST_EPISODES:
        return
    if slot >= 0 and slot < buffer.seed.shape[0]:
        if buffer.seed[slot] == seed[row] and buffer.episode[slot] == episode[row]:
            buffer.value[slot] = _moved(buffer, buffer.value[slot], outcome[row])
            return
    # A fresh level, or a level that was replaced meanwhile. It takes the next of the slots reserved for this row, so
    # that rows never compete for a slot.
    nrow = buffer.inserted.shape[0]
    number = row % nrow + buffer.inserted[row % nrow] * nrow
    if number >= buffer.vacant.shape[0]:
        return
    slot = buffer.vacant[number]
    if slot == NO_SLOT:
        return
    buffer.inserted[row % nrow] = buffer.inserted[row % nrow] + 1
    value = _moved(buffer, 0.5, outcome[row])
    if buffer.age[slot] != EMPTY and score_of(buffer, value) < score_of(buffer, buffer.value[slot]):
        return
    buffer.value[slot] = value
    buffer.seed[slot] = seed[row]
    buffer.episode[slot] = episode[row]
    buffer.age[slot] = 0
    for k in range(buffer.param.shape[1]):
        buffer.param[slot, k] = param[row, k]


def launch_update(buffer: Buffer, episodes: Episodes) -> None:
    """Update the levels of the buffer with the outcomes of episodes. Insert levels that are not in the buffer."""
    dim, device = episodes.level.shape[0], buffer.base.device
    wp.launch(_update, dim, inputs=list(episodes), outputs=[buffer], device=device)


def create_buffer(replay: LevelReplay, layouts: LayoutsView) -> Buffer:
    """Allocate an empty buffer. Its launches write the chosen levels into the next-layout arrays of `layouts`."""
    capacity, nworld, device = replay.capacity, layouts.next_param.shape[0], layouts.next_param.device
    shapes = {
        "seed episode value age cumulative": capacity,
        "count better ages weight": BINS,
        "total_weight total_age": 1,
        "decision level next_level inserted boundary next_boundary": nworld,
        "column other present least most delta band episodes successes": 0,
    }
    # pyrefly: ignore[missing-argument]
    buffer, vacant = allocate(Buffer, Buffer(), shapes, device), min(-(-capacity // _LOWEST), _SHARE * nworld)
    param = np.tile(layouts.default_param.numpy(), (capacity, 1))
    fill_struct(Buffer, buffer, {"param": param, "vacant": np.arange(vacant)}, device)
    buffer.age.fill_(EMPTY)
    for level, boundary in ((buffer.level, buffer.boundary), (buffer.next_level, buffer.next_boundary)):
        level.fill_(FRESH)
        boundary.fill_(NO_END)
    for name in ("next_seed", "next_episode", "next_param"):
        setattr(buffer, name, getattr(layouts, name))
    buffer.base, buffer.base_param = wp.clone(layouts.next_seed), wp.clone(layouts.next_param)
    buffer.score, buffer.alpha = SCORES.index(replay.score), replay.alpha
    return buffer


def bounds_of(buffer: Buffer) -> dict[str, tuple[Any, Any]]:
    """Return the least and greatest allowed value of each array of a buffer, by name.

    `LevelSampler.restore` checks a stored state with them, because kernels use some of these values as indices.
    """
    of_words = {name: getattr(buffer, name).numpy() for name in ("column", "other", "least", "most", "delta", "band")}
    return {
        **dict.fromkeys(arrays_of(buffer), (0, np.inf)),
        **dict.fromkeys(("value", "param", "base_param", "next_param"), (-_MOST_FLOAT, _MOST_FLOAT)),
        **dict.fromkeys(("vacant", "level", "next_level"), (FRESH, buffer.age.shape[0] - 1)),
        **dict.fromkeys(("boundary", "next_boundary"), (NO_END, buffer.column.shape[0] - 1)),
        **dict.fromkeys(("episode", "next_episode"), (ADVANCE, MOST_EPISODES - 1)),
        "age": (EMPTY, np.inf),
        **{name: (values, values) for name, values in of_words.items()},
        **{"present": (of_words["least"], of_words["most"]), "inserted": (0, buffer.vacant.shape[0])},
    }


def arrays_of(buffer: Buffer) -> dict[str, wp.array]:
    """Return the arrays of a buffer by name."""
    values = {name: getattr(buffer, name) for name in Buffer.vars}  # pyrefly: ignore[missing-attribute]
    return {name: value for name, value in values.items() if isinstance(value, wp.array)}
