"""`FieldDrawer`: draws model fields of masked worlds by the words of a scene, as a function of seed and episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import warp as wp

from sceniris_gym.config.randomize import DEVIATIONS
from sceniris_gym.device.quaternions import mul_quat
from sceniris_gym.device.random import uniforms
from sceniris_gym.layout.knobs import KnobTable, launch_write
from sceniris_gym.scene.draws import FieldDraw
from sceniris_gym.sim.named_random import name_hash, named_stream

wp.set_module_options({"enable_backward": False})

_SCALE, _ADD, _ABS, _CHOICE, _TURN = (wp.constant(i) for i in range(5))
"""Forms of a draw."""
_UNIFORM, _LOG_UNIFORM, _NORMAL = (wp.constant(i) for i in range(3))
_FLOAT, _INT, _BOOL = (wp.constant(i) for i in range(3))
_FORMS = {"scale": _SCALE, "add": _ADD, "abs": _ABS, "choice": _CHOICE}
_DISTRIBUTIONS = {"uniform": _UNIFORM, "log_uniform": _LOG_UNIFORM, "normal": _NORMAL}
_KINDS = {wp.bool: _BOOL, wp.int32: _INT}
_DEVIATIONS = wp.constant(DEVIATIONS)
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


@wp.kernel
def _draw_fields(
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
):
    worldid, i = wp.tid()
    if not mask[worldid]:
        return
    row = int(worldid)
    if rows:
        row = rows[worldid]
    if episode[row] < 0:
        return
    item = items[i]
    u = uniforms(seed[row], episode[row], stream, item.name, item.number)
    own = worldid % ends.shape[0]
    number = _number(item.distribution, ends[own, item.ends + item.low[0]], ends[own, item.ends + item.high[0]], u)
    nominal = _nominal(fields, item.drawn, worldid, item.drawn_offset)
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
            v = uniforms(seed[row], episode[row], stream, item.name, item.number + k)
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
    _put(fields, item.field, worldid, item.offset, value)


class FieldDrawer:
    """Draws the fields of a scene's words.

    Args:
        draws: The draws.
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
        self._draws, self._knobbed = draws, None
        names, device = list(arrays), next(iter(arrays.values())).device
        first = np.cumsum([0, *(draw.width for draw in draws)]).tolist()
        with wp.ScopedDevice(device):
            numbers = wp.zeros((nworld, first[-1]), dtype=float)
            written, made = [*arrays.values(), numbers], [*(nominal[name] for name in names), numbers]
            sizes = [a[:1].numpy().size // (a.shape[1] if a.ndim > 1 else 1) for a in written]
            widths = [size * (a.shape[1] if a.ndim > 1 else 1) for size, a in zip(sizes, written, strict=True)]
            self._kept, self._nworld, self._fields = (written, made), nworld, Fields()
            self._fields.address, self._fields.nominal = (
                wp.array([a.ptr for a in each], dtype=wp.uint64) for each in (written, made)
            )
            self._fields.nominal_rows = wp.array([a.shape[0] for a in made], dtype=int)
            self._fields.width = wp.array(widths, dtype=int)
            self._fields.kind = wp.array([_KINDS.get(a.dtype, _FLOAT) for a in written], dtype=int)
            items, choices = _items(draws, {name: (k, sizes[k]) for k, name in enumerate(names)})
            self._items, self._choices = wp.array(items, dtype=Item), wp.array(choices, dtype=float)
            self._ends = wp.array([[end for draw in draws for end in _ends(draw)]], dtype=float, ndim=2)
        self.numbers = {draw.name: numbers[:, first[k] : first[k + 1]] for k, draw in enumerate(draws)}

    def use_knobs(self, table: KnobTable, keys: Sequence[str]) -> None:
        """Draw from intervals that knobs narrow, world by world.

        Args:
            table: The knobs.
            keys: Key of each draw in the scene file.
        """
        first = np.cumsum([0, *(len(_ends(draw)) for draw in self._draws)]).tolist()
        places = {
            key: [("ends", column + k, k) for k in range(len(_ends(draw)))]
            for key, draw, column in zip(keys, self._draws, first, strict=False)
        }
        if places.keys() & table.first.keys():
            with wp.ScopedDevice(self._ends.device):
                self._ends = wp.array(np.repeat(self._ends.numpy(), self._nworld, axis=0), dtype=float)
                self._default = wp.array(table.default, dtype=float)
            self._knobbed = table.targets({"ends": self._ends}, places)

    def launch(
        self,
        mask: wp.array,
        seed: wp.array,
        episode: wp.array,
        split: str,
        rows: wp.array | None = None,
        knob: wp.array | None = None,
    ) -> None:
        """Draw the fields of the masked worlds; those of an unknown episode, below 0, keep theirs.

        Args:
            mask: Which worlds, shape (nworld,), bool.
            seed: Seeds, shape (nrow,), uint64.
            episode: Episodes, shape (nrow,), int32.
            split: "train" or "eval".
            rows: Row of each world, shape (nworld,); None gives world i row i.
            knob: Numbers of the knobs, shape (nrow, nvalue); None is those of the scene file.
        """
        if self._knobbed is not None:
            default = self._default
            launch_write(self._knobbed, mask, default.reshape((1, -1)) if knob is None else knob, default, rows)
        inputs = [mask, rows, seed, episode, wp.uint32(named_stream(split)), self._items, self._ends]
        inputs += [self._choices, self._fields]
        wp.launch(_draw_fields, dim=(self._nworld, len(self._items)), inputs=inputs, device=mask.device)


def _items(draws: tuple[FieldDraw, ...], places: Mapping[str, tuple[int, int]]) -> tuple[list[Item], list[float]]:
    """Return the numbers that draws write, and the values to choose from.

    Args:
        draws: The draws.
        places: Number of each field, and of the numbers of one element. The drawn numbers are the field after these.
    """
    items, choices, column, end = [], [], 0, 0
    for draw in draws:
        begun = len(items)
        for element, numbers in zip(draw.rows.tolist(), draw.numbers.tolist(), strict=True):
            items += _of_element(draw, places, element, numbers, len(choices))
        several = draw.choice.shape[1] > 1
        for number in range(draw.width):  # a value of several numbers is told by its place in the list
            component = (
                draw.choice.shape[1]
                if several
                else number % (draw.width // (len(draw.rows) if draw.config.each else 1))
            )
            form = _CHOICE if draw.config.choice else _ABS
            items.append(_item(draw, number, component, form, len(choices), (len(places), column)))
            column += 1
        choices += [*draw.choice.T.ravel().tolist(), *range(len(draw.choice) if several else 0)]
        for item in items[begun:]:
            item.ends = end
        end += len(_ends(draw))
    return items, choices


def _ends(draw: FieldDraw) -> list[float]:
    """Return the parameters of a draw, the low ones first; of a choice a number that is not used."""
    return [number for end in draw.config.ends for number in end] or [0.0]


def _of_element(
    draw: FieldDraw, places: Mapping[str, tuple[int, int]], element: int, numbers: list[int], choices: int
) -> list[Item]:
    """Return the numbers of an element of the field, and of the fields that follow it."""
    field, size = places[draw.word.field]
    if draw.is_turn:
        return [_item(draw, numbers[0], 0, _TURN, choices, (field, 4 * element + k)) for k in range(4)]
    form, drawn = _FORMS[draw.config.form], [(field, size * element + int(c)) for c in draw.components]
    items = [_item(draw, number, k, form, choices, drawn[k]) for k, number in enumerate(numbers)]
    for name, first, count in draw.word.follow:
        other, wide = places[name]
        written = [(other, wide * element + k) for k in range(first, first + count)]
        items += [_item(draw, numbers[0], 0, form, choices, drawn[0], place) for place in written]
    return items


def _item(
    draw: FieldDraw,
    number: int,
    component: int,
    form: int,
    choices: int,
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
