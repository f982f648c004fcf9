"""`FieldDrawer`: draws model fields of masked worlds by the words of a scene, as a function of seed and episode."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
import warp as wp

from sceniris_gym.config.randomize import DEVIATIONS
from sceniris_gym.device.quaternions import mul_quat
from sceniris_gym.device.random import name_hash, named_stream, uniforms
from sceniris_gym.layout.knobs import KnobTable, launch_write
from sceniris_gym.layout.masks import row_of
from sceniris_gym.scene.draws import FieldDraw

wp.set_module_options({"enable_backward": False})

_SCALE, _ADD, _ABS, _CHOICE, _TURN, _COPY = (wp.constant(i) for i in range(6))
"""Forms of a draw; a copy takes the nominal value."""
_UNIFORM, _LOG_UNIFORM, _NORMAL = (wp.constant(i) for i in range(3))
_FLOAT, _INT, _BOOL = (wp.constant(i) for i in range(3))
_FORMS = {"scale": _SCALE, "add": _ADD, "abs": _ABS, "choice": _CHOICE}
_DISTRIBUTIONS = {"uniform": _UNIFORM, "log_uniform": _LOG_UNIFORM, "normal": _NORMAL}
_KINDS = {wp.bool: _BOOL, wp.int32: _INT}
_DEVIATIONS = wp.constant(DEVIATIONS)
LANES = 128
"""Threads that draw a world."""
_RADIANS = wp.constant(float(np.pi / 180.0))


@wp.struct
class Item:
    """One number of a field, and its draw.

    Attributes:
        name: Hash of the name that it is drawn by.
        number: The first drawn number of that name.
        form, distribution: Codes.
        ends: First column of its draw in a row of ends.
        low, high: Columns of the parameters of the distribution behind it, of three numbers for a turn.
        choice: The first value to choose from, of its component.
        nchoice: The number of values.
        field: The field that is written.
        offset: The number in a row of this field.
        drawn: The field that is drawn, which the written one keeps its ratio to if it is another one.
        drawn_offset: The number in a row of that field.
    """

    name: int
    number: int
    form: int
    distribution: int
    ends: int
    low: wp.vec3i
    high: wp.vec3i
    choice: int
    nchoice: int
    field: int
    offset: int
    drawn: int
    drawn_offset: int


@wp.struct
class Fields:
    """The memory of the fields.

    Attributes:
        address: First element.
        nominal: First element of the values of the model.
        nominal_rows: 1, or nworld if worlds differ in them.
        width: Numbers in a row.
        kind: Code of the type.
    """

    address: wp.array[wp.uint64]
    nominal: wp.array[wp.uint64]
    nominal_rows: wp.array[int]
    width: wp.array[int]
    kind: wp.array[int]


class MadeAhead(NamedTuple):
    """Fields that follow from drawn ones, of the next layouts of all worlds.

    Attributes:
        copied: Pairs of arrays, shape (nworld, ...): of the Model, and of the next layouts.
        in_place: Worlds whose present layouts were not made ahead, shape (nworld,), bool.
        written: 1 if somebody else writes to fields that others follow from, shape (1,), int32.
        stale: Worlds of the latest draw in which these fields are to be found anew, shape (nworld,), bool.
        left: 1 if there are such worlds, shape (1,), int32.
    """

    copied: list[tuple[wp.array, wp.array]]
    in_place: wp.array
    written: wp.array
    stale: wp.array
    left: wp.array


@wp.func
def _nominal(fields: Fields, field: int, worldid: int, offset: int) -> float:
    """Return a number of the model as it was made."""
    at = (worldid % fields.nominal_rows[field]) * fields.width[field] + offset
    values = wp.array(ptr=fields.nominal[field], shape=(at + 1,), dtype=float)
    return values[at]


@wp.func
def _put(fields: Fields, field: int, worldid: int, offset: int, value: float):
    """Write a number of a field."""
    at = worldid * fields.width[field] + offset
    if fields.kind[field] == _FLOAT:
        floats = wp.array(ptr=fields.address[field], shape=(at + 1,), dtype=float)
        floats[at] = value
    elif fields.kind[field] == _INT:
        integers = wp.array(ptr=fields.address[field], shape=(at + 1,), dtype=int)
        integers[at] = int(value)
    else:
        flags = wp.array(ptr=fields.address[field], shape=(at + 1,), dtype=wp.uint8)
        flags[at] = wp.uint8(value)


@wp.func
def _number(distribution: int, low: float, high: float, u: wp.vec4) -> float:
    """Return a number of a distribution from uniform ones."""
    if distribution == _LOG_UNIFORM:
        return low * wp.exp(u[0] * wp.log(high / low))
    if distribution == _NORMAL:
        # Box and Muller: 1 - u is never 0
        z = wp.sqrt(-2.0 * wp.log(1.0 - u[0])) * wp.cos(2.0 * wp.pi * u[1])
        return low + high * wp.clamp(z, -_DEVIATIONS, _DEVIATIONS)
    return low + (high - low) * u[0]


@wp.func
def _value(
    item: Item,
    fields: Fields,
    ends: wp.array2d[float],
    choices: wp.array[float],
    worldid: int,
    seed: wp.uint64,
    episode: int,
    stream: wp.uint32,
) -> float:
    """Return what an item writes."""
    nominal = _nominal(fields, item.drawn, worldid, item.drawn_offset)
    if item.form == _COPY:
        return nominal
    u = uniforms(seed, episode, stream, item.name, item.number)
    own = worldid % ends.shape[0]
    number = _number(item.distribution, ends[own, item.ends + item.low[0]], ends[own, item.ends + item.high[0]], u)
    value = number
    if item.form == _SCALE:
        value = nominal * number
    elif item.form == _ADD:
        value = nominal + number
    elif item.form == _CHOICE:
        value = choices[item.choice + wp.min(int(u[0] * float(item.nchoice)), item.nchoice - 1)]
    elif item.form == _TURN:
        turn = wp.vec3()
        for k in range(3):
            v = uniforms(seed, episode, stream, item.name, item.number + k)
            low = item.ends + item.low[k]
            high = item.ends + item.high[k]
            turn[k] = 0.5 * _RADIANS * _number(item.distribution, ends[own, low], ends[own, high], v)
        half = wp.length(turn)
        axis = wp.normalize(turn) * wp.sin(half)
        first = item.drawn_offset - item.drawn_offset % 4
        q = wp.vec4()
        for k in range(4):
            q[k] = _nominal(fields, item.drawn, worldid, first + k)
        turned = mul_quat(q, wp.vec4(wp.cos(half), axis[0], axis[1], axis[2]))
        value = turned[item.drawn_offset % 4]
    if item.field != item.drawn:
        value = value / nominal * _nominal(fields, item.field, worldid, item.offset)
    return value


@wp.kernel
def _draw_fields(
    lanes: int,
    # In:
    mask: wp.array[wp.bool],
    rows: wp.array[int],
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    stream: wp.uint32,
    items: wp.array[Item],
    ends: wp.array2d[float],
    choices: wp.array[float],
    fields: Fields,
    in_place: wp.array[wp.bool],
    written: wp.array[int],
    # Out:
    stale_out: wp.array[wp.bool],
    left_out: wp.array[int],
):
    worldid, lane = wp.tid()
    if stale_out:
        if lane == 0:
            stale_out[worldid] = mask[worldid] and (in_place[worldid] or written[0] != 0)
            if stale_out[worldid]:
                left_out[0] = 1
    if mask:
        if not mask[worldid]:
            return
    row = row_of(worldid, rows)
    if episode[row] < 0:
        return
    for i in range(lane, items.shape[0], lanes):
        item = items[i]
        value = _value(item, fields, ends, choices, worldid, seed[row], episode[row], stream)
        _put(fields, item.field, worldid, item.offset, value)


class FieldDrawer:
    """Draws the fields of a scene's words.

    Args:
        draws: The draws.
        arrays: The fields that they write, each with a row for each world, by name.
        nominal: The values of the model for these fields, with one row or a row for each world.
        nworld: Number of worlds.
        ahead: What else to copy into the same worlds; None copies nothing.

    Attributes:
        numbers: The drawn numbers of each draw, by its name, shape (nworld, number of them): factors of `scale`, terms
            of `add`, and values of `abs` and `choice` (its place in the list, if a value has several numbers).
    """

    def __init__(
        self,
        draws: tuple[FieldDraw, ...],
        arrays: Mapping[str, wp.array],
        nominal: Mapping[str, wp.array],
        nworld: int,
        ahead: MadeAhead | None = None,
    ) -> None:
        self._draws, self._knobbed = draws, None
        names, device = list(arrays), next(iter(arrays.values())).device
        first = np.cumsum([0, *(draw.width for draw in draws)]).tolist()
        copied = [] if ahead is None else ahead.copied
        with wp.ScopedDevice(device):
            numbers = wp.zeros((nworld, first[-1]), dtype=float)
            written = [*arrays.values(), numbers, *(array for array, _ in copied)]
            made = [*(nominal[name] for name in names), numbers, *(array for _, array in copied)]
            widths = [a[:1].numpy().size for a in written]
            sizes = [width // (a.shape[1] if a.ndim > 1 else 1) for width, a in zip(widths, written, strict=True)]
            self._kept, self._nworld, self._fields = (written, made), nworld, Fields()
            self._fields.address, self._fields.nominal = (
                wp.array([a.ptr for a in each], dtype=wp.uint64) for each in (written, made)
            )
            self._fields.nominal_rows = wp.array([a.shape[0] for a in made], dtype=int)
            self._fields.width = wp.array(widths, dtype=int)
            self._fields.kind = wp.array([_KINDS.get(a.dtype, _FLOAT) for a in written], dtype=int)
            items, choices = _items(draws, {name: (k, sizes[k]) for k, name in enumerate(names)})
            for field in range(len(names) + 1, len(written)):
                items += [_copy(field, offset) for offset in range(widths[field])]
            self._items, self._choices = wp.array(items, dtype=Item), wp.array(choices, dtype=float)
            self._ends = wp.array([[end for draw in draws for end in _ends(draw)]], dtype=float, ndim=2)
            self._ahead = [None] * 4 if ahead is None else [*ahead[1:]]
        self.numbers = {draw.name: numbers[:, first[k] : first[k + 1]] for k, draw in enumerate(draws)}

    def use_knobs(self, table: KnobTable) -> None:
        """Draw from intervals that knobs narrow, world by world."""
        places, column = {}, 0
        for draw in self._draws:
            width = len(_ends(draw))
            places[table.of_draws.get(draw.name, "")] = [("ends", column + k, k) for k in range(width)]
            column += width
        if places.keys() & table.first.keys():
            with wp.ScopedDevice(self._ends.device):
                self._ends = wp.array(np.repeat(self._ends.numpy(), self._nworld, axis=0), dtype=float)
                self._default = wp.array(table.default[None], dtype=float)
            self._knobbed = table.targets({"ends": self._ends}, places)

    def launch(
        self,
        mask: wp.array | None,
        seed: wp.array,
        episode: wp.array,
        split: str,
        rows: wp.array | None = None,
        knob: wp.array | None = None,
    ) -> None:
        """Draw the fields of the masked worlds; those of an unknown episode, below 0, keep theirs.

        Args:
            mask: Which worlds, shape (nworld,), bool; all if None.
            seed: Seeds, shape (nrow,), uint64.
            episode: Episodes, shape (nrow,), int32.
            split: "train" or "eval".
            rows: Row of each world, shape (nworld,); None gives world i row i.
            knob: Numbers of the knobs, shape (nrow, nvalue); None is those of the scene file.
        """
        if self._knobbed is not None:
            knob = self._default if knob is None else knob
            launch_write(self._knobbed, self._nworld, mask, knob, self._default[0], rows)
        inputs = [LANES, mask, rows, seed, episode, wp.uint32(named_stream(split)), self._items, self._ends]
        inputs += [self._choices, self._fields, *self._ahead[:2]]
        dim, outputs = (self._nworld, LANES), self._ahead[2:]
        wp.launch(_draw_fields, dim, inputs=inputs, outputs=outputs, device=seed.device)


def _items(draws: tuple[FieldDraw, ...], places: Mapping[str, tuple[int, int]]) -> tuple[list[Item], list[float]]:
    """Return the numbers that draws write, and the values to choose from.

    Args:
        draws: The draws.
        places: Number of each field, and of the numbers of one element. The drawn numbers are the field after these.
    """
    items, choices, column, end = [], [], 0, 0
    for draw in draws:
        begun = len(items)
        config, (field, size), several = draw.config, places[draw.word.field], draw.choice.shape[1] > 1
        new, form = partial(_item, draw, len(choices)), _TURN if draw.is_turn else _FORMS[config.form]
        for element, numbers in zip(draw.rows.tolist(), draw.numbers.tolist(), strict=True):
            components = range(4) if draw.is_turn else draw.components.tolist()
            drawn = [(field, size * element + c) for c in components]
            if draw.is_turn:  # three numbers make all of a quaternion
                numbers = numbers[:1] * 4
            items += [new(number, k, form, at) for k, (number, at) in enumerate(zip(numbers, drawn, strict=True))]
            for name, first, count in draw.word.follow:
                other, wide = places[name]
                written = [(other, wide * element + k) for k in range(first, first + count)]
                items += [new(numbers[0], 0, form, drawn[0], at) for at in written]
        width = draw.width // (len(draw.rows) if config.each else 1)
        for number in range(draw.width):  # a value of several numbers is told by its place in the list
            component = draw.choice.shape[1] if several else number % width
            items.append(new(number, component, _CHOICE if config.choice else _ABS, (len(places), column + number)))
        column += draw.width
        choices += [*draw.choice.T.ravel().tolist(), *range(len(draw.choice) if several else 0)]
        for item in items[begun:]:
            item.ends = end
        end += len(_ends(draw))
    return items, choices


def _ends(draw: FieldDraw) -> list[float]:
    """Return the parameters of a draw, the low ones first; of a choice a number that is not used."""
    return [number for end in draw.config.ends for number in end] or [0.0]


def _copy(field: int, offset: int) -> Item:
    """Return an item that copies a number."""
    item = Item()
    item.form, item.field, item.offset, item.drawn, item.drawn_offset = _COPY, field, offset, field, offset
    return item


def _item(
    draw: FieldDraw,
    choices: int,
    number: int,
    component: int,
    form: int,
    drawn: tuple[int, int],
    written: tuple[int, int] | None = None,
) -> Item:
    """Return an item of a draw: a component of the `drawn` field and offset, and where it is written."""
    item, config, nchoice = Item(), draw.config, len(draw.choice)
    item.name, item.number, item.form = name_hash(f"randomize {draw.name}"), number, form
    item.distribution = _DISTRIBUTIONS[config.distribution]
    for end, values, first in zip(("low", "high"), config.ends, (0, len(config.ends[0])), strict=True):
        one = first + max(min(component, len(values) - 1), 0)
        each = form == _TURN and len(values) == 3
        setattr(item, end, wp.vec3i(*(range(first, first + 3) if each else (one,) * 3)))
    # the values of a component follow each other; one of several components has their places behind them
    alone = config.choice is not None and draw.choice.shape[1] == 1
    item.choice, item.nchoice = choices + (0 if alone else component) * nchoice, nchoice
    item.drawn, item.drawn_offset = drawn
    item.field, item.offset = written or drawn
    return item
