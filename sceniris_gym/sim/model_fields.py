"""`ModelFields`: fields of a mujoco_warp Model that have a row for each world, and all that follows from them."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.errors import ArgumentError, FixedError, SceneMismatchError, UnknownNameError
from sceniris_gym.layout.knobs import KnobTable
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.draws import drawn_fields, nominal_values
from sceniris_gym.scene.field_table import FIELDS, OPTIONS, check_field, field_rows
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.derived import FOLLOWERS, Follower, HoldingControls
from sceniris_gym.sim.field_drawer import FieldDrawer
from sceniris_gym.sim.rest import scene_rest
from sceniris_gym.sim.variants import fields_of_variants


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
        asked: The fields that somebody asked for, to write to.
        varied: The values of the present variants for the fields in which variants of objects differ, with a row for
            each world; empty without variants. Resets write them before anything else is drawn.
    """

    def __init__(self, scene: SceneModel, m: mjw.Model, d: mjw.Data, *, grow: bool) -> None:
        names = fields_of_variants() if scene.shared is not None else ()
        self.varied = {name: wp.clone(getattr(m, name)) for name in names}
        scene = scene.sim
        self._scene, self._model, self._data, self._nworld, self._grow = scene, m, d, d.nworld, grow
        self._nominal: dict[str, wp.array] = {}
        self._known: dict[str, wp.array] = {}
        self._followers: dict[type[Follower], Follower] = {}
        self._closed = False
        self.asked: set[str] = set()
        self.rest = scene_rest(scene, m.qpos0.device)
        self._drawer = self._make_drawer() if scene.draws else None

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

    def wide(self, name: str, where: str = "model_field", source: str | None = None) -> wp.array:
        """Return the array of a field, with a row for each world; `source` is the field that it follows from."""
        if name not in self._nominal:
            array = getattr(owner(self._model, name), name)
            made = wp.clone(array[:1]) if array.size else array
            self._nominal[name] = self.varied.get(name, made)
            self._widen(name, source or name, where)
            for kind in FOLLOWERS:
                if name in kind.SOURCES and kind not in self._followers:
                    for output in kind.OUTPUTS:
                        self.wide(output, where, name)
                    self._followers[kind] = kind(self._scene.mjm, self._model, self._data, self.rest)
        return getattr(owner(self._model, name), name)

    def nominal(self, name: str) -> wp.array:
        """Return the values of the model as it was made, of a field that was asked for, shape (1, ...).

        Where variants of objects differ, they have a row for each world.
        """
        return self._nominal[name]

    def parameter(self, name: str, where: str) -> wp.array:
        """Return the numbers that a draw of the scene's `randomize` has taken, shape (nworld, n).

        Raises:
            UnknownNameError: The scene draws nothing of this name.
        """
        numbers = {} if self._drawer is None else self._drawer.numbers
        if name not in numbers:
            raise UnknownNameError("parameter", name, where, numbers)
        return numbers[name]

    def use_knobs(self, table: KnobTable, keys: Sequence[str]) -> None:
        """Draw from intervals that knobs narrow, world by world; see `FieldDrawer.use_knobs`."""
        if self._drawer is not None:
            self._drawer.use_knobs(table, keys)

    def launch_draw(
        self,
        mask: wp.array,
        seed: wp.array,
        episode: wp.array,
        split: str,
        rows: wp.array | None = None,
        knob: wp.array | None = None,
    ) -> None:
        """Draw what the scene randomizes in the masked worlds; see `FieldDrawer.launch`."""
        if self._drawer is not None:
            self._drawer.launch(mask, seed, episode, split, rows, knob)
            self.launch_follow(mask)

    def _make_drawer(self) -> FieldDrawer:
        """Return the drawer of the scene, and give all its fields a row for each world."""
        draws, arrays = self._scene.draws, {}
        for name in drawn_fields(draws):
            arrays[name] = self.wide(name, "randomize")
        if "geom_rgba" in arrays:  # relative to the colours that are seen
            seen, nominal = nominal_values(self._scene.mjm, "geom_rgba"), self._nominal["geom_rgba"].numpy()
            for draw in draws:
                if draw.word.field == "geom_rgba":
                    nominal[:, draw.rows] = seen[draw.rows]
            self._nominal["geom_rgba"].assign(nominal)
        return FieldDrawer(draws, arrays, self._nominal, self._nworld)

    @property
    def rows(self) -> dict[str, wp.array]:
        """The arrays that have a row for each world, by name, with those of controls at rest if gains differ."""
        found = {name: getattr(owner(self._model, name), name) for name, made in self._nominal.items() if made.size}
        return found | ({"coef": self.rest.coef, "bias": self.rest.bias} if HoldingControls in self._followers else {})

    def launch_follow(self, mask: wp.array) -> None:
        """Bring what follows from the fields up to date in the masked worlds, shape (nworld,), bool."""
        for kind in FOLLOWERS:
            if kind in self._followers:
                self._followers[kind].launch(mask)

    def close(self) -> None:
        """Refuse other fields from now on, and new arrays for fields: of a Model of ours all, else those asked for."""
        if self._closed:
            return
        self._closed = True
        names = FIELDS if self._grow else self._nominal
        self._known = {
            name: array for name in names if (array := getattr(owner(self._model, name), name, None)) is not None
        }

    def check(self) -> None:
        """Check that no array of the Model was replaced.

        Raises:
            FixedError: One was, which captured steps would not see.
        """
        for name, array in self._known.items():
            if getattr(owner(self._model, name), name) is not array:
                raise FixedError("model", name, f"Write into its array: model_field('{name}').")

    def _widen(self, name: str, source: str, where: str) -> None:
        array = getattr(owner(self._model, name), name)
        if array.size and array.shape[0] != self._nworld and not self._grow:
            raise SceneMismatchError(
                f"{where}: model.{name} has {array.shape[0]} row for all worlds and should have {self._nworld}. Make "
                f'the Model by put_model(compiled, {self._nworld}, "{source}").'
            )
        widen(self._model, name, self._nworld)


