"""`launch_write_columns`: writes each world's numbers into arrays with a row per world.

A number is a draw, a bound (narrowed by params), or a nominal value times a given factor. Draws are a function of the
key in a layout.
"""

import numpy as np
import warp as wp

from sceniris_gym.config.randomize import DEVIATIONS
from sceniris_gym.device.blocks import block_sync
from sceniris_gym.device.random import BANK_BIT, normals, uniforms
from sceniris_gym.device.transforms import axis_angle_quat, exp_of, log_of, mul_quat
from sceniris_gym.layout.layouts import LayoutsView, next_key
from sceniris_gym.layout.masks import row_of, selects
from sceniris_gym.program.device import SHARED

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_LANES = 128
"""Lanes per world."""
_BANK_BIT = wp.constant(BANK_BIT)
_DEVIATIONS = wp.constant(DEVIATIONS)
_RADIANS = wp.constant(float(np.pi / 180.0))
_KINDS = "fib"
"""Kinds of NumPy's numbers: floats, integers and booleans."""
_FLOAT, _INT = (wp.constant(i) for i in range(2))
FORMS = ("bound", "flag", "scale", "add", "abs", "choice", "rotation")
"""Forms of elements. The first two depend on params, the others on drawn or given numbers."""
_BOUND, _FLAG, _SCALE, _ADD, _ABS, _CHOICE, _ROTATION = (wp.constant(i) for i in range(7))
DISTRIBUTIONS = ("uniform", "log_uniform", "normal", "choice")
_LOG_UNIFORM, _NORMAL, _CHOSEN = (wp.constant(i) for i in range(1, 4))


@wp.struct
class Array:
    """The memory of an array with a row per world.

    Attributes:
        address: Address of the first element.
        stride: Bytes from one row to the next.
        nominal: Address of the model's values, 0 if there are no such values.
        nominal_stride: Bytes from one row of the model's values to the next, SHARED if all worlds share one row.
        kind: Data type of the array's numbers, as an index into `_KINDS`.
    """

    address: wp.uint64
    stride: wp.int64
    nominal: wp.uint64
    nominal_stride: wp.int64
    kind: int


@wp.struct
class Number:
    """A drawn number.

    Attributes:
        name: Hash of the draw's name, which selects the random numbers.
        index: Index among the numbers of this name.
        distribution: Index into `DISTRIBUTIONS`.
        first: Column of the table that holds the distribution's first parameter, or the first choice.
        count: Number of columns from the first to the second parameter, or the number of choices.
        param: Column in a row of param values that replaces the first parameter, -1 if no param narrows the draw.
    """

    name: int
    index: int
    distribution: int
    first: int
    count: int
    param: int


@wp.struct
class Element:
    """A number to write into an array.

    Attributes:
        array: Index of the array to write.
        offset: Index in a row of this array.
        form: Index into `FORMS`.
        number: Column of the drawn or given number. For a rotation, this is the first of three columns. For a bound or
            flag, it is the column of the first param.
        other: For a bound, column of the second param. For a flag, column of the last param. For a choice, column of
            the first value in the table.
        drawn: Index of the drawn array. If it differs from `array`, the written number keeps its nominal ratio to the
            drawn number.
        drawn_offset: Index in a row of the drawn array.
        least: The least value of a bound. A number keeps its nominal value if the drawn array's nominal number is at
            most `least`.
    """

    array: int
    offset: int
    form: int
    number: int
    other: int
    drawn: int
    drawn_offset: int
    least: float


@wp.func
def row_address(array: Array, worldid: int) -> wp.uint64:
    """Return the address of a world's row."""
    return array.address + wp.uint64(array.stride * wp.int64(worldid))


@wp.func
def _put(array: Array, worldid: int, offset: int, value: float):
    """Write a number into a world's row."""
    address = row_address(array, worldid)
    if array.kind == _FLOAT:
        floats = wp.array(ptr=address, shape=(offset + 1,), dtype=float)
        floats[offset] = value
    elif array.kind == _INT:
        integers = wp.array(ptr=address, shape=(offset + 1,), dtype=int)
        integers[offset] = int(value)
    else:
        flags = wp.array(ptr=address, shape=(offset + 1,), dtype=wp.uint8)
        flags[offset] = wp.uint8(value)


@wp.func
def _nominal(array: Array, worldid: int, offset: int) -> float:
    """Return a nominal number of the model."""
    address = array.nominal + wp.uint64(array.nominal_stride * wp.int64(worldid))
    values = wp.array(ptr=address, shape=(offset + 1,), dtype=float)
    return values[offset]


@wp.func
def _bound(element: Element, param: wp.array[float], default_param: wp.array[float]) -> float:
    """Return the bound or the flag that an element takes from params.

    A flag is 1 if the params have the values of the scene file, and 0 otherwise.
    """
    if element.form == _BOUND:
        return wp.max(element.least, wp.max(param[element.number], param[element.other]))
    for k in range(element.number, element.other + 1):
        if param[k] != default_param[k]:
            return 0.0
    return 1.0


@wp.func
def _draw_key(layouts: LayoutsView, row: int, opens: bool):
    """Return seed, episode and stream of the draws of a row, or of a world's next layout if `opens`."""
    if opens:
        seed, episode = next_key(layouts, row)
        return seed, episode, layouts.stream
    return layouts.draw_seed[row], layouts.draw_episode[row], layouts.draw_stream[row]


