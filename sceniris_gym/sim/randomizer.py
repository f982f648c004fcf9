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
from sceniris_gym.layout.masks import as_ids, as_mask, as_rows, fill_mask, mask_of_ids, mask_of_rows
from sceniris_gym.layout.prepared import PreparedLayouts
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.levels.choice import Levels
from sceniris_gym.levels.sampler import LevelSampler
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import check_budget, update_stages
from sceniris_gym.sim.contacts import ContactList
from sceniris_gym.sim.fit import check_fit
from sceniris_gym.sim.origins import as_origins, warn_of_origins
from sceniris_gym.sim.rest import rest_map
from sceniris_gym.sim.versions import fields_of_data, keyframe_plastic
from sceniris_gym.sim.write import Poses, StateWriter

PROMISED = fields_of_data(
    *("time", "qpos", "qvel", "act", "history", "plastic", "ctrl", "mocap_pos", "mocap_quat", "eq_active"),
    *("qacc_warmstart", "qfrc_applied", "xfrc_applied", "userdata", "tree_asleep"),
)
"""Arrays of Data that keep their bits in worlds that are not reset: the state that determines all others.

With a need of "sensors" or "dynamics" the present values of delayed sensors are added to `history`, as the next step
would do.
"""

_WRITES = ("all", "placed")


