"""`FieldDrawer`: draws model fields of masked worlds by the words of a scene, as a function of seed and episode."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import warp as wp

from sceniris_gym.config.randomize import DEVIATIONS
from sceniris_gym.device.angles import exp_of, log_of, unit_circle
from sceniris_gym.device.blocks import block_sync
from sceniris_gym.device.quaternions import mul_quat
from sceniris_gym.device.random import name_hash, uniforms
from sceniris_gym.device.transforms import axis_angle_quat
from sceniris_gym.layout.knobs import FLOAT, TYPES, KnobTable, launch_write, put_number
from sceniris_gym.layout.masks import row_of
from sceniris_gym.scene.draws import FieldDraw

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = 128
"""Lanes that draw a world."""
_DEVIATIONS = wp.constant(DEVIATIONS)
_RADIANS = wp.constant(float(np.pi / 180.0))
_FORMS = ("scale", "add", "abs", "choice", "turn")
_SCALE, _ADD, _ABS, _CHOICE, _TURN = (wp.constant(i) for i in range(5))
_DISTRIBUTIONS = ("uniform", "log_uniform", "normal", "choice")
_LOG_UNIFORM, _NORMAL, _CHOSEN = (wp.constant(i) for i in range(1, 4))


@wp.struct
class Number:
    """A number that is drawn.

    Attributes:
        name: Hash of the name that it is drawn by.
        index: Its place among the numbers of that name.
        distribution: Its code.
        first: Column of its first parameter in the table, or of the first number to choose from.
        count: Columns from there to its second parameter, or how many numbers there are to choose from.
    """

    name: int
    index: int
    distribution: int
    first: int
    count: int


@wp.struct
class Item:
    """A number of a field that is written.

    Attributes:
        number: Column of the drawn number, or of the first of three for a turn.
        form: Its code.
        choice: Column of the first value to choose from by the number.
        field: The field that is written.
        offset: The place in a row of this field.
        drawn: The field that is drawn, which the written one keeps its ratio to if it is another one.
        drawn_offset: The place in a row of that field.
    """

    number: int
    form: int
    choice: int
    field: int
    offset: int
    drawn: int
    drawn_offset: int


@wp.struct
class Field:
    """The memory of a field.

    Attributes:
        address: First element.
        nominal: First element of the values of the model.
        nominal_rows: 1, or nworld if worlds differ in them.
        width: Numbers in a row.
        kind: The number of its type in TYPES.
    """

    address: wp.uint64
    nominal: wp.uint64
    nominal_rows: int
    width: int
    kind: int


@wp.func
def _nominal(field: Field, worldid: int, offset: int) -> float:
    """Return a number of the model as it was made."""
    at = (worldid % field.nominal_rows) * field.width + offset
    values = wp.array(ptr=field.nominal, shape=(at + 1,), dtype=float)
    return values[at]


@wp.func
def _number(number: Number, table: wp.array[float], u: wp.vec4) -> float:
    """Return a number of a distribution from uniform ones."""
    if number.distribution == _CHOSEN:
        return table[number.first + wp.min(int(u[0] * float(number.count)), number.count - 1)]
    low = table[number.first]
    high = table[number.first + number.count]
    if number.distribution == _LOG_UNIFORM:
        return low * exp_of(u[0] * log_of(high / low))
    if number.distribution == _NORMAL:
        # Box and Muller: 1 - u is never 0
        z = wp.sqrt(-2.0 * log_of(1.0 - u[0])) * unit_circle(2.0 * wp.pi * u[1])[0]
        return low + high * wp.clamp(z, -_DEVIATIONS, _DEVIATIONS)
    return low + (high - low) * u[0]


@wp.func
def _value(
    item: Item, fields: wp.array[Field], table: wp.array[float], worldid: int, numbers: wp.array[float]
) -> float:
    """Return what an item writes."""
    nominal = float(0.0)
    if fields[item.drawn].kind == FLOAT:
        nominal = _nominal(fields[item.drawn], worldid, item.drawn_offset)
    value = numbers[item.number]
    if item.form == _SCALE:
        value = nominal * numbers[item.number]
    elif item.form == _ADD:
        value = nominal + numbers[item.number]
    elif item.form == _CHOICE:
        value = table[item.choice + int(numbers[item.number])]
    elif item.form == _TURN:
        first = item.drawn_offset - item.drawn_offset % 4
        turn = _RADIANS * wp.vec3(numbers[item.number], numbers[item.number + 1], numbers[item.number + 2])
        q = wp.vec4()
        for k in range(4):
            q[k] = _nominal(fields[item.drawn], worldid, first + k)
        turned = mul_quat(q, axis_angle_quat(wp.normalize(turn), wp.length(turn)))
        value = turned[item.drawn_offset % 4]
    if item.field != item.drawn:
        value = value / nominal * _nominal(fields[item.field], worldid, item.offset)
    return value


@wp.kernel
def _draw_fields(
    # In:
    mask: wp.array[wp.bool],
    rows: wp.array[int],
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    stream: wp.array[int],
    drawn: wp.array[Number],
    table: wp.array2d[float],
    items: wp.array[Item],
    fields: wp.array[Field],
    # Out:
    numbers: wp.array2d[float],
):
    worldid, lane = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    row = row_of(worldid, rows)
    if episode[row] < 0:
        return
    parameters = table[worldid % table.shape[0]]
    for i in range(lane, drawn.shape[0], wp.block_dim()):
        u = uniforms(seed[row], episode[row], wp.uint32(stream[row]), drawn[i].name, drawn[i].index)
        numbers[worldid, i] = _number(drawn[i], parameters, u)
    block_sync()
    for i in range(lane, items.shape[0], wp.block_dim()):
        value = _value(items[i], fields, parameters, worldid, numbers[worldid])
        field = fields[items[i].field]
        put_number(field.address, worldid * field.width + items[i].offset, field.kind, value)


class FieldDrawer:
    """Draws the fields of a scene's words.

    Args:
        draws: The draws; may be empty.
        arrays: The fields that they write, each with a row for each world, by name.
        nominal: The values of the model for these fields, with one row or a row for each world.
        nworld: Number of worlds.

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
    ) -> None:
        self._draws, self._nworld, self._knobbed = draws, nworld, None
        self._kept = arrays, nominal  # they own the memory
        fields, places = [], {}
        for name, array in arrays.items():
            width, made = array[:1].numpy().size, nominal[name]
            kind = TYPES.index(array.dtype) if array.dtype in TYPES else FLOAT
            places[name] = len(fields), width // (array.shape[1] if array.ndim > 1 else 1)
            fields.append((array.ptr, made.ptr, made.shape[0], width, kind))
        drawn, items, table, self._first = _tables(draws, places)
        device = next((array.device for array in arrays.values()), None)
        with wp.ScopedDevice(device):
            self._fields, self._drawn, self._items = (
                wp.array(np.array(rows, dtype.numpy_dtype()), dtype=dtype)
                for rows, dtype in ((fields, Field), (drawn, Number), (items, Item))
            )
            self._table = wp.array([table], dtype=float, ndim=2)
            self._numbers = wp.zeros((nworld, len(drawn)), dtype=float)
        columns = np.cumsum([draw.width for draw in draws]).tolist()
        self.numbers = {d.name: self._numbers[:, end - d.width : end] for d, end in zip(draws, columns, strict=True)}

    def use_knobs(self, table: KnobTable) -> None:
        """Draw from intervals that knobs narrow, world by world."""
        places: dict[str, list[tuple[str, int, int]]] = {}
        for draw, first in zip(self._draws, self._first, strict=True):
            own = [("table", first + k, k) for k in range(2 * len(draw.config.ends[0]))]
            places.setdefault(table.of_draws.get(draw.name, ""), []).extend(own)
        if places.keys() & table.first.keys():
            with wp.ScopedDevice(self._table.device):
                self._table = wp.array(np.repeat(self._table.numpy(), self._nworld, axis=0), dtype=float)
                self._default = wp.array(table.default[None], dtype=float)
            self._knobbed = table.targets({"table": self._table}, places)

    def launch(
        self,
        mask: wp.array | None,
        seed: wp.array,
        episode: wp.array,
        stream: wp.array,
        rows: wp.array | None = None,
        knob: wp.array | None = None,
    ) -> None:
        """Draw the fields of the masked worlds by the keys of their rows; without a key, they keep theirs.

        Args:
            mask: Which worlds, shape (nworld,), bool; all if None.
            seed: Seeds, shape (nrow,), uint64.
            episode: Episodes, shape (nrow,), int32; -1 for no key.
            stream: Streams of the draws, shape (nrow,), int32; those of banks draw with the knobs of the scene file.
            rows: Row of each world, shape (nworld,); None gives world i row i.
            knob: Numbers of the knobs, shape (nrow, nvalue); None is those of the scene file.
        """
        if not self._draws:
            return
        if self._knobbed is not None:
            knob = self._default if knob is None else knob
            launch_write(self._knobbed, self._nworld, mask, knob, self._default[0], rows, stream)
        inputs = [mask, rows, seed, episode, stream, self._drawn, self._table]
        inputs += [self._items, self._fields, self._numbers]
        wp.launch_tiled(_draw_fields, dim=[self._nworld], inputs=inputs, block_dim=LANES, device=seed.device)