@wp.func
def _number(number: Number, table: wp.array[float], param: wp.array2d[float], row: int, u: wp.vec4) -> float:
    """Turn uniform random numbers into a draw from a distribution. A negative `row` ignores the params."""
    if number.distribution == _CHOSEN:
        return table[number.first + wp.min(int(u[0] * float(number.count)), number.count - 1)]
    low = table[number.first]
    high = table[number.first + number.count]
    if number.param >= 0 and row >= 0:
        low = param[row, number.param]
        high = param[row, number.param + number.count]
    if number.distribution == _LOG_UNIFORM:
        return low * exp_of(u[0] * log_of(high / low))
    if number.distribution == _NORMAL:
        return low + high * wp.clamp(normals(u[0], u[1])[0], -_DEVIATIONS, _DEVIATIONS)
    return low + (high - low) * u[0]


@wp.func
def _value(
    element: Element, arrays: wp.array[Array], table: wp.array[float], worldid: int, numbers: wp.array[float]
) -> float:
    """Return the value to write for an element, computed from its number: a draw, or a given factor."""
    drawn = arrays[element.drawn]
    nominal = float(0.0)
    if drawn.kind == _FLOAT:
        nominal = _nominal(drawn, worldid, element.drawn_offset)
        if nominal <= element.least:
            return _nominal(arrays[element.array], worldid, element.offset)
    value = numbers[element.number]
    if element.form == _SCALE:
        value = nominal * numbers[element.number]
    elif element.form == _ADD:
        value = nominal + numbers[element.number]
    elif element.form == _CHOICE:
        value = table[element.other + int(numbers[element.number])]
    elif element.form == _ROTATION:
        first = element.drawn_offset - element.drawn_offset % 4
        rotation = _RADIANS * wp.vec3(numbers[element.number], numbers[element.number + 1], numbers[element.number + 2])
        q = wp.vec4()
        for k in range(4):
            q[k] = _nominal(drawn, worldid, first + k)
        turned = mul_quat(q, axis_angle_quat(wp.normalize(rotation), wp.length(rotation)))
        value = turned[element.drawn_offset % 4]
    if element.array != element.drawn:
        value = value / nominal * _nominal(arrays[element.array], worldid, element.offset)
    return value


@wp.kernel
def _write_columns(
    # In:
    mask: wp.array[wp.bool],
    rows: wp.array[int],
    opens: bool,
    # Layouts in: seed, episode, draws*, next*, stream, default_param
    layouts: LayoutsView,
    param: wp.array2d[float],
    # Tables:
    drawn: wp.array[Number],
    table: wp.array[float],
    elements: wp.array[Element],
    arrays: wp.array[Array],
    # Out:
    numbers: wp.array2d[float],
):
    worldid, lane = wp.tid()
    if not selects(mask, worldid):
        return
    if drawn.shape[0] > 0:
        row = row_of(worldid, rows)
        seed, episode, stream = _draw_key(layouts, row, opens)
        if episode < 0:
            return
        narrowed = int(-1)
        if param:
            if (stream & _BANK_BIT) == 0:
                narrowed = row
        for i in range(lane, drawn.shape[0], wp.block_dim()):
            u = uniforms(seed, episode, wp.uint32(stream), drawn[i].name, drawn[i].index)
            numbers[worldid, i] = _number(drawn[i], table, param, narrowed, u)
        block_sync()
    for i in range(lane, elements.shape[0], wp.block_dim()):
        element = elements[i]
        if element.form <= _FLAG:
            value = _bound(element, param[worldid], layouts.default_param)
        else:
            value = _value(element, arrays, table, worldid, numbers[worldid % numbers.shape[0]])
        _put(arrays[element.array], worldid, element.offset, value)


def launch_write_columns(
    nworld: int, mask: wp.array | None, rows: wp.array | None, opens: bool, layouts: LayoutsView, *tables: wp.array
) -> None:
    """Write the elements of the masked worlds.

    Args:
        nworld: Number of worlds.
        mask: Selected worlds, shape (nworld,), bool. None selects all.
        rows: Row of `layouts` for each world, shape (nworld,), int32. If None, world i has row i.
        opens: Whether to write the numbers of the next layouts, instead of the present layouts.
        layouts: The layouts.
        *tables: Rows of `Number`, the parameters of their distributions, rows of `Element`, and rows of `Array`. The
            last array holds the given numbers, shape (1 or nworld, n), or is memory for the drawn numbers, shape
            (nworld, n).
    """
    param = layouts.next_param if opens else layouts.param
    inputs = [mask, rows, opens, layouts, param if param is not None and param.size else None, *tables]
    wp.launch_tiled(_write_columns, dim=[nworld], inputs=inputs, block_dim=_LANES, device=tables[0].device)


def memory_of(array: wp.array, nominal: wp.array | None = None) -> tuple[int, int, int, int, int]:
    """Return the fields of an `Array`. The caller should keep the arrays, which own the memory."""
    if not array.size:  # Warp cannot slice an array without elements
        return 0, 0, 0, 0, 0
    kind = _KINDS.index(array[:1].numpy().dtype.kind)
    if nominal is None:
        return array.ptr, array.strides[0], 0, 0, kind
    return array.ptr, array.strides[0], nominal.ptr, nominal.strides[0] if nominal.shape[0] > 1 else SHARED, kind