def put_model(compiled: CompiledScene, nworld: int, *fields: str) -> mjw.Model:
    """Return a mujoco_warp Model of a scene in which some fields have a row for each world.

    Args:
        compiled: The compiled scene.
        nworld: Number of worlds.
        fields: Names of the fields; those that the scene randomizes, what follows from either, and those in which
            variants of objects differ have rows as well.

    Raises:
        UnknownNameError: No such field, or layouts depend on it.
        ArgumentError: Steps leave the field out.
    """
    with wp.ScopedDevice(compiled.device):
        m = mjw.put_model(compiled.sim_mjm)
        for name in fields_of_variants() if compiled.config.variants else ():
            widen(m, name, nworld)
        for name in (*drawn_fields(compiled.scene.sim.draws), *fields):
            check_field(name, compiled.sim_mjm, "put_model")
            widen(m, name, nworld)
            for kind in FOLLOWERS:
                for output in kind.OUTPUTS if name in kind.SOURCES else ():
                    widen(m, output, nworld)
    return m


def owner(m: mjw.Model, name: str) -> mjw.Model | mjw.Option:
    """Return the structure that has a field: the Model, or its options."""
    return m.opt if name in OPTIONS else m


def widen(m: mjw.Model, name: str, nworld: int) -> None:
    """Give a field a row for each world, all with the values of its first one."""
    array = getattr(owner(m, name), name)
    if array.size and array.shape[0] != nworld:  # one of nothing is as good for all worlds
        with wp.ScopedDevice(array.device):
            wide = wp.array(np.repeat(array.numpy()[:1], nworld, axis=0), dtype=array.dtype)
        wide._is_batched = True  # as mujoco_warp marks its own
        setattr(owner(m, name), name, wide)