def _tables(
    draws: tuple[FieldDraw, ...], places: Mapping[str, tuple[int, int]]
) -> tuple[list, list, list[float], list[int]]:
    """Return rows of `Number` and of `Item`, the table of their parameters, and the first column of each draw there.

    Args:
        draws: The draws.
        places: Number of each field, and of the numbers of one element.
    """
    numbers, items, table, columns = [], [], [], []
    for draw in draws:
        config, nchoice, begin = draw.config, len(draw.choice), len(numbers)
        name, nlow, (field, size) = name_hash(f"randomize {draw.name}"), len(config.ends[0]), places[draw.word.field]
        several = draw.choice.shape[1] > 1  # of several numbers each: the drawn one is the place in the list
        width = draw.width // (len(draw.rows) if config.each else 1)
        distribution = _DISTRIBUTIONS.index("choice" if nchoice else config.distribution)
        columns.append(len(table))
        for index in range(draw.width):
            first = len(table) + (min(index % width, nlow - 1) if nlow else 0)
            numbers.append((name, index, distribution, first, nlow or nchoice))
        table += [*config.ends[0], *config.ends[1], *range(nchoice if several else 0)]
        form = "turn" if draw.is_turn else "abs" if config.choice and not several else config.form
        components = range(4) if draw.is_turn else draw.components.tolist()
        for element, own in zip(draw.rows.tolist(), draw.numbers.tolist(), strict=True):
            for k, component in enumerate(components):
                number, at = begin + own[0 if draw.is_turn else k], (field, size * element + component)
                items.append((number, _FORMS.index(form), len(table) + k * nchoice, *at, *at))
            for other, start, count in draw.word.follow:
                written, at = places[other], (field, size * element + draw.word.first)
                offsets = range(written[1] * element + start, written[1] * element + start + count)
                items += [(begin + own[0], _FORMS.index(form), len(table), written[0], k, *at) for k in offsets]
        table += draw.choice.T.ravel().tolist()
    return numbers, items, table, columns