class ResetRandomizer(Fixed, StaysHere):
    """Resets chosen worlds to fresh layouts; the other worlds keep their state bit for bit.

    A reset clears the data of the chosen worlds (`mjw.reset_data`: velocities, warm starts, clocks and NaNs too) and
    writes positions, mocap poses, activations and controls of their next layouts. Position actuators hold the sampled
    pose; the other controls are those of the home keyframe. Delayed actuators get these controls as their past, too.
    Nothing waits for the device, so a reset with a mask on the device can be captured in a graph.

    A reset that Ctrl-C interrupts leaves its worlds half written until they are reset once more. Their next layouts are
    those of the interrupted reset, unless these had been made already.

    The other worlds keep their state (the arrays in PROMISED) bit for bit, so they go on as if nothing had been reset.
    Arrays that are computed from the state are brought up to date in all worlds: positions and orientations in space
    (xpos, geom_xpos, site_xmat, ...), and those of `needs`. In a bare loop of `mjw.step` they are one step older than
    qpos, so there they change in the other worlds as well.

    `data.contact` lists no contacts of the chosen worlds after a reset, and `data.nacon` does not count them; contacts
    of the other worlds keep their bits, but not always their places in the list. If `needs` has "contacts", the list is
    made anew for all worlds.

    Args:
        compiled: The compiled scene, on the device of `data`.
        model: mujoco_warp Model made from `compiled.mjm`, or one like it in all that layouts depend on: bodies, joints
            and geoms, their order, types, sizes and places. Masses, frictions, gains and options may differ.
        data: mujoco_warp Data of the worlds. `default_budget(compiled.mjm)` in sceniris_gym.sim.batch returns an
            nconmax and an njmax that are large enough for most scenes; `check_budget` checks those of `data`.
        seed: Seed of world 0, world i has seed + i; or one seed per world. Not used with a layout_source.
        split: "train" or "eval", which share no random numbers. Not used with a layout_source.
        prefetch: Make the next layout of every world ahead, on a GPU beside the steps that follow, so that a reset only
            copies it. The layouts are the same; the memory is that of a second generator (88 MB for 4,096 worlds of
            `mid`, 640 MB of `kitchen_reset`). None prefetches on a GPU, unless a layout_source is given; a wp.Stream is
            the stream to prefetch on. A graph of your own that captures a reset makes layouts in place.
        layout_source: The LayoutSource to use; None makes a LayoutGenerator with `seed`, `split` and `prefetch`.
        levels: Choose the next layout of each world by what earlier episodes gave; see `sceniris_gym.levels`. None goes
            from episode to episode of one seed.
        write: "all" resets worlds as a whole. "placed" writes the scene's objects and its robot alone, with their
            velocities and the controls that hold them, and leaves clocks and everything else of a world as they are.
        origins: Origins of the worlds [m], shape (nworld, 3), added to all positions that are written, as layouts are
            relative to them. A Warp array or a torch tensor on the device is read anew at every reset. What is fixed to
            the world is not moved; a ModelWarning names it.
        needs: What else to bring up to date after a reset, keys of sceniris_gym.sim.batch.NEEDS.
        mjm: The MjModel that `model` was made from. A mujoco_warp Model has no names; with it names are checked, too.
        graph: Capture the reset into a graph and replay it.

    Raises:
        ArgumentTypeError: `compiled`, `model`, `data`, `layout_source` or `prefetch` is of another type.
        SceneMismatchError: Model, data or layout_source have another scene, device or number of worlds.
        ArgumentError: Both `layout_source` and `prefetch`, or a stream of another device.
        MaskTypeError, MaskError: `origins` are no floats, or not one for each world.
        UnknownNameError: `write` is neither "all" nor "placed".
        FixedError: Raised on assignment to an attribute that captured graphs already use.
    """

    FIXED = ("compiled", "model", "data", "device", "layout_source")
    ARGUMENTS = ("layouts", "levels", "seed", "split", "prefetch", "write", "origins", "mjm", "needs", "graph")

    @launching
    def __init__(
        self,
        compiled: CompiledScene,
        model: mjw.Model,
        data: mjw.Data,
        *,
        # where layouts come from:
        seed: int | Sequence[int] = 0,
        split: str = "train",
        prefetch: bool | wp.Stream | None = None,
        layout_source: LayoutSource | None = None,
        levels: Levels | None = None,
        # what a reset writes:
        write: Literal["all", "placed"] = "all",
        origins: Any = None,
        needs: Iterable[str] = (),
        # how:
        mjm: mujoco.MjModel | None = None,
        graph: bool = True,
    ) -> None:
        check_type(compiled, CompiledScene, "ResetRandomizer: compiled")
        check_type(model, mjw.Model, "ResetRandomizer: model")
        check_type(data, mjw.Data, "ResetRandomizer: data")
        self.compiled, self.model, self.data = compiled, model, data
        self.device: wp.Device = data.qpos.device
        if layout_source is None:
            generator = LayoutGenerator(compiled, data.nworld, seed=seed, split=split)
            layout_source = _prefetching(generator, self.device.is_cuda if prefetch is None else prefetch, graph)
        elif prefetch:
            raise ArgumentError(
                "ResetRandomizer: prefetch is for layouts that the randomizer generates itself. Give either it or a "
                "layout_source, which may be a PreparedLayouts."
            )
        check_type(layout_source, LayoutSource, "ResetRandomizer: layout_source")
        if levels is not None:
            check_type(levels, Levels, "ResetRandomizer: levels")
            layout_source = LevelSampler(layout_source, levels, split)
        self.layout_source: LayoutSource = layout_source
        check_fit(compiled, model, data, self.layouts, mjm)
        if write not in _WRITES:
            raise UnknownNameError("way to write", str(write), "ResetRandomizer: write", _WRITES)
        self._whole, self._stages = write == "all", update_stages(needs)
        with wp.ScopedDevice(self.device):
            self._mask = wp.zeros(data.nworld, dtype=wp.bool)  # a captured reset reads it
            self._nacon = wp.zeros_like(data.nacon)
        self._contacts, self._writer = ContactList(data, self._mask), self._make_writer(origins)
        self._reset = LaunchSequence(self._launch_reset, self.device, graph=graph)

    @property
    def layouts(self) -> Layouts:
        """The latest layouts, one row per world."""
        return self.layout_source.layouts

    @property
    def levels(self) -> LevelSampler | None:
        """The sampler of levels, if the worlds play levels."""
        return self.layout_source if isinstance(self.layout_source, LevelSampler) else None

    @launching
    def reset(self, mask: Any = None, *, env_ids: Any = None, seeds: Any = None, episodes: Any = None) -> None:
        """Give the masked worlds, or those with these numbers, their next layouts or chosen ones.

        Args:
            mask: Booleans, shape (nworld,): Warp array, torch tensor or numpy array; None is all worlds. It may be
                false everywhere, which resets nothing.
            env_ids: Instead of a mask the numbers of the worlds, in any order: a sequence, a slice, or integers of
                shape (n,) as a Warp array, torch tensor or numpy array. An empty one resets nothing.
            seeds: Seeds of these layouts, one for each world; see `reseed`. The worlds go on from there.
            episodes: Their episodes, 0 if there are seeds alone; of the present seeds if there are no `seeds`.

        Raises:
            MaskTypeError: Not an array of booleans, or of integers; or both of them given.
            MaskError: Wrong shape, or a world that does not exist.
            SeedError: See `reseed`.
        """
        nworld = self.data.nworld
        if env_ids is None:
            chosen = None if mask is None else as_mask(mask, nworld, self.device)
        elif mask is None:
            chosen = self._mask
            mask_of_ids(as_ids(env_ids, nworld, self.device), chosen)
        else:
            raise MaskTypeError("reset should have a mask or env_ids, not both.")
        if seeds is not None or episodes is not None:
            self.reseed(seeds, chosen, episodes)
        self.launch_reset(chosen)

    def launch_reset(self, mask: wp.array | None) -> None:
        """Reset the masked worlds: `reset` without its checks.

        Args:
            mask: Which worlds, on the device, shape (nworld,), bool; all if None. It may be overwritten afterwards.
        """
        fill_mask(mask, self._mask)
        self._reset()
        self.layout_source.after_reset()

    def reseed(
        self, seeds: int | Sequence[int] | np.ndarray | wp.array | None, mask: Any = None, episodes: Any = None
    ) -> None:
        """Choose the next layouts of the masked worlds by seeds and episodes. See `LayoutSource.reseed`."""
        self.layout_source.reseed(seeds, mask, episodes)

    @launching
    def write(self, layouts: Layouts | LayoutTable, rows: Any) -> None:
        """Reset worlds to stored layouts. `self.layouts` does not change.

        Args:
            layouts: Layouts of this scene, on the device or on the host.
            rows: Row of `layouts` for each world, -1 for worlds that stay as they are, shape (nworld,).

        Raises:
            SceneMismatchError: The layouts are of another scene.
            MaskError, MaskTypeError: The rows are not integers, have the wrong shape or do not exist.
        """
        scene = layouts.scene if isinstance(layouts, LayoutTable) else layouts.compiled.hash
        if scene not in ("", self.compiled.hash):
            raise SceneMismatchError(
                f"layouts are of scene {scene} and should be of {self.compiled.hash}. Give layouts of this scene."
            )
        poses, nrow = _poses_of(layouts, self.model, self.device), layouts.qpos.shape[0]
        on_device = as_rows(rows, nrow, self.data.nworld, self.device)
        with wp.ScopedDevice(self.device):
            mask_of_rows(on_device, nrow, self._mask)
            self._launch_write(poses, on_device)

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

    def _make_writer(self, origins: Any) -> StateWriter:
        """Return the writer of what a reset writes, at home where layouts do not say."""
        scene, mjm, d = self.compiled.scene, self.compiled.mjm, self.data
        act, plastic = np.zeros(mjm.na), None
        if scene.keyframe >= 0:
            act, plastic = mjm.key_act[scene.keyframe], keyframe_plastic(mjm, scene.keyframe)
        rest, bodies = rest_map(mjm, scene.home_ctrl, act, self.device), None
        if not self._whole:
            bodies, plastic = [body for name in scene.bodies for body in scene.subtree(name)], None
        if origins is not None:
            origins = as_origins(origins, d.nworld, self.device)
            warn_of_origins(scene, origins.numpy(), "ResetRandomizer: origins")
        return StateWriter(mjm, d, self._mask, rest, bodies=bodies, origins=origins, plastic=plastic)

    def _launch_reset(self) -> None:
        layouts = self.layouts
        self.layout_source.launch_generate(self._mask)
        self._launch_write(Poses(layouts.qpos, layouts.mocap_pos, layouts.mocap_quat))

    def _launch_write(self, poses: Poses, rows: wp.array | None = None) -> None:
        m, d = self.model, self.data
        self._contacts.launch_drop()
        if self._whole:
            # reset_data zeroes the contact count of all worlds when it resets world 0
            wp.copy(self._nacon, d.nacon)
            mjw.reset_data(m, d, reset=self._mask)
            wp.copy(d.nacon, self._nacon)
        self._writer.launch(poses, rows)
        for stage in self._stages:
            stage(m, d)


