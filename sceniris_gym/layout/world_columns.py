"""`WorldColumns`: numbers that differ between worlds, in one table, written by one kernel.

The numbers are bounds that params narrow, draws of physics and appearance, and factors that tasks give.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import warp as wp

from sceniris_gym.device.random import name_hash
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.params import ParamTable
from sceniris_gym.layout.write_columns import (
    DISTRIBUTIONS,
    FORMS,
    Array,
    Element,
    Number,
    launch_write_columns,
    memory_of,
)
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program, copied, fill_struct
from sceniris_gym.program.device_statics import Statics
from sceniris_gym.scene.draws import CONSTRAINING, FieldDraw

Masses = tuple[wp.array, wp.array]
"""The fields `body_mass` and `body_ipos` of the Model of some worlds, with their current values."""
_MASSES = {"body_mass": "body_weight", "body_ipos": "body_center"}
"""Fields of `Statics` by field of the model."""


class WorldColumns:
    """Writes numbers that differ between worlds into arrays.

    Args:
        nworld: Number of worlds.
        arrays: The arrays to write, by name, each with a row per world.
        nominal: The model's values of drawn or scaled arrays, by name, with one row or a row per world.
        draws: The draws of physics and appearance, which may be empty.
        scaled: Array elements that get a nominal value times a given number. Use them only without draws. Each entry
            has the name of the array, the index in its row, the index in the nominal row, and the column of the number.
        given: The given numbers, shape (1 or nworld, n). None if nothing is scaled, or if each call of
            `launch` passes the numbers.
        params: The params of the worlds. A param sets bounds in these arrays, or narrows a draw.

    Attributes:
        numbers: The drawn numbers by name of the draw, shape (nworld, width): factors of `scale`, terms of `add`, and
            values of `abs` and `choice`. A choice among sets of several numbers is given by its index instead.
    """

    def __init__(
        self,
        nworld: int,
        arrays: Mapping[str, wp.array],
        nominal: Mapping[str, wp.array],
        draws: Sequence[FieldDraw] = (),
        scaled: Sequence[tuple[str, int, int, int]] = (),
        given: wp.array | None = None,
        params: ParamTable | None = None,
    ) -> None:
        self._nworld, self._draws, self._kept = nworld, draws, (arrays, nominal)  # keeps the arrays' memory alive
        places = {name: (i, element_size(array)) for i, (name, array) in enumerate(arrays.items())}
        numbers, elements, table = _tables(draws, places)
        elements += [(places[n][0], i, FORMS.index("scale"), k, 0, places[n][0], at, -np.inf) for n, i, at, k in scaled]
        elements += [] if params is None else _bounds(params, arrays)
        memory = [memory_of(array, nominal.get(name)) for name, array in arrays.items()]
        with wp.ScopedDevice(next((array.device for array in arrays.values()), None)):
            self._drawn, self._elements, self._memory = (
                wp.array(np.array(rows, dtype.numpy_dtype()), dtype=dtype)  # pyrefly: ignore[missing-attribute]
                for rows, dtype in ((numbers, Number), (elements, Element), (memory, Array))
            )
            self._table = wp.array(table, dtype=float)
            self._given = wp.zeros((nworld, len(numbers)), dtype=float) if given is None else given
        columns = np.cumsum([draw.width for draw in draws]).tolist()
        self.numbers = {d.name: self._given[:, end - d.width : end] for d, end in zip(draws, columns, strict=True)}
        self._no_layouts = LayoutsView()  # pyrefly: ignore[missing-argument]
        self._narrowed: list[int] | None = None  # column of each draw's param, once there are params
        if params is not None:
            self.use_params(params)

    def use_params(self, params: ParamTable) -> None:
        """Narrow the intervals of draws by params, separately in each world.

        Raises:
            ArgumentError: Other params already narrow the draws.
        """
        columns = [params.first.get(params.of_draws.get(draw.name, ""), -1) for draw in self._draws]
        if columns == self._narrowed:
            return
        if self._narrowed is not None and max(*columns, *self._narrowed) >= 0:
            raise ArgumentError(
                "params: another randomizer of the same Batch draws with other params. Give both the same params, "
                "or make a separate Batch for this randomizer."
            )
        self._narrowed = columns
        if max(columns, default=-1) < 0:
            return
        numbers, begin = self._drawn.numpy(), 0
        for draw, column in zip(self._draws, columns, strict=True):
            own = numbers[begin : begin + draw.width]
            own["param"] = -1 if column < 0 else column + own["first"] - own["first"][0]
            begin += draw.width
        self._drawn.assign(numbers)

    def launch(
        self,
        mask: wp.array | None,
        layouts: LayoutsView | None = None,
        rows: wp.array | None = None,
        *,
        given: wp.array | None = None,
        opens: bool = False,
    ) -> None:
        """Write the numbers of the masked worlds.

        If the key of a world's draws is unknown, the drawn numbers of this world do not change.

        Args:
            mask: Selected worlds, shape (nworld,), bool. None selects all.
            layouts: The layouts, with the keys of their draws and their params. For a layout from the bank, numbers are
                drawn with the params of the scene file. None if there are only given numbers.
            rows: Row of `layouts` for each world, shape (nworld,), int32. If None, world i has row i.
            given: The given numbers, shape (1 or nworld, n).
            opens: Whether to write the numbers of the next layouts, instead of the present layouts.
        """
        if not self._elements.size:
            return
        tables = self._drawn, self._table, self._elements, self._memory, self._given if given is None else given
        launch_write_columns(self._nworld, mask, rows, opens, layouts or self._no_layouts, *tables)


def _bounds(params: ParamTable, arrays: Mapping[str, wp.array]) -> list[tuple]:
    """Return rows of `Element` for the bounds and flags that params set in arrays with a row per world."""
    found: dict[tuple[str, int], tuple] = {}
    names = [*arrays]
    for key, param in params.params.items():
        for name, offset, k in (copy for copy in param.copies if copy[0] in arrays):
            column = other = params.first[key] + k
            form, least = "bound", -np.inf
            if arrays[name].dtype is wp.bool:
                form, other = "flag", column + len(param.default) - 1
            elif param.form == "clearance":
                least = arrays[name][:1].numpy().flat[offset]
                # a pair of objects that both have a clearance keeps the greater of the two, in `column` and `other`
                _, _, _, column, *_ = found.get((name, offset), (0, 0, 0, column))
            number = names.index(name)
            found[name, offset] = number, offset, FORMS.index(form), column, other, number, offset, least
    return [*found.values()]


def element_size(array: wp.array) -> int:
    """Return how many numbers each element has, in an array with a row per world."""
    row = array[:1].numpy()
    return row.size // (row.shape[1] if array.ndim > 1 else 1)


def _tables(
    draws: Sequence[FieldDraw], places: Mapping[str, tuple[int, int]]
) -> tuple[list[tuple], list[tuple], list[float]]:
    """Return rows of `Number`, rows of `Element`, and the table with the parameters of the numbers' distributions.

    Args:
        draws: The draws.
        places: Index of each array, and how many numbers each of its elements has.
    """
    numbers, elements, table = [], [], []
    for draw in draws:
        config, nchoice, begin = draw.config, len(draw.choice), len(numbers)
        name, nlow, (array, size) = name_hash(f"randomize {draw.name}"), len(config.ends[0]), places[draw.word.field]
        several = draw.choice.shape[1] > 1  # choices of several numbers each: the index in the list is drawn
        width = draw.width // (len(draw.rows) if config.each else 1)
        distribution = DISTRIBUTIONS.index("choice" if nchoice else config.distribution)
        for index in range(draw.width):
            first = len(table) + (min(index % width, nlow - 1) if nlow else 0)
            numbers.append((name, index, distribution, first, nlow or nchoice, -1))
        table += [*config.ends[0], *config.ends[1], *range(nchoice if several else 0)]
        form = FORMS.index("rotation" if draw.is_rotation else "abs" if config.choice and not several else config.form)
        # a shared body or joint of variants is 0 in worlds whose variant lacks it, and stays 0
        least = 0.0 if draw.word.field in CONSTRAINING else -np.inf
        components = range(4) if draw.is_rotation else draw.components.tolist()
        for element, own in zip(draw.rows.tolist(), draw.numbers.tolist(), strict=True):
            for k, component in enumerate(components):
                number, at = begin + own[0 if draw.is_rotation else k], (array, size * element + component)
                elements.append((*at, form, number, len(table) + k * nchoice, *at, least))
            for other, start, count in draw.word.follow:
                written, at = places[other], (array, size * element + draw.word.first)
                offsets = range(written[1] * element + start, written[1] * element + start + count)
                elements += [(written[0], k, form, begin + own[0], len(table), *at, least) for k in offsets]
        table += draw.choice.T.ravel().tolist()
    return numbers, elements, table


def search_columns(
    compiled: CompiledScene, nworld: int, params: ParamTable, by_world: Sequence[str] = (), masses: Masses | None = None
) -> tuple[WorldColumns, Program, Statics | None]:
    """Return the WorldColumns of a search for layouts, with the program and the statics that they write into.

    Stability depends on masses and centres of mass, so the search draws these too. A reset to the same layout draws the
    same values.

    Args:
        compiled: The scene.
        nworld: Number of worlds.
        params: The params of the worlds.
        by_world: Further fields of the program that get a row per world.
        masses: The masses of the worlds. If None, masses are drawn.
    """
    program, statics, nominal, arrays = copied(Program, compiled.program), compiled.statics, {}, {}
    draws, scaled, given = (), (), None
    for name in dict.fromkeys([*by_world, *(name for param in params.params.values() for name, _, _ in param.copies)]):
        shared = getattr(program, name)
        rows = np.repeat(shared.numpy(), nworld, axis=0)
        arrays[name] = wp.array(rows, dtype=shared.dtype, ndim=2, device=shared.device)
        setattr(program, name, arrays[name])
    # inertias follow masses in the model, but do not affect stability
    drawn = [d._replace(word=d.word._replace(follow=())) for d in compiled.scene.draws if d.word.field in _MASSES]
    if statics is not None and (drawn if masses is None else max(a.shape[0] for a in masses) > 1):
        statics = copied(Statics, compiled.statics)
        usual = {field: getattr(statics, name) for field, name in _MASSES.items()}
        rows = {_MASSES[field]: np.repeat(array.numpy(), nworld, axis=0) for field, array in usual.items()}
        fill_struct(Statics, statics, rows, compiled.device)
        arrays |= {field: getattr(statics, name) for field, name in _MASSES.items()}
        draws, nominal = drawn, usual
        if masses is not None:
            draws, nominal = (), dict(zip(_MASSES, masses, strict=True))
            scaled, given = _shares(compiled, usual["body_mass"])
    return WorldColumns(nworld, arrays, nominal, draws, scaled, given, params), program, statics


def _shares(compiled: CompiledScene, nominal: wp.array) -> tuple[list[tuple[str, int, int, int]], wp.array]:
    """Return the arguments `scaled` and `given` that let WorldColumns fill statics with the masses of a Model.

    Statics is the data of the standing test. It gets each centre of mass unchanged, and each mass times the fraction of
    its weight that gravity compensation does not carry.
    """
    mass, weight = compiled.mjm.body_mass, nominal.numpy()[0]
    share = np.divide(weight, mass, out=np.zeros(len(mass)), where=mass > 0.0)
    scaled = []
    for body, simulated in enumerate(compiled.scene.sim_bodies.tolist()):
        scaled.append(("body_mass", body, simulated, body))
        scaled += [("body_ipos", 3 * body + k, 3 * simulated + k, len(share)) for k in range(3)]
    return scaled, wp.array([[*share, 1.0]], dtype=float, device=compiled.device)
