"""`ResetRandomizer`: resets worlds to fresh layouts in your own mujoco_warp loop."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.fixed import Fixed
from sceniris_gym.device.launch_lock import launching
from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.errors import (
    ArgumentError,
    ArgumentTypeError,
    MaskTypeError,
    SceneMismatchError,
    UnknownNameError,
    check_type,
)
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.prepared import PreparedLayouts
from sceniris_gym.layout.seeds import seeds_on_device
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import check_budget, update_stages
from sceniris_gym.sim.constraints import clear_constraints
from sceniris_gym.sim.contacts import ContactList
from sceniris_gym.sim.control_history import ControlHistory
from sceniris_gym.sim.fit import check_fit
from sceniris_gym.sim.masks import as_ids, as_mask, as_rows
from sceniris_gym.sim.placed import Origins, PlacedWrite
from sceniris_gym.sim.versions import fields_of_data, keyframe_plastic
from sceniris_gym.sim.write import (
    Poses,
    mask_of_ids,
    mask_of_rows,
    rest_map,
    rows_of_mask,
    write_state,
    write_values,
)

PROMISED = fields_of_data(
    *("time", "qpos", "qvel", "act", "history", "plastic", "ctrl", "mocap_pos", "mocap_quat", "eq_active"),
    *("qacc_warmstart", "qfrc_applied", "xfrc_applied", "userdata", "tree_asleep"),
)
"""Arrays of Data that keep their bits in worlds that are not reset: the state from which all others follow.