def _prefetching(generator: LayoutGenerator, prefetch: Any, graph: bool) -> LayoutSource:
    """Return a source that prefetches, on a stream if `prefetch` is one; the generator itself if it is false."""
    if not isinstance(prefetch, bool | wp.Stream):
        raise ArgumentTypeError(
            f"ResetRandomizer: prefetch should be a boolean, a wp.Stream or None, got {type(prefetch)}. "
            "wp.stream_from_torch(stream) turns a stream of torch's into a wp.Stream."
        )
    stream = prefetch if isinstance(prefetch, wp.Stream) else None
    return PreparedLayouts(generator, stream, graph=graph) if prefetch else generator


def _poses_of(layouts: Layouts | LayoutTable, m: mjw.Model, device: wp.Device) -> Poses:
    """Return the poses of stored layouts, on the device.

    Raises:
        SceneMismatchError: Their sizes are not those of the model.
    """
    nrow = layouts.qpos.shape[0]
    # without a mocap body Layouts have one unused column
    nmocap = layouts.mocap_pos.shape[1] if m.nmocap == 0 else m.nmocap
    columns = (("qpos", (m.nq,), wp.float32), ("mocap_pos", (nmocap, 3), wp.vec3), ("mocap_quat", (nmocap, 4), wp.quat))
    arrays = []
    for name, shape, dtype in columns:
        array = getattr(layouts, name)
        on_device = isinstance(array, wp.array)
        # a Warp array of vectors has no axis for their elements
        found = (*array.shape, *shape[1:]) if on_device and array.dtype is dtype else tuple(array.shape)
        if found != (nrow, *shape):
            raise SceneMismatchError(
                f"layouts.{name} has shape {found} and should have shape {(nrow, *shape)}. Give layouts of this scene."
            )
        arrays.append(array.to(device) if on_device else wp.array(array, dtype=dtype, ndim=2, device=device))
    return Poses(*arrays)
