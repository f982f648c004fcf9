"""`ModelFields`: fields of a mujoco_warp Model with a row for each world, and the fields derived from them."""

from typing import Any

import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.config.randomize import WORDS, Word
from sceniris_gym.errors import ArgumentError, FixedError, SceneMismatchError, check_names
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.masks import as_floats
from sceniris_gym.layout.world_columns import WorldColumns, element_size
from sceniris_gym.scene.draws import drawn_fields, nominal_values
from sceniris_gym.scene.field_table import FIELDS, OPTIONS, check_field, field_rows
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.derived import FOLLOWS, launch_derived
from sceniris_gym.sim.derived_tables import Derived, derived_tables
from sceniris_gym.sim.rest import GAINS, launch_holding, scene_rest
from sceniris_gym.sim.variants import fields_of_variants

NAMED = "named_by_make_worlds"
"""Attribute that `make_worlds` sets on a Model: the names of its argument `fields`."""
_BEFORE = "rows_before_draws"
"""Attribute of a Model with the values of its fields before any draw, by name."""


class ModelFields:
    """Fields of a Model that have a row for each world.

    Args:
        scene: The scene with all variants. The worlds simulate `scene.sim`.
        m: The Model.
        d: Data of the worlds.
        grow: If true, a requested field with one shared row is expanded to a row for each world. If false, such a field
            is rejected, because expanding replaces its array, which your code may have captured in a graph.

    Attributes:
        rest: The RestMap of the worlds: controls and activations that hold a pose.
        columns: The WorldColumns that draw the entries of the scene's `randomize`.
        asked: Names of the fields that were requested for writing.
        varied: Nominal values of the fields in which variants differ, by name, with a row for each world. Empty without
            variants. Each reset first writes the present variants' values here, because draws start from them.
    """

    def __init__(self, scene: SceneModel, m: mjw.Model, d: mjw.Data, *, grow: bool) -> None:
        self._roots = [scene.sim.bodies[name] for name in scene.config.variants]
        names, scene = fields_of_variants(scene), scene.sim
        self._scene, self._model, self._data, self._nworld, self._grow = scene, m, d, d.nworld, grow
        self.varied = {name: self._before(name, every=True) for name in names}
        self._nominal: dict[str, wp.array] = {}
        self._known: dict[str, wp.array] = {}
        self._derived: Derived | None = None
        self._closed, self.rest = False, scene_rest(scene, m.qpos0.device, d.nworld)
        masses = scene.mjm.body_mass * (1.0 - scene.mjm.body_gravcomp)
        self._is_heavy = any(masses[first:end].any() for _, first, end, _ in self.rest.carried.numpy())
        self.asked: set[str] = set()
        self._beside = wp.Stream(m.qpos0.device) if scene.draws and m.qpos0.device.is_cuda else None
        arrays = {name: self.wide(name, "randomize") for name in drawn_fields(scene.draws)}
        self.columns = WorldColumns(d.nworld, arrays, self._nominal, scene.draws)
        self._scaled: dict[tuple[str, str], WorldColumns] = {}
        for name in getattr(m, NAMED, ()):
            self.ask(name, where="make_worlds")

    def ask(self, name: str, of: str | None = None, *, where: str = "model_field") -> wp.array:
        """Return a field with a row for each world, or a view of its part for one element, object or robot.

        Args:
            name: The field's name in mujoco_warp's Model.
            of: A model element, an object or a robot, see `field_rows`. None returns the whole field.
            where: Name of the caller. Errors begin with this name.

        Raises:
            UnknownNameError: There is no such field or name.
            ArgumentError: Steps do not read the field, or the field is first requested after the first reset.
            SceneMismatchError: All worlds share one row of the field, and `grow` is false.
        """
        check_field(name, self._scene.mjm, where)
        rows = None if of is None else field_rows(self._scene.mjm, self._scene.bodies, name, of, where)
        if name not in self._nominal and self._closed:
            raise ArgumentError(
                f"{where}: '{name}' is requested too late, because captured steps already use one row for all worlds. "
                "Request it in Task.bind, or before the first reset."
            )
        array = self.wide(name, where)
        self.asked.add(name)
        return array if rows is None else array[:, rows]

    def wide(self, name: str, where: str = "model_field") -> wp.array:
        """Give a field and its dependent fields a row for each world, and return the field's array."""
        for each in with_followers(name):
            if each in self._nominal:
                continue
            array = getattr(owner(self._model, each), each)
            if array.size and array.shape[0] != self._nworld and not self._grow:
                raise SceneMismatchError(
                    f"{where}: model.{each} should have a row for each of {self._nworld} worlds, got {array.shape[0]}. "
                    f'Make the Model by make_worlds(compiled, {self._nworld}, fields=("{name}",)).'
                )
            self._nominal[each] = self._before(each)
            self._known[each] = widen(self._model, each, self._nworld)
        with wp.ScopedDevice(self._model.qpos0.device):
            if self._derived is None and not self._nominal.keys().isdisjoint(FOLLOWS):
                self._derived = derived_tables(self._scene.mjm, self._nworld, self._roots)
        return self._known[name]

    def _before(self, name: str, *, every: bool = False) -> wp.array:
        """Return a copy of a field's first row, or of all rows if `every`, as they were before any draw."""
        array, kept = getattr(owner(self._model, name), name), vars(self._model).setdefault(_BEFORE, {})
        if name not in kept:
            made = kept[name] = wp.clone(array if every else array[:1]) if array.size else array
            if name == "geom_rgba":  # draws are relative to visible colours, which may come from materials
                made.assign(np.repeat(nominal_values(self._scene.mjm, name)[None], made.shape[0], axis=0))
        return kept[name]

    def scale(self, name: str, of: str, factor: Any, mask: wp.array, where: str) -> None:
        """In each masked world, set part of a field to its nominal values times the world's factor.

        The same components change as with `scale` in a scene file. Of frictions, only the sliding friction changes,
        and colours keep their transparency. Inertias follow masses, and bias gains follow actuator gains.

        Args:
            name: A field that was requested before with `ask`.
            of: A model element, an object or a robot, see `field_rows`.
            factor: Factors, a Warp array or torch tensor on the device or a numpy array, shape (nworld,), float32.
            mask: Selected worlds, shape (nworld,), bool.
            where: Name of the caller. Errors begin with this name.

        Raises:
            UnknownNameError, ArgumentError, SceneMismatchError: As in `ask`.
            ArgumentError: Factors or mask have another shape, or the first call with these names is inside a capture.
        """
        if self.ask(name, of, where=where).dtype in (wp.int32, wp.bool):
            raise ArgumentError(f"{where}: '{name}' has no floats to scale. Write into model_field('{name}').")
        for argument, given in (("factor", factor), ("mask", mask)):
            if (shape := getattr(given, "shape", type(given).__name__)) != (self._nworld,):
                raise ArgumentError(f"{where}: {argument} should have shape ({self._nworld},), got {shape}.")
        factor = as_floats(factor, mask.device)
        if factor.dtype is not wp.float32:
            raise ArgumentError(f"{where}: factor should hold float32, got {factor.dtype.__name__}.")
        if (name, of) not in self._scaled:
            if mask.device.is_capturing:
                raise ArgumentError(f"{where}: '{name}' of '{of}' should be scaled once before the capture.")
            self._scaled[name, of] = self._columns_of(name, of, where)
        self._scaled[name, of].launch(mask, given=factor.contiguous().reshape((-1, 1)))

    def _columns_of(self, name: str, of: str, where: str) -> WorldColumns:
        """Return WorldColumns that multiply part of a field and of its dependent fields by a factor per world."""
        rows = field_rows(self._scene.mjm, self._scene.bodies, name, of, where)
        word, scaled = _word(name), []
        for field, first, count in ((name, word.first, word.shared or word.width), *word.follow):
            size = element_size(self.wide(field))
            places = np.arange(self._known[field].shape[1] * size).reshape(-1, size)[rows]
            scaled += [(field, i, i, 0) for i in places[..., first : first + (count or size)].ravel().tolist()]
        arrays = {field: self._known[field] for field in dict.fromkeys(field for field, *_ in scaled)}
        return WorldColumns(self._nworld, arrays, self._nominal, scaled=scaled)

    def parameter(self, name: str, where: str) -> wp.array:
        """Return the numbers drawn for an entry of the scene's `randomize`, shape (nworld, n).

        Raises:
            UnknownNameError: The scene's `randomize` has no entry of this name.
        """
        check_names("parameter", [name], where, self.columns.numbers)
        return self.columns.numbers[name]

    def launch_draw(self, mask: wp.array, layouts: LayoutsView, rows: wp.array | None = None) -> None:
        """Draw the entries of the scene's `randomize` in the masked worlds. See `WorldColumns.launch`.

        Derived fields are computed in a second stream, concurrently with all launches up to `launch_wait`. Controls are
        computed in the current stream.
        """
        if not self._scene.draws:
            return
        self.columns.launch(mask, layouts, rows)
        self.launch_holding(mask)
        if self._beside is not None:
            self._beside.wait_stream(mask.device.stream)
        with wp.ScopedStream(self._beside, sync_enter=False):
            self._launch_derived(mask)

    def launch_wait(self) -> None:
        """Make later launches wait for the derived fields."""
        if self._beside is not None:
            self._beside.device.stream.wait_stream(self._beside)

    @property
    def rows(self) -> dict[str, wp.array]:
        """Arrays with a row for each world: fields, drawn numbers and, if it differs by world, `RestMap.law`."""
        found = {name: self._known[name] for name, made in self._nominal.items() if made.size}
        found |= {f"drawn.{name}": array for name, array in self.columns.numbers.items()}
        return found | ({"rest": self.rest.law} if self._has_laws else {})

    @property
    def bears(self) -> bool:
        """True if controls at rest bear the weight of an arm: `gravcomp` leaves some, or may do so after a change."""
        return self._is_heavy or "body_gravcomp" in self._nominal

    @property
    def _has_laws(self) -> bool:
        return self.bears or not self._nominal.keys().isdisjoint(GAINS)

    def launch_bear(self, mask: wp.array) -> None:
        """Add the weight of arms to the controls at rest in the worlds of `mask`, after their positions were written.

        If arms have weight, this updates world poses in all worlds.
        """
        if self.bears:
            mjw.kinematics(self._model, self._data)
            self.launch_holding(mask)

    def launch_follow(self, mask: wp.array) -> None:
        """Recompute derived fields and controls in the worlds of `mask`, shape (nworld,), bool."""
        self.launch_holding(mask)
        self._launch_derived(mask)

    def launch_holding(self, mask: wp.array | None) -> None:
        """Recompute `rest.law` and the controls at rest, for the present gains and the weight in the present pose."""
        if self._has_laws:
            launch_holding(self.rest, self._model, self._data, mask)

    def _launch_derived(self, mask: wp.array) -> None:
        if self._derived is not None:
            launch_derived(self._derived, self._model, mask, self._nominal)

    def close(self) -> None:
        """Reject requests for further fields from now on, and let `check` detect replaced arrays.

        If `grow` is true, `check` covers all fields. Otherwise, it covers only requested fields.
        """
        if self._closed:
            return
        self._closed = True
        for name in FIELDS if self._grow else ():
            if (array := getattr(owner(self._model, name), name, None)) is not None:
                self._known.setdefault(name, array)

    def check(self) -> None:
        """Check that no array of the Model was replaced, because captured steps would still read the old array.

        Raises:
            FixedError: An array was replaced.
        """
        for name, array in self._known.items():
            if getattr(owner(self._model, name), name) is not array:
                raise FixedError("model", name, f"To set its numbers, write into model_field('{name}').")


def _word(name: str) -> Word:
    """Return the components of a field that scaling changes: all of them, if scene files have no key for the field."""
    return next((word for word in WORDS["object"].values() if word.field == name), Word(name, 0))


def with_followers(name: str) -> list[str]:
    """Return the names of a field, of the fields scaled together with it, and of all fields derived from these."""
    scaled = [name, *(other for other, _, _ in _word(name).follow)]
    return scaled + [output for output, sources in FOLLOWS.items() if not set(sources).isdisjoint(scaled)]


def owner(m: mjw.Model, name: str) -> mjw.Model | mjw.Option:
    """Return the structure that holds a field: the Model, or its options."""
    return m.opt if name in OPTIONS else m


def widen(m: mjw.Model, name: str, nworld: int) -> wp.array:
    """Expand a field to a row for each world, all equal to the field's first row. Return the new array."""
    array = getattr(owner(m, name), name)
    if array.size and array.shape[0] != nworld:  # an empty array needs no rows
        with wp.ScopedDevice(array.device):
            array = wp.array(np.repeat(array.numpy()[:1], nworld, axis=0), dtype=array.dtype)
        array._is_batched = True  # the mark that mujoco_warp sets on its batched arrays
        setattr(owner(m, name), name, array)
    return array
