"""`ResetRandomizer`: resets worlds to fresh layouts in your own mujoco_warp loop."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import mujoco
import mujoco_warp as mjw
import warp as wp

from sceniris_gym.device.fixed import Fixed, StaysHere
from sceniris_gym.device.random import named_stream
from sceniris_gym.device.sequence import LaunchSequence, launching
from sceniris_gym.device.tensors import TensorView
from sceniris_gym.errors import check_names, check_type
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.masks import as_rows, as_shape, as_worlds, fill_mask, mask_of_rows
from sceniris_gym.levels.curriculum import ADR, LevelReplay
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import Batch, updater
from sceniris_gym.sim.budget import check_budget
from sceniris_gym.sim.fit import check_fit
from sceniris_gym.sim.model_fields import ModelFields
from sceniris_gym.sim.named_random import draw_named
from sceniris_gym.sim.origins import as_origins, warn_of_origins
from sceniris_gym.sim.redrawing import Redrawer
from sceniris_gym.sim.reset_writer import ResetWriter, Simulation
from sceniris_gym.sim.sources import SourceLike, make_pipeline, stored_rows
from sceniris_gym.sim.variants import VariantWriter
from sceniris_gym.sim.versions import fields_of_data
from sceniris_gym.sim.write import poses_of

_SCOPES = ("world", "scene")


class ResetRandomizer(Fixed, StaysHere):
    """Resets chosen worlds to fresh layouts; the other worlds keep their state bit for bit.

    A reset clears the data of the chosen worlds (`mjw.reset_data`: velocities, warm starts, clocks and NaNs too) and
    writes positions, mocap poses, activations and controls of their next layouts. Position actuators hold the sampled
    pose; the other controls are those of the home keyframe. Delayed actuators get these controls as their past, too.
    Nothing waits for the device, so a reset with a mask on the device can be captured in a graph.

    A reset that Ctrl-C interrupts leaves its worlds half written until they are reset once more. Their next layouts are
    those of the interrupted reset, unless these had been made already.

    The other worlds keep their state (the arrays in STATE_FIELDS) bit for bit, so they go on as if nothing had been
    reset. Arrays that are computed from the state are brought up to date in all worlds: positions and orientations in
    space (xpos, geom_xpos, site_xmat, ...), and those of `needs`. In a bare loop of `mjw.step` they are one step older
    than qpos, so there they change in the other worlds as well.

    `data.contact` lists no contacts of the chosen worlds after a reset, and `data.nacon` does not count them; contacts
    of the other worlds keep their bits, but not always their places in the list. If `needs` has "contacts", the list is
    made anew for all worlds.

    Args:
        compiled: The compiled scene, on the device of `data`.
        model: mujoco_warp Model made from `compiled.mjm`, or one like it in all that layouts depend on: bodies, joints
            and geoms, their order, types, sizes and places. Masses, frictions, gains and options may differ. If objects
            have variants, it is the Model of `make_worlds`.
        data: mujoco_warp Data of the worlds. `make_worlds` leaves room for the contacts of most scenes, and
            `check_budget` checks it.
        seed: Seed of world 0, world i has seed + i; or one seed per world. Not used with a layout_source.
        split: "train" or "eval", which share no random numbers. A layout_source may have its own.
        prefetch: Make the next layout of every world ahead, on a GPU beside the steps that follow, so that a reset only
            copies it. The layouts are the same; the memory is that of a second generator (88 MB for 4,096 worlds of
            `mid`, 640 MB of `kitchen_reset`). None prefetches on a GPU, unless a layout_source is given; a wp.Stream is
            the stream to prefetch on. A graph of your own that captures a reset makes layouts in place.
        layout_source: A LayoutSource, a LayoutTable or LayoutDataset whose rows are served, or a function
            `(compiled, nworld)` that returns a LayoutSource. None makes a LayoutGenerator with `seed`, `split` and
            `prefetch`.
        curriculum: Chooses the next layout of each world by the outcomes of earlier episodes: a LevelReplay, an ADR,
            or a mapping of the fields of one. None goes from episode to episode of one seed.
        params: Names of the params that worlds have, or patterns; see `LayoutSource.set_params`. Not with a
            layout_source.
        scope: "world" resets whole worlds. "scene" writes only the scene's objects and its robot, with their velocities
            and the controls that hold them. Clocks and the rest of a world stay as they are.
        origins: Origins of the worlds [m], shape (nworld, 3), added to all positions that are written, as layouts are
            relative to them. A Warp array or a torch tensor on the device is read anew at every reset. What is fixed to
            the world is not moved; a ModelWarning names it.
        needs: What else to bring up to date after a reset, out of "velocity", "contacts", "sensors" and "dynamics".
        mjm: The MjModel that `model` was made from. A mujoco_warp Model has no names; with it names are checked, too.
        graph: Capture the reset into a graph and replay it.

    Attributes:
        pipeline: The LayoutPipeline that makes, prefetches and chooses the layouts. Use its `reseed`, `set_params`,
            `ids` and `rejection_counts`.
        layouts: The latest layouts, one row per world.
        levels: The LevelSampler of the curriculum, or None.
        split: The split of the layouts: that of the layout_source if it has one.
        fields: Model fields that have a row for each world.
        redraw_count: Redraws of each world since its reset, shape (nworld,), int32.
        redraw_status: `LayoutStatus` of each world's latest redraw, VALID or KEPT; NONE before the first; (nworld,),
            int32.
        redrawer: The launches of `redraw`; see `Redrawer`.
        variants: The variant that each world has of each object with variants, numbered as in the scene file, objects
            in the order of `SceneConfig.variants`; shape (nworld, number of these objects), int32.

    Raises:
        ArgumentTypeError: `compiled`, `model`, `data`, `layout_source` or `prefetch` is of another type.
        SceneMismatchError: Model, data or layout_source have another scene, device or number of worlds.
        ArgumentError: Both `layout_source` and `prefetch` or `params`, or a stream of another device.
        ArgumentTypeError, ArgumentError: `origins` are no floats, or not one for each world.
        UnknownNameError: `scope` is neither "world" nor "scene".
        FixedError: Raised on assignment to an attribute that captured graphs already use.
    """

    STATE_FIELDS = fields_of_data(
        *("time", "qpos", "qvel", "act", "history", "plastic", "ctrl", "mocap_pos", "mocap_quat", "eq_active"),
        *("qacc_warmstart", "qfrc_applied", "xfrc_applied", "userdata", "tree_asleep"),
    )
    """Arrays of Data that keep their bits in worlds that are not reset: the state that determines all others.

    With a need of "sensors" or "dynamics", `history` also gets the present values of delayed sensors, as in a step.
    """
    _FIXED = ("compiled", "model", "data", "device", "pipeline", "layouts", "levels", "split", "fields", "redrawer")
    _ARGUMENTS = ("layout_source", "params", "seed", "prefetch", "scope", "origins", "mjm", "needs", "graph")
    _shared: ModelFields | None = None

    @classmethod
    def of_batch(cls, batch: Batch, compiled: CompiledScene, **arguments: Any) -> ResetRandomizer:
        """Return a randomizer of a Batch. Both share the fields of the Model, which may still grow."""
        made = cls.__new__(cls)
        made._shared = batch.fields
        made.__init__(compiled, batch.model, batch.data, **arguments)
        return made

    redraw_count = TensorView(lambda randomizer, name: randomizer.redrawer.number)
    redraw_status = TensorView(lambda randomizer, name: randomizer.redrawer.status)
    variants = TensorView(lambda randomizer, name: randomizer._writer.variant)

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
        layout_source: SourceLike | None = None,
        curriculum: LevelReplay | ADR | Mapping[str, Any] | None = None,
        params: str | Sequence[str] = (),
        # what a reset writes:
        scope: Literal["world", "scene"] = "world",
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
        own: Any = {"seed": seed, "split": split, "prefetch": prefetch, "graph": graph}
        own |= {"layout_source": layout_source, "curriculum": curriculum}
        self.pipeline, self.levels = make_pipeline(compiled, data.nworld, "ResetRandomizer", params=params, **own)
        self.layouts = self.pipeline.layouts
        check_fit(compiled, model, data, self.layouts, mjm)
        check_names("scope", [scope], "ResetRandomizer: scope", _SCOPES)
        self.fields = self._shared or ModelFields(compiled.scene, model, data, grow=False)
        needs = list(needs)
        self.fields.columns.use_params(self.layouts.params)
        self._update, self.split = partial(updater(needs), model, data), self.pipeline.split or split
        self.layouts.view.stream = named_stream(self.split)
        self._mask = wp.zeros(data.nworld, dtype=wp.bool, device=self.device)  # a captured reset reads it
        if origins is not None:
            origins = as_origins(origins, data.nworld, self.device)
            warn_of_origins(compiled.scene, origins.numpy(), "ResetRandomizer: origins")
        variants = None
        if compiled.config.variants:
            variants = VariantWriter(compiled.scene, model, data.nworld, self.fields.varied)
        simulation = Simulation(
            compiled, model, data, self.split, self.fields.rest, self._update, origins=origins, variants=variants
        )
        self.redrawer = Redrawer(simulation, self.layouts, alone=not needs, graph=graph)
        whole = scope == "world"
        self._writer = ResetWriter(simulation, self.fields, self._mask, whole=whole, count=self.redrawer.number)
        self._reset_graph = LaunchSequence(self._launch_reset, self.device, graph=graph)
        self._refresh_graph = LaunchSequence(self._launch_refresh, self.device, graph=graph)

    @launching
    def reset(self, worlds: Any = None, *, seed: Any = None, layouts: Any = None) -> None:
        """Give worlds their next layouts, or chosen ones.

        Args:
            worlds: None for all worlds; booleans, shape (nworld,), perhaps all false; ids of worlds, shape (k,), in any
                order; or a slice. Booleans and ids may be a sequence, or an array of numpy, torch or Warp.
            seed: World i gets seed + i, from episode 0 on; or a seed for each chosen world in order, or for each world.
            layouts: A layout id, or one for each world (None is its next layout), or a mapping {"seed":
                ..., "episode": ...}. The worlds go on from there. See `LayoutSource.reseed`.

        Raises:
            ArgumentTypeError: Neither booleans nor integers.
            ArgumentError: Wrong shape, a world that does not exist, or integers that look like a mask.
            ArgumentError, SceneMismatchError, UnknownNameError: See `LayoutSource.reseed`.
        """
        self.fields.check()
        if seed is not None or layouts is not None:
            self.pipeline.reseed(worlds, seed=seed, layouts=layouts)
        self.launch_reset(as_worlds(worlds, self.data.nworld, self.device, self._mask))

    def launch_reset(self, mask: wp.array | None) -> None:
        """Reset the masked worlds: `reset` without its checks.

        Args:
            mask: Which worlds, on the device, shape (nworld,), bool; all if None. It may be overwritten afterwards.
        """
        self.fields.close()
        fill_mask(mask, self._mask)
        self._reset_graph.replay()
        self.pipeline.after_reset()

    @launching
    def redraw(self, objects: str | Sequence[str], worlds: Any = None) -> None:
        """Give objects new places in some worlds, in the middle of their episodes.

        All else stays bit for bit as it is in `data`: it is an obstacle, an anchor of relations, and a support if it is
        level. The objects come to rest; joints of theirs that the scene does not draw go home. The result is a pure
        function of scene, split, seed, episode, number of the redraw since the reset (`redraw_count`) and state.
        Where nothing fits, the world keeps its state, `redraw_status` is `LayoutStatus.KEPT`, and `redrawer.kept`
        counts it. Positions and orientations in space of the objects are brought up to date; those of all bodies only
        along with `needs`. `data.contact` is that of the last step, unless `needs` has "contacts".

        Seeds, episodes and presence are those of `layouts`, also in worlds that `write` has reset.

        The first call for some objects prepares their search. Later ones launch on the device alone, so they can be
        captured in a graph.

        Args:
            objects: Names of placed objects, each with all that the scene puts on it.
            worlds: As in `reset`.

        Raises:
            UnknownNameError: Not an object that the scene places.
            ArgumentError: No objects, or one that carries another; or a first call inside of a capture.
            ArgumentTypeError, ArgumentError: As in `reset`.
        """
        self.redrawer.launch(objects, as_worlds(worlds, self.data.nworld, self.device, self.redrawer.mask))

    def model_field(self, name: str, of: str | None = None) -> Any:
        """Return a field of the Model with a row for each world as a torch tensor, to write to after a reset.

        Make the Model with a row for each world, by `make_worlds(compiled, nworld, fields=name)`. Call `refresh` after
        writing to it. A field that `make_worlds` has made for the scene's draws is asked for before the first reset.

        Args:
            name: The field, by its name in mujoco_warp's Model: "body_mass", "geom_friction", "gravity".
            of: An element of the model, or an object or a robot, of which a field of bodies has the row of the root
                body, and other fields those of all geoms, joints or actuators inside.

        Returns:
            A view that steps read, shape (nworld, number of elements, ...); (nworld, ...) for `of` a single element.

        Raises:
            UnknownNameError: There is no such field or element, or layouts depend on it.
            ArgumentError: It is asked for after the first reset, or the model has none of what it scales.
            SceneMismatchError: The Model has one row for all worlds.
        """
        return wp.to_torch(self.fields.ask(name, of, where="ResetRandomizer.model_field"))

    @launching
    def scale_field(self, name: str, of: str, factor: Any) -> None:
        """Scale part of a field in the worlds of the latest reset; call `refresh` after the last one.

        Other components and the fields that follow are those of the word `scale` in a scene file: inertias follow
        masses.

        Args:
            name: A field that `make_worlds` or `model_field` was asked for.
            of: An element of the model, or an object or a robot.
            factor: Factors of the model's values, a torch, numpy or Warp array, shape (nworld,), float32.

        Raises:
            UnknownNameError, ArgumentError, SceneMismatchError: As in `model_field`; or factors of another shape, or a
                first call with these names inside of a capture.
        """
        self.fields.scale(name, of, factor, self._mask, "ResetRandomizer.scale_field")

    def random(self, name: str, shape: int | Sequence[int] = ()) -> Any:
        """Draw uniform numbers in [0, 1) by name, as a torch tensor, shape (nworld, *shape), float32.

        They depend only on the seed and the episode of a world's layout, the split, and the name.
        """
        view, nworld, shape = self.layouts.view, self.data.nworld, as_shape(shape, "random: shape")
        values = wp.empty((nworld, math.prod(shape)), dtype=float, device=self.device)
        draw_named(view.seed, view.episode, self.split, name, values)
        return wp.to_torch(values).reshape(nworld, *shape)

    @launching
    def refresh(self) -> None:
        """Bring up to date what follows from model fields that were written to, in the worlds of the latest reset.

        These are inverse weights, masses of subtrees, poses of cameras and lights, controls that hold the pose, and
        `needs`.

        Raises:
            FixedError: An array of a field was replaced instead of written to.
        """
        self.fields.check()
        self._refresh_graph.replay()

    @launching
    def write(self, layouts: Layouts | LayoutTable, rows: Any) -> None:
        """Reset worlds to stored layouts, with their physics and looks. `self.layouts` does not change.

        Args:
            layouts: Layouts of this scene, on the device or on the host.
            rows: Row of `layouts` for each world, -1 for worlds that stay as they are, shape (nworld,).

        Raises:
            SceneMismatchError: The layouts are of another scene, or were drawn with other params.
            UnknownNameError, ArgumentError: The scene has no such params, or not such numbers of them.
            ArgumentError, ArgumentTypeError: The rows are not integers, have the wrong shape or do not exist.
        """
        stored = stored_rows(layouts, self.layouts, str(self.device))
        nrow = stored.seed.shape[0]
        on_device = as_rows(rows, nrow, self.data.nworld, self.device)
        with wp.ScopedDevice(self.device):
            mask_of_rows(on_device, nrow, self._mask)
            self._writer.launch(stored, on_device)

    def _launch_variants(self, mask: wp.array) -> None:
        """Give the masked worlds the variants of their present layouts, without a reset."""
        if self._writer.variants is not None:
            fill_mask(mask, self._mask)
            self._writer.variants.launch(poses_of(self.layouts.view), self._mask, self.layouts.view.present)

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
        self.pipeline.launch_generate(self._mask)
        self._writer.launch(self.layouts.view)

    def _launch_refresh(self) -> None:
        self.fields.launch_follow(self._mask)
        self._update()
