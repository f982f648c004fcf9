"""Fresh layouts for the worlds that ask, in anybody's own MuJoCo-Warp loop."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.errors import WorldMismatchError
from sceniris_gym.sim.batch import check_budget, update_stages
from sceniris_gym.sim.masks import as_mask, as_rows
from sceniris_gym.sim.sequence import LaunchSequence
from sceniris_gym.sim.write import mask_of_rows, rest_map, rows_of_mask, write_state

if TYPE_CHECKING:
    from sceniris_gym.layout.layouts import Layouts
    from sceniris_gym.scene.world import World

SIZES = ("nq", "nv", "nu", "na", "nbody", "nmocap")


class ResetRandomizer:
    """Resets chosen worlds to fresh layouts; the other worlds keep their state bit for bit.

    A reset clears the data of the chosen worlds (`mjw.reset_data`, so velocities, warm starts, clocks, and NaNs
    too), writes positions, mocap poses, activations and controls of their next layouts, and makes kinematics current
    for all worlds. Position actuators hold the sampled pose; the other controls are those of the home
    keyframe. Nothing waits for the device, so a reset with a mask on the device can be captured in a graph.

    Args:
        world: the scene, on the device of `data`
        model: mujoco_warp Model of that scene's `mjm`
        data: mujoco_warp Data of the worlds. `default_budget(world.mjm)` of sceniris_gym.sim.batch gives an nconmax and
            an njmax that leave room for contacts, `check_budget` says whether those of `data` do
        generator: makes the layouts; a LayoutGenerator of `seed` and `split` when None
        seed: seed of world 0, world i has seed + i; or one seed per world. Only without a generator
        split: "train" or "eval", streams that share nothing. Only without a generator
        needs: what else to make current after a reset, keys of sceniris_gym.sim.batch.NEEDS
        graph: record a reset into a graph and replay it

    Raises:
        WorldMismatchError: model, data or generator are of another scene, device or number of worlds
    """

    def __init__(
        self,
        world: World,
        model: mjw.Model,
        data: mjw.Data,
        *,
        generator: Any = None,
        seed: int | Sequence[int] = 0,
        split: str = "train",
        needs: Iterable[str] = (),
        graph: bool = True,
    ) -> None:
        self.world, self.model, self.data = world, model, data
        self.device: wp.Device = data.qpos.device
        if generator is None:
            from sceniris_gym.layout.generate import LayoutGenerator

            generator = LayoutGenerator(world, data.nworld, seed=seed, split=split)
        self.generator = generator
        self._check_fit()
        home_act = np.zeros(world.mjm.na)
        if mujoco.mj_name2id(world.mjm, mujoco.mjtObj.mjOBJ_KEY, "home") >= 0:
            home_act = world.mjm.key("home").act
        self._rest = rest_map(world.mjm, world.scene.home_ctrl, home_act, self.device)
        self._stages = update_stages(needs)
        with wp.ScopedDevice(self.device):
            self._all = wp.ones(data.nworld, dtype=wp.bool)
            self._mask = wp.zeros(data.nworld, dtype=wp.bool)
            self._rows = wp.full(data.nworld, -1, dtype=wp.int32)
            self._nacon = wp.zeros_like(data.nacon)
        self._reset = LaunchSequence(self._launch_reset, self.device, graph=graph)

    @property
    def layouts(self) -> Layouts:
        """The layouts that the generator made last, one row per world."""
        return self.generator.layouts

    def reset(self, mask: Any = None) -> None:
        """Give the masked worlds their next layouts.

        Args:
            mask: booleans, shape (nworld,): Warp array, torch tensor or numpy array; None is all worlds. Where it is
                false everywhere nothing changes

        Raises:
            MaskTypeError: not an array of booleans
            MaskError: wrong shape
        """
        wp.copy(self._mask, self._all if mask is None else as_mask(mask, self.data.nworld, self.device))
        self._reset()

    def reseed(self, seeds: Any, mask: Any = None) -> None:
        """Give the masked worlds new seeds; their next layouts are of episode 0.

        Args:
            seeds: one seed per world, 64 bits, shape (nworld,)
            mask: as in reset
        """
        self.generator.reseed(seeds, None if mask is None else as_mask(mask, self.data.nworld, self.device))

    def write(self, layouts: Any, rows: Any) -> None:
        """Reset worlds to stored layouts. `self.layouts` does not change by it.

        Args:
            layouts: has `qpos` (nrow, nq), `mocap_pos` (nrow, nmocap, 3) and `mocap_quat` (nrow, nmocap, 4) wxyz, as
                Warp arrays like those of Layouts, or as numpy arrays
            rows: row of `layouts` for each world, -1 for worlds that stay as they are, shape (nworld,)

        Raises:
            WorldMismatchError: layouts of another scene
            MaskError: rows of wrong shape, or that do not exist
        """
        stored = _StoredRows(layouts, self.model, self.device)
        wp.copy(self._rows, as_rows(rows, stored.nrow, self.data.nworld, self.device))
        with wp.ScopedDevice(self.device):
            mask_of_rows(self._rows, stored.nrow, self._mask)
            self._launch_write(stored)

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """Return how many candidates were rejected so far, per object and cause. Waits for the device."""
        return self.generator.rejection_counts()

    def check_budget(self) -> None:
        """Say whether the contacts of the present state have room in the data, and those since the last resets had.

        MuJoCo-Warp leaves out what does not fit. Waits for the device, so call it after the first reset, or rarely.

        Raises:
            ContactBudgetError: names the argument of `mjw.make_data` to raise, and to what
        """
        check_budget(self.model, self.data)

    def _launch_reset(self) -> None:
        self.generator.generate(self._mask)
        rows_of_mask(self._mask, self._rows)
        self._launch_write(self.generator.layouts)

    def _launch_write(self, layouts: Any) -> None:
        m, d = self.model, self.data
        # reset_data zeroes the contact count of all worlds when it resets world 0
        wp.copy(self._nacon, d.nacon)
        mjw.reset_data(m, d, reset=self._mask)
        wp.copy(d.nacon, self._nacon)
        write_state(m, d, self._rest, layouts, self._rows)
        for stage in self._stages:
            stage(m, d)

    def _check_fit(self) -> None:
        mjm, m, d = self.world.mjm, self.model, self.data
        for size in SIZES:
            if getattr(m, size) != getattr(mjm, size):
                raise WorldMismatchError(
                    f"model.{size} is {getattr(m, size)}, but {getattr(mjm, size)} in the world's scene. "
                    "Make the model from world.mjm: mjw.put_model(world.mjm)."
                )
        if d.qpos.shape[1] != mjm.nq or d.mocap_pos.shape[1] != mjm.nmocap:
            raise WorldMismatchError(
                f"data has nq={d.qpos.shape[1]} and nmocap={d.mocap_pos.shape[1]}, but the world's scene {mjm.nq} and "
                f"{mjm.nmocap}. Make the data from world.mjm: mjw.make_data(world.mjm, nworld=...)."
            )
        nworld = self.generator.layouts.qpos.shape[0]
        if nworld != d.nworld:
            raise WorldMismatchError(f"the generator makes layouts for {nworld} worlds, but data has {d.nworld}.")
        for what, device in (
            ("the world", wp.get_device(self.world.device)),
            ("the generator", self.generator.layouts.qpos.device),
            ("the model", m.qpos0.device),
        ):
            if device != self.device:
                raise WorldMismatchError(
                    f"data is on {self.device}, but {what} is on {device}. Put both on one device."
                )


class _StoredRows:
    """Layouts that a caller has kept, on the device."""

    def __init__(self, layouts: Any, m: mjw.Model, device: wp.Device) -> None:
        self.nrow = layouts.qpos.shape[0]
        self.qpos = self._array(layouts, "qpos", (m.nq,), wp.float32, device)
        # without a mocap body Layouts keep one unused column
        nmocap = layouts.mocap_pos.shape[1] if m.nmocap == 0 else m.nmocap
        self.mocap_pos = self._array(layouts, "mocap_pos", (nmocap, 3), wp.vec3, device)
        self.mocap_quat = self._array(layouts, "mocap_quat", (nmocap, 4), wp.quat, device)

    def _array(self, layouts: Any, name: str, shape: tuple[int, ...], dtype: Any, device: wp.Device) -> wp.array:
        array = getattr(layouts, name)
        on_device = isinstance(array, wp.array)
        # a Warp array of vectors has no axis for their elements
        found = (*array.shape, *shape[1:]) if on_device and array.dtype is dtype else tuple(array.shape)
        if found != (self.nrow, *shape):
            raise WorldMismatchError(
                f"layouts.{name} has shape {found}, but this scene needs {(self.nrow, *shape)}; were they made of it?"
            )
        return array.to(device) if on_device else wp.array(array, dtype=dtype, ndim=2, device=device)