A need of "sensors" or "dynamics" adds what delayed sensors measure now to `history`, as the next step would.
"""

_WRITES = ("all", "placed")


class ResetRandomizer(Fixed, StaysHere):
    """Resets chosen worlds to fresh layouts; the other worlds keep their state bit for bit.

    A reset clears the data of the chosen worlds (`mjw.reset_data`: velocities, warm starts, clocks and NaNs too) and
    writes positions, mocap poses, activations and controls of their next layouts. Position actuators hold the sampled
    pose; the other controls are those of the home keyframe. Actuators with a delay read these controls from the past
    too. Nothing waits for the device, so a reset with a mask on the device can be captured in a graph.

    A reset that Ctrl-C interrupts leaves its worlds half written, until they are reset once more. Their next layouts
    are those of the interrupted reset, unless these had been made already.

    The other worlds keep their state (the arrays in PROMISED) bit for bit, so they go on as if nothing had been reset.
    Arrays that are computed from the state are brought up to date in all worlds: positions and orientations in space
    (xpos, geom_xpos, site_xmat, ...), and those of `needs`. In a bare loop of `mjw.step` they are one step older than
    qpos, so there they change in the other worlds as well.

    `data.contact` lists no contacts of the chosen worlds after a reset, and `data.nacon` does not count them; contacts
    of the other worlds keep their bits, though not always their places in the list. If `needs` has "contacts" the list
    is made anew for all worlds.

    Args:
        compiled: The compiled scene, on the device of `data`.
        model: mujoco_warp Model made from `compiled.mjm`, or one like it in all that layouts depend on: bodies, joints
            and geoms, their order, types, sizes and places. Masses, frictions, gains and options may differ.
        data: mujoco_warp Data of the worlds. `default_budget(compiled.mjm)` in sceniris_gym.sim.batch gives an nconmax
            and an njmax with room for contacts; `check_budget` tells whether those of `data` are large enough.
        layout_source: The LayoutSource; None makes a LayoutGenerator with `seed` and `split`.
        prefetch: Make the next layout of every world ahead, on a GPU beside the steps that follow, so that a reset only
            copies: the same layouts, for the memory of a second generator (88 MB for 4,096 worlds of `mid`, 640 MB of
            `kitchen_reset`). None does so on a GPU where no layout_source is given. In a graph of your own that resets
            are captured into, they are made in place. A wp.Stream is used instead of `side_stream`; see
            PreparedLayouts.
        seed: Seed of world 0, world i has seed + i; or one seed per world. Not used with a layout_source.
        split: "train" or "eval", which share no random numbers. Not used with a layout_source.
        write: "all" resets worlds as a whole. "placed" writes the scene's objects and its robot alone, with their
            velocities and the controls that hold them; clocks and everything else of a world are left as they are.
        origins: Origins of the worlds [m], shape (nworld, 3), which are added to all positions that are written, as
            layouts are relative to them. A Warp array or a torch tensor on the device is read anew at every reset. What
            is fixed to the world is not moved, and a ModelWarning names it.
        mjm: The MjModel that `model` was made from. A mujoco_warp Model has no names; with it they are compared too.
        needs: What else to bring up to date after a reset, keys of sceniris_gym.sim.batch.NEEDS.
        graph: Capture the reset into a graph and replay it.

    Attributes:
        mask: Worlds that `launch_reset` resets, to be written on the device, shape (nworld,), bool. `reset` and `write`
            overwrite it.

    Raises:
        ArgumentTypeError: `compiled`, `model`, `data` or `prefetch` is of another type.
        SceneMismatchError: Model, data or layout_source have another scene, device or number of worlds.
        ArgumentError: Both `layout_source` and `prefetch`, or a stream of another device.
        MaskTypeError, MaskError: `origins` are no floats, or not one for each world.
        UnknownNameError: `write` is neither "all" nor "placed".
        FixedError: An attribute that is assigned to: launches are captured with what they were.
    """

    FIXED = ("compiled", "model", "data", "device", "layout_source", "mask")
    ARGUMENTS = ("layouts", "seed", "split", "prefetch", "write", "origins", "mjm", "needs", "graph")

    @launching
    def __init__(
        self,
        compiled: CompiledScene,
        model: mjw.Model,
        data: mjw.Data,
        *,
        layout_source: LayoutSource | None = None,
        seed: int | Sequence[int] = 0,
        split: str = "train",
        prefetch: bool | wp.Stream | None = None,
        write: Literal["all", "placed"] = "all",
        origins: Any = None,
        mjm: mujoco.MjModel | None = None,
        needs: Iterable[str] = (),
        graph: bool = True,
    ) -> None:
        check_type(compiled, CompiledScene, "ResetRandomizer: compiled")
        check_type(model, mjw.Model, "ResetRandomizer: model")
        check_type(data, mjw.Data, "ResetRandomizer: data")
        self.compiled, self.model, self.data = compiled, model, data
        self.device: wp.Device = data.qpos.device
        if not isinstance(prefetch, bool | wp.Stream | None):
            raise ArgumentTypeError(
                f"ResetRandomizer: prefetch should be a boolean, a wp.Stream or None, got {type(prefetch)}. "
                "wp.stream_from_torch(stream) is one of torch's as a wp.Stream."
            )
        if prefetch is None:
            prefetch = self.device.is_cuda and layout_source is None
        if layout_source is None:
            layout_source = LayoutGenerator(compiled, data.nworld, seed=seed, split=split)
            if prefetch:
                stream = prefetch if isinstance(prefetch, wp.Stream) else None
                layout_source = PreparedLayouts(layout_source, stream, graph=graph)
        elif prefetch:
            raise ArgumentError(
                "ResetRandomizer: prefetch makes layouts ahead that the randomizer generates itself. Give either it or "
                "a layout_source, which may be a PreparedLayouts."
            )
        self.layout_source: LayoutSource = layout_source
        check_fit(compiled, model, data, self.layouts, mjm)
        if write not in _WRITES:
            raise UnknownNameError("way to write", str(write), "ResetRandomizer: write", _WRITES)
        home_act, home_plastic = np.zeros(compiled.mjm.na), np.empty(0)
        if (key := compiled.scene.keyframe) >= 0:
            home_act = compiled.mjm.key_act[key]
            home_plastic = keyframe_plastic(compiled.mjm, key)
        self._rest = rest_map(compiled.mjm, compiled.scene.home_ctrl, home_act, self.device)
        self._plastic = wp.array(home_plastic, dtype=wp.float32, device=self.device)
        self._placed = PlacedWrite(compiled.scene, self._rest, self.device) if write == "placed" else None
        self._origins: Origins | None = None
        if origins is not None:
            placed_only = self._placed is not None
            self._origins = Origins(compiled.scene, origins, data.nworld, self.device, placed_only=placed_only)
        written = None if self._placed is None else self._placed.controls
        self._control_history = ControlHistory(compiled.mjm, self.device, written)
        self._contacts = ContactList(data)
        self._stages = update_stages(needs)
        with wp.ScopedDevice(self.device):
            self._all = wp.ones(data.nworld, dtype=wp.bool)
            self.mask = wp.zeros(data.nworld, dtype=wp.bool)
            self._rows = wp.full(data.nworld, -1, dtype=wp.int32)
            self._nacon = wp.zeros_like(data.nacon)
        self._reset = LaunchSequence(self._launch_reset, self.device, graph=graph)

    @property
    def layouts(self) -> Layouts:
        """The latest layouts, one row per world."""
        return self.layout_source.layouts

    @launching
    def reset(self, mask: Any = None, *, env_ids: Any = None) -> None:
        """Give the masked worlds, or those with these numbers, their next layouts.

        Args:
            mask: Booleans, shape (nworld,): Warp array, torch tensor or numpy array; None is all worlds. It may be
                false everywhere, which resets nothing.
            env_ids: Instead of a mask the numbers of the worlds, in any order: a sequence, a slice, or integers of
                shape (n,) as a Warp array, torch tensor or numpy array. None is all worlds, and none are none.

        Raises:
            MaskTypeError: Not an array of booleans, or of integers; or both of them given.
            MaskError: Wrong shape, or a world that does not exist.
        """
        nworld = self.data.nworld
        if env_ids is None:
            wp.copy(self.mask, self._all if mask is None else as_mask(mask, nworld, self.device))
        elif mask is None:
            mask_of_ids(as_ids(env_ids, nworld, self.device), self.mask)
        else:
            raise MaskTypeError("reset should have a mask or env_ids, not both.")
        self.launch_reset()

    def launch_reset(self) -> None:
        """Reset the worlds in `self.mask`, which the caller has filled on the device: `reset` without its checks."""
        if isinstance(self.layout_source, PreparedLayouts):
            self.layout_source.serve(self._reset)
        else:
            self._reset()

    @launching
    def reseed(self, seeds: int | Sequence[int] | np.ndarray | wp.array, mask: Any = None) -> None:
        """Give the masked worlds new seeds; their next layouts are those of episode 0.

        Args:
            seeds: Seed of world 0, world i gets seed + i; or one 64-bit seed per world, shape (nworld,), on the host or
                as a uint64 Warp array on the device.
            mask: As in reset.

        Raises:
            SeedError: Not 64-bit integers, or not one per world.
            MaskTypeError, MaskError: As in reset.
        """
        nworld = self.data.nworld
        given = seeds_on_device(seeds, nworld, self.device)
        self.launch_reseed(given, self._all if mask is None else as_mask(mask, nworld, self.device))

    def launch_reseed(self, seeds: wp.array, mask: wp.array) -> None:
        """Give masked worlds new seeds, both on the device: `reseed` without its checks."""
        self.layout_source.launch_reseed(seeds, mask)

    @launching
    def write(self, layouts: Layouts | LayoutTable, rows: Any) -> None:
        """Reset worlds to stored layouts. `self.layouts` does not change.

        Args:
            layouts: Layouts of this scene, on the device or on the host.
            rows: Row of `layouts` for each world, -1 for worlds that stay as they are, shape (nworld,).

        Raises:
            SceneMismatchError: The layouts are of another scene.
            MaskError: The rows are not integers, have the wrong shape or do not exist.
        """
        poses, nrow = _poses_of(layouts, self.model, self.device), layouts.qpos.shape[0]
        wp.copy(self._rows, as_rows(rows, nrow, self.data.nworld, self.device))
        with wp.ScopedDevice(self.device):
            mask_of_rows(self._rows, nrow, self.mask)
            self._launch_write(poses)

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """Return how many candidates were rejected for layouts so far, by object and cause. Waits for the device."""
        return self.layout_source.rejection_counts()

    @launching
    def check_budget(self) -> None:
        """Check that `data` has room for the contacts of the current state, and had it since the last resets.

        mujoco_warp drops contacts that do not fit. Waits for the device, so call it after the first reset, or rarely.

        Raises:
            ContactBudgetError: The room was too small; the message names the argument of `mjw.make_data` to raise and
                its new value.
        """
        check_budget(self.model, self.data)

    def _launch_reset(self) -> None:
        layouts = self.layouts
        self.layout_source.launch_generate(self.mask)
        rows_of_mask(self.mask, self._rows)
        self._launch_write(Poses(layouts.qpos, layouts.mocap_pos, layouts.mocap_quat))

    def _launch_write(self, poses: Poses) -> None:
        m, d = self.model, self.data
        self._contacts.launch_drop(self.mask)
        if self._placed is None:
            # reset_data zeroes the contact count of all worlds when it resets world 0
            wp.copy(self._nacon, d.nacon)
            mjw.reset_data(m, d, reset=self.mask)
            wp.copy(d.nacon, self._nacon)
            write_state(m, d, self._rest, poses, self._rows)
            if self._plastic.shape[0] > 0:
                write_values(self._plastic, self.mask, d.plastic)
        else:
            self._placed.launch(d, poses, self._rows)
        if self._origins is not None:
            self._origins.launch(d, self.mask)
        self._control_history.launch_fill(d, self.mask)
        clear_constraints(d, self.mask)
        for stage in self._stages:
            stage(m, d)


def _poses_of(layouts: Layouts | LayoutTable, m: mjw.Model, device: wp.Device) -> Poses:
    """Return the poses of stored layouts, on the device.

    Raises:
        SceneMismatchError: Their sizes are not those of the model.
    """
    nrow = layouts.qpos.shape[0]
    # Without a mocap body Layouts keep one unused column.
    nmocap = layouts.mocap_pos.shape[1] if m.nmocap == 0 else m.nmocap
    columns = {
        "qpos": ((m.nq,), wp.float32),
        "mocap_pos": ((nmocap, 3), wp.vec3),
        "mocap_quat": ((nmocap, 4), wp.quat),
    }
    arrays = []
    for name, (shape, dtype) in columns.items():
        array = getattr(layouts, name)
        on_device = isinstance(array, wp.array)
        # A Warp array of vectors has no axis for their elements.
        found = (*array.shape, *shape[1:]) if on_device and array.dtype is dtype else tuple(array.shape)
        if found != (nrow, *shape):
            raise SceneMismatchError(
                f"layouts.{name} has shape {found} and should have shape {(nrow, *shape)}. Give layouts of this scene."
            )
        arrays.append(array.to(device) if on_device else wp.array(array, dtype=dtype, ndim=2, device=device))
    return Poses(*arrays)
