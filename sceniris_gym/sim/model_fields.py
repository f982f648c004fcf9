"""`ModelFields`: fields of a mujoco_warp Model that have a row for each world, and all that follows from them."""

from __future__ import annotations

from typing import Any

import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.config.randomize import WORDS, Word
from sceniris_gym.errors import ArgumentError, FixedError, SceneMismatchError, check_names
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.world_columns import WorldColumns, element_size
from sceniris_gym.scene.draws import drawn_fields, nominal_values
from sceniris_gym.scene.field_table import FIELDS, OPTIONS, check_field, field_rows
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.derived import FOLLOWS, launch_derived
from sceniris_gym.sim.derived_tables import Derived, derived_tables
from sceniris_gym.sim.rest import GAINS, launch_holding, scene_rest
from sceniris_gym.sim.variants import fields_of_variants

NAMED = "named_by_make_worlds"
"""Attribute of a Model with the fields that `make_worlds` was asked for."""
_BEFORE = "rows_before_draws"
"""Attribute of a Model with values of its fields from before anything was drawn, by name."""


class ModelFields:
    """Fields of a Model that have a row for each world.

    Args:
        scene: The scene; what it simulates is `scene.sim`.
        m: The Model.
        d: Data of the worlds.
        grow: Give a field with one row for all worlds a row for each when it is asked for. Otherwise it is refused, as
            others may have captured the Model with its present arrays.

    Attributes:
        rest: The controls and activations that hold a pose.
        columns: What the scene randomizes.
        asked: The fields that somebody asked for, to write to.
        varied: The values of the present variants for the fields in which variants of objects differ, with a row for
            each world; empty without variants. Resets write them before anything else is drawn.
    """

    def __init__(self, scene: SceneModel, m: mjw.Model, d: mjw.Data, *, grow: bool) -> None:
        names, scene = fields_of_variants() if scene.shared is not None else (), scene.sim
        self._scene, self._model, self._data, self._nworld, self._grow = scene, m, d, d.nworld, grow
        self.varied = {name: self._before(name, every=True) for name in names}
        self._nominal: dict[str, wp.array] = {}
        self._known: dict[str, wp.array] = {}
        self._derived: Derived | None = None
        self._has_gains = self._closed = False
        self.asked: set[str] = set()
        self.rest = scene_rest(scene, m.qpos0.device)
        self._beside = wp.Stream(m.qpos0.device) if scene.draws and m.qpos0.device.is_cuda else None
        arrays = {name: self.wide(name, "randomize") for name in drawn_fields(scene.draws)}
        self.columns = WorldColumns(d.nworld, arrays, self._nominal, scene.draws)
        self._scaled: dict[tuple[str, str], WorldColumns] = {}
        for name in getattr(m, NAMED, ()):
            self.ask(name, where="make_worlds")

    def ask(self, name: str, of: str | None = None, *, where: str = "model_field") -> wp.array:
        """Return a field with a row for each world, or the part of it that belongs to a name; all views of one array.

        Args:
            name: The field, by its name in mujoco_warp's Model.
            of: An element of the model, or an object or a robot: see `field_rows`. None is all.
            where: The caller, for errors.

        Raises:
            UnknownNameError: No such field, or nothing of that name.
            ArgumentError: Steps leave the field out; or it is asked for too late.
            SceneMismatchError: The Model has one row for all worlds.
        """
        check_field(name, self._scene.mjm, where)
        rows = None if of is None else field_rows(self._scene.mjm, self._scene.bodies, name, of, where)
        if name not in self._nominal and self._closed:
            raise ArgumentError(
                f"{where}: '{name}' is asked for too late, as captured steps have it once for all worlds. Ask for it "
                "in Task.bind, or before the first reset."
            )
        array = self.wide(name, where)
        self.asked.add(name)
        return array if rows is None else array[:, rows]

    def wide(self, name: str, where: str = "model_field") -> wp.array:
        """Return the array of a field, with a row for each world, as all have that follow from it."""
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
                self._derived = derived_tables(self._scene.mjm, self._nworld)
            if not self._has_gains and not self._nominal.keys().isdisjoint(GAINS):
                self._has_gains = True
                laws = np.repeat(self.rest.law.numpy(), self._nworld, axis=0)
                self.rest.law = wp.array(laws, dtype=wp.vec2, ndim=2)
        return self._known[name]

    def _before(self, name: str, *, every: bool = False) -> wp.array:
        """Return the first row of a field, or every, from before anything was drawn by a randomizer of the Model."""
        array, kept = getattr(owner(self._model, name), name), vars(self._model).setdefault(_BEFORE, {})
        if name not in kept:
            made = kept[name] = wp.clone(array if every else array[:1]) if array.size else array
            if name == "geom_rgba":  # relative to the colours that are seen; resets write those of variants
                made.assign(np.repeat(nominal_values(self._scene.mjm, name)[None], made.shape[0], axis=0))
        return kept[name]

    def scale(self, name: str, of: str, factor: Any, mask: wp.array, where: str) -> None:
        """Set part of a field to its nominal values times a factor of each world, in the masked worlds.

        As with the word `scale` of a scene file, friction is that of sliding, colours keep their transparency, inertias
        follow masses, and gains of the bias follow those of actuators.

        Args:
            name: A field that was asked for.
            of: An element, object or robot: see `field_rows`.
            factor: Factors, a Warp array or torch tensor on the device or a numpy array, shape (nworld,), float32.
            mask: Which worlds, shape (nworld,), bool.
            where: The caller, for errors.

        Raises:
            UnknownNameError, ArgumentError, SceneMismatchError: As in `ask`; or factors or a mask of another shape; or
                a first call with these names inside of a capture.
        """
        if self.ask(name, of, where=where).dtype in (wp.int32, wp.bool):
            raise ArgumentError(f"{where}: '{name}' has no numbers to scale. Write into model_field('{name}').")
        for argument, given in (("factor", factor), ("mask", mask)):
            if (shape := getattr(given, "shape", type(given).__name__)) != (self._nworld,):
                raise ArgumentError(f"{where}: {argument} should have shape ({self._nworld},), got {shape}.")
        if isinstance(factor, np.ndarray):
            factor = wp.array(factor, dtype=float, device=mask.device)
        elif not isinstance(factor, wp.array):
            factor = wp.from_torch(factor.detach().float().contiguous())
        if factor.dtype is not wp.float32:
            raise ArgumentError(f"{where}: factor should hold float32, got {factor.dtype.__name__}.")
        if (name, of) not in self._scaled:
            if mask.device.is_capturing:
                raise ArgumentError(f"{where}: '{name}' of '{of}' should be scaled once before the capture.")
            self._scaled[name, of] = self._columns_of(
                name, field_rows(self._scene.mjm, self._scene.bodies, name, of, where)
            )
        self._scaled[name, of].launch(mask, given=factor.contiguous().reshape((-1, 1)))

    def _columns_of(self, name: str, rows: int | slice) -> WorldColumns:
        """Return the columns of these rows of a field, and of the fields that follow, times a number of each world."""
        word, scaled = _word(name), []
        for field, first, count in ((name, word.first, word.shared or word.width), *word.follow):
            size = element_size(self.wide(field))
            places = np.arange(self._known[field].shape[1] * size).reshape(-1, size)[rows]
            scaled += [(field, i, i, 0) for i in places[..., first : first + (count or size)].ravel().tolist()]
        arrays = {field: self._known[field] for field in dict.fromkeys(field for field, *_ in scaled)}
        return WorldColumns(self._nworld, arrays, self._nominal, scaled=scaled)

    def parameter(self, name: str, where: str) -> wp.array:
        """Return the numbers that a draw of the scene's `randomize` has taken, shape (nworld, n).

        Raises:
            UnknownNameError: The scene draws nothing of this name.
        """
        check_names("parameter", [name], where, self.columns.numbers)
        return self.columns.numbers[name]

    def launch_draw(self, mask: wp.array, layouts: LayoutsView, rows: wp.array | None = None) -> None:
        """Draw what the scene randomizes in the masked worlds; see `WorldColumns.launch`.

        What follows, but for controls, is found beside the launches up to `launch_wait`.
        """
        if not self._scene.draws:
            return
        self.columns.launch(mask, layouts, rows)
        self._launch_holding(mask)
        if self._beside is not None:
            self._beside.wait_stream(mask.device.stream)
        with wp.ScopedStream(self._beside, sync_enter=False):
            self._launch_derived(mask)

    def launch_wait(self) -> None:
        """Let later launches begin when all that follows from draws is found."""
        if self._beside is not None:
            self._beside.device.stream.wait_stream(self._beside)

    @property
    def rows(self) -> dict[str, wp.array]:
        """The arrays with a row for each world, by name, with drawn numbers, and controls at rest if gains differ."""
        found = {name: self._known[name] for name, made in self._nominal.items() if made.size}
        found |= {f"drawn.{name}": array for name, array in self.columns.numbers.items()}
        return found | ({"rest": self.rest.law} if self._has_gains else {})

    def launch_follow(self, mask: wp.array) -> None:
        """Bring what follows up to date in the masked worlds, shape (nworld,), bool."""
        self._launch_holding(mask)
        self._launch_derived(mask)

    def _launch_holding(self, mask: wp.array) -> None:
        if self._has_gains:
            launch_holding(self.rest, self._model, self._data, mask)

    def _launch_derived(self, mask: wp.array) -> None:
        if self._derived is not None:
            launch_derived(self._derived, self._model, mask, self._nominal)

    def close(self) -> None:
        """Refuse other fields from now on, and new arrays for fields: of a Model of ours all, else those asked for."""
        if self._closed:
            return
        self._closed = True
        for name in FIELDS if self._grow else ():
            if (array := getattr(owner(self._model, name), name, None)) is not None:
                self._known.setdefault(name, array)

    def check(self) -> None:
        """Check that no array of the Model was replaced.

        Raises:
            FixedError: One was, which captured steps would not see.
        """
        for name, array in self._known.items():
            if getattr(owner(self._model, name), name) is not array:
                raise FixedError("model", name, f"Write into its array: model_field('{name}').")


def _word(name: str) -> Word:
    """Return how a field of objects is scaled: as by the word of a scene file if there is one, else all of it."""
    return next((word for word in WORDS["object"].values() if word.field == name), Word(name, 0))


def with_followers(name: str) -> list[str]:
    """Return a field, those that are scaled with it, and those that follow from any of these."""
    scaled = [name, *(other for other, _, _ in _word(name).follow)]
    return scaled + [output for output, sources in FOLLOWS.items() if not set(sources).isdisjoint(scaled)]


def owner(m: mjw.Model, name: str) -> mjw.Model | mjw.Option:
    """Return the structure that has a field: the Model, or its options."""
    return m.opt if name in OPTIONS else m


def widen(m: mjw.Model, name: str, nworld: int) -> wp.array:
    """Give a field a row for each world, all with the values of its first one, and return its array."""
    array = getattr(owner(m, name), name)
    if array.size and array.shape[0] != nworld:  # one of nothing is as good for all worlds
        with wp.ScopedDevice(array.device):
            array = wp.array(np.repeat(array.numpy()[:1], nworld, axis=0), dtype=array.dtype)
        array._is_batched = True  # as mujoco_warp marks its own
        setattr(owner(m, name), name, array)
    return array
