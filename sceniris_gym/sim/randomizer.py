"""`ResetRandomizer`: resets worlds to fresh layouts in your own mujoco_warp loop."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.fixed import Fixed, StaysHere
from sceniris_gym.device.random import named_stream
from sceniris_gym.device.sequence import LaunchSequence, launching
from sceniris_gym.device.tensors import TensorView
from sceniris_gym.errors import as_names, check_names, check_type
from sceniris_gym.layout.columns import NEXT, columns
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.masks import as_rows, as_shape, as_world_ids, as_worlds, fill_mask, mask_of_rows
from sceniris_gym.levels.curriculum import ADR, LevelReplay
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import Batch, check_budget, updater
from sceniris_gym.sim.fit import check_fit
from sceniris_gym.sim.model_fields import ModelFields
from sceniris_gym.sim.named_random import draw_named
from sceniris_gym.sim.redrawing import Redrawer
from sceniris_gym.sim.reset_writer import ResetWriter, Simulation
from sceniris_gym.sim.sources import SourceLike, make_pipeline, stored_rows
from sceniris_gym.sim.variants import VariantReader, VariantWriter
from sceniris_gym.sim.versions import fields_of_data
from sceniris_gym.sim.write import as_origins, poses_of, warn_of_origins

if TYPE_CHECKING:
    from sceniris_gym.sim.snapshot import Snapshot


class ResetRandomizer(Fixed, StaysHere):
    """Resets selected worlds to fresh layouts. The state of all other worlds stays bitwise unchanged.

    A reset clears the data of the selected worlds with `mjw.reset_data`, including velocities, warm starts, clocks and
    NaNs. It then writes the positions, mocap poses, activations and controls of their next layouts. Position actuators
    hold the sampled pose, and bear the weight of an arm that `gravcomp` does not bear. Other controls come from the
    home keyframe. The history of delayed actuators is filled with the same controls. A reset with a mask on the device
    does not synchronise with the host, so it can be captured in a graph.

    If Ctrl-C interrupts a reset, reset the same worlds again, because their state is only partly written. The repeated
    reset serves the same layouts, or the next layouts if the interrupted reset had already made its layouts.

    The arrays in `STATE_FIELDS` are the state of a world, so the other worlds continue as if no reset had happened. But
    a reset also updates computed arrays in all worlds: world poses (xpos, geom_xpos, site_xmat, ...) and the quantities
    in `needs`. After `mjw.step`, computed arrays are one step older than qpos. If your loop does not update them, a
    reset therefore changes their values in the other worlds, too.

    After a reset, `data.contact` has no contacts of the selected worlds, and `data.nacon` does not count them. Contacts
    of the other worlds keep their values, but may move to other places in the list. If `needs` has "contacts",
    "sensors" or "dynamics", collision detection runs again for all worlds.

    Args:
        compiled: The compiled scene, on the device of `data`.
        model: mujoco_warp Model made from `compiled.sim_mjm`, or from another model whose bodies, joints and geoms have
            the same order, types, sizes and places. Masses, frictions, gains and options may differ. If objects have
            variants, use the Model of `make_worlds`.
        data: mujoco_warp Data of the worlds. `make_worlds` leaves room for the contacts of most scenes, and
            `check_budget` checks whether the room is enough.
        seed: An integer (world i gets seed + i), or a sequence with one seed per world. Not used with a layout_source.
        split: Split of the layouts, "train" or "eval". The two splits use different random numbers. The split of a
            layout_source takes precedence.
        prefetch: Make the next layout of every world in advance, so that a reset only copies it. On a GPU, prefetching
            runs concurrently with the following steps. Prefetching does not change the layouts. It allocates a second
            generator (for 4,096 worlds, 88 MB in `mid` and 640 MB in `kitchen_reset`). None prefetches on a GPU, unless
            a layout_source is given. Pass a wp.Stream to choose the stream. A reset in your own graph makes its layouts
            without prefetching.
        layout_source: A LayoutSource, a LayoutTable or LayoutDataset whose rows are served, or a function
            `(compiled, nworld)` that returns a LayoutSource. None makes a LayoutGenerator with `seed`, `split` and
            `prefetch`.
        curriculum: Chooses each world's next layout from the outcomes of earlier episodes: a LevelReplay, an ADR, or a
            mapping with the fields of one of these classes. With None, each world plays the episodes of its seed in
            order.
        params: Names or patterns of the params of the worlds, see `LayoutSource.set_params`. Not with a layout_source.
        scope: "world" resets whole worlds. "scene" writes only the scene's objects and robots, their velocities, and
            the controls that hold them. Clocks and everything else in the world stay unchanged.
        origins: Origins of the worlds [m], shape (nworld, 3). Layouts are relative to the origins, so a reset adds them
            to all positions that it writes. If this is a Warp array or torch tensor on the device, each reset reads its
            current values. Geoms fixed to the world do not move, and a ModelWarning names them.
        needs: Quantities that a reset updates in addition to world poses: "velocity", "contacts", "sensors" or
            "dynamics".
        mjm: The MjModel of `model`. If given, its names are compared, too. A mujoco_warp Model does not keep names.
        graph: If true, the reset is captured into a graph, which later resets replay.

    Attributes:
        pipeline: The LayoutPipeline that makes, prefetches and chooses the layouts.
        layouts: The latest layouts, one row per world.
        levels: The LevelSampler of the curriculum, or None.
        split: The split of the layouts.
        fields: The ModelFields: fields of `model` that have a row for each world.
        redraw_count: Redraws of each world since its reset, shape (nworld,), int32.
        redraw_status: `LayoutStatus` of each world's latest redraw, VALID or KEPT, or NONE before the first redraw,
            shape (nworld,), int32.
        redrawer: The launches of `redraw`, a `Redrawer`.
        variants: For each object with variants, the index of its present variant in the scene file's list, or -1 if
            the object is absent, shape (nworld, number of objects with variants), int32. Columns follow
            `SceneConfig.variants`.

    Raises:
        ArgumentTypeError: `compiled`, `model`, `data`, `layout_source` or `prefetch` has another type.
        SceneMismatchError: Model, data or layout_source belong to another scene, device or number of worlds.
        ArgumentError: `layout_source` is given together with `prefetch` or `params`, or the stream belongs to another
            device.
        ArgumentTypeError, ArgumentError: `origins` does not hold floats, or has another shape.
        UnknownNameError: `scope` is not "world" or "scene".
        FixedError: Raised on assignment to an attribute that captured graphs already use.
    """

    STATE_FIELDS = fields_of_data(
        *("time", "qpos", "qvel", "act", "history", "plastic", "ctrl", "mocap_pos", "mocap_quat", "eq_active"),
        *("qacc_warmstart", "qfrc_applied", "xfrc_applied", "userdata", "tree_asleep"),
    )
    """Arrays of Data that a reset keeps bitwise in all other worlds. They determine all computed arrays.

    If `needs` has "sensors" or "dynamics", `history` also receives the present values of delayed sensors, as in a step.
    """
    _FIXED = ("compiled", "model", "data", "device", "pipeline", "layouts", "levels", "split", "fields", "redrawer")
    _ARGUMENTS = ("layout_source", "params", "seed", "prefetch", "scope", "origins", "mjm", "needs", "graph")
    _shared: ModelFields | None = None

    @classmethod
    def of_batch(cls, batch: Batch, compiled: CompiledScene, **arguments: Any) -> ResetRandomizer:
        """Return a randomizer for a Batch. Until the first reset, fields can still be expanded to a row per world.

        Raises:
            ArgumentTypeError: `batch` is not a Batch.
        """
        check_type(batch, Batch, "ResetRandomizer.of_batch: batch")
        made = cls.__new__(cls)
        made._shared = batch.fields
        made.__init__(compiled, batch.model, batch.data, **arguments)
        return made

    redraw_count = TensorView(lambda randomizer, name: randomizer.redrawer.counts.number)
    redraw_status = TensorView(lambda randomizer, name: randomizer.redrawer.counts.status)
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
        # content of a reset:
        scope: Literal["world", "scene"] = "world",
        origins: Any = None,
        needs: str | Iterable[str] = (),
        # checks and launches:
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
        where = "SceneVectorEnv" if self._shared else "ResetRandomizer"
        self.pipeline, self.levels = make_pipeline(compiled, data.nworld, where, params=params, **own)
        self.layouts = self.pipeline.layouts
        check_fit(compiled, model, data, self.layouts, mjm)
        check_names("scope", [scope], "ResetRandomizer: scope", ("world", "scene"))
        self.fields = self._shared or ModelFields(compiled.scene, model, data, grow=False)
        needs = as_names(needs, "ResetRandomizer: needs")
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
        self._writer = ResetWriter(simulation, self.fields, self._mask, whole=whole, count=self.redrawer.counts.number)
        self._reset_graph = LaunchSequence(self._launch_reset, self.device, graph=graph)
        self._refresh_graph = LaunchSequence(self._launch_refresh, self.device, graph=graph)

    @launching
    def reset(self, worlds: Any = None, *, seed: Any = None, layouts: Any = None) -> None:
        """Reset worlds to their next layouts, or to layouts that you choose.

        Args:
            worlds: A mask of booleans, shape (nworld,), or ids of worlds in any order, shape (k,), or a slice. None
                selects all worlds. A mask may be false for all worlds. Masks and ids may be sequences, or numpy, torch
                or Warp arrays.
            seed: An integer (world i gets seed + i), or a sequence with one seed per chosen world in order, or with one
                per world. The chosen worlds start at episode 0.
            layouts: A layout id, a sequence of ids (None keeps a world's next layout), or a mapping {"seed": ...,
                "episode": ...}. Later episodes of a world follow its chosen episode. See `LayoutSource.reseed`.

        Raises:
            ArgumentTypeError: `worlds` has values other than booleans and integers.
            ArgumentError: `worlds` has a wrong shape, a world that does not exist, or integers that look like a mask.
            ArgumentError, SceneMismatchError, UnknownNameError: See `LayoutSource.reseed`.
        """
        self.fields.check()
        if seed is not None or layouts is not None:
            self.reseed(worlds, seed=seed, layouts=layouts)
        self.launch_reset(as_worlds(worlds, self.data.nworld, self.device, self._mask))

    def launch_reset(self, mask: wp.array | None) -> None:
        """Reset the masked worlds. The same as `reset`, without its checks.

        Args:
            mask: Selected worlds, on the device, shape (nworld,), bool, or None for all. The call copies the mask.
        """
        self.fields.close()
        fill_mask(mask, self._mask)
        self._reset_graph.replay()
        self.pipeline.after_reset()

    def reseed(self, worlds: Any = None, *, seed: Any = None, layouts: Any = None) -> None:
        """Choose the next layouts of worlds, but do not reset the worlds now. See `LayoutSource.reseed`."""
        self.pipeline.reseed(worlds, seed=seed, layouts=layouts)

    def set_param(self, name: str, value: Any, worlds: Any = None) -> None:
        """Set a param of worlds, from their next layouts on. See `LayoutSource.set_params`."""
        self.pipeline.set_params({name: value}, worlds)

    def layout_ids(self) -> list[str]:
        """Return the ids of the current layouts, one per world. Waits for the device."""
        return self.pipeline.ids(self.split)

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """Return the number of rejected candidates so far, by object and cause. Waits for the device."""
        return self.pipeline.rejection_counts()

    @launching
    def redraw(self, objects: str | Sequence[str], worlds: Any = None) -> None:
        """Move objects to new, valid places in some worlds, in the middle of their episodes.

        Everything else in `data` stays bitwise unchanged. All other bodies act as obstacles, as anchors of relations
        and, if they are horizontal, as supports. The named objects start at rest. Joints that the scene file lists
        under `joints` get new positions, and the other joints of these objects return to the home pose. The result is
        a pure function of the scene, the split, the seed, the episode, the state, and `redraw_count`, the number of
        redraws since the reset.

        If no place is found, the world keeps its state, `redraw_status` is `LayoutStatus.KEPT`, and `redrawer.kept`
        counts the failure.

        Without `needs`, a redraw updates only the world poses of the named objects, and `data.contact` still lists the
        contacts of the last step. With `needs`, it updates the world poses of all bodies and the needed quantities.

        Seeds, episodes and the presence of objects come from `layouts`, even in worlds that `write` has reset.

        The first call for a set of objects prepares their search on the host. Later calls only launch kernels, so they
        can be captured in a graph.

        Args:
            objects: Names of placed objects. If you name an object, also name all objects that the scene puts on this
                object.
            worlds: As in `reset`.

        Raises:
            UnknownNameError: The scene does not place an object of this name.
            ArgumentError: `objects` is empty, or lacks an object that stands on a named object or is in the same heap.
                Or the first call for these objects is inside a capture.
            ArgumentTypeError, ArgumentError: As in `reset`.
        """
        self.redrawer.launch(objects, as_worlds(worlds, self.data.nworld, self.device, self.redrawer.mask))

    def model_field(self, name: str, of: str | None = None) -> Any:
        """Return a field of the Model as a torch tensor with a row for each world. Write into it after a reset.

        Make the Model with `make_worlds(compiled, nworld, fields=name)`, so that the field has a row for each world.
        Call `refresh` after writing. Fields named in `make_worlds` can be requested at any time, and other fields only
        before the first reset.

        Args:
            name: The field's name in mujoco_warp's Model, such as "body_mass", "geom_friction" or "gravity".
            of: A model element, an object or a robot. For an object or a robot, body fields refer to its root body, and
                other fields to all of its geoms, joints or actuators.

        Returns:
            A view that steps read, shape (nworld, number of elements, ...), or (nworld, ...) if `of` selects a single
            element.

        Raises:
            UnknownNameError: There is no such field or element, or layouts depend on the field.
            ArgumentError: The field is first requested after the first reset, steps do not read the field, or the rows
                of `of` are not consecutive.
            SceneMismatchError: All worlds share one row of the field, because `make_worlds` did not name it.
        """
        return wp.to_torch(self.fields.ask(name, of, where="ResetRandomizer.model_field"))

    @launching
    def scale_field(self, name: str, of: str, factor: Any) -> None:
        """Scale part of a field in the worlds of the latest reset. Call `refresh` after the last change.

        The same components and dependent fields change as with `scale` in a scene file. Inertias follow masses, for
        example.

        Args:
            name: A field that was named in `make_worlds` or `model_field`.
            of: A model element, an object or a robot.
            factor: Factor for the model's values in each world, a torch, numpy or Warp array, shape (nworld,), float32.

        Raises:
            UnknownNameError, ArgumentError, SceneMismatchError: As in `model_field`.
            ArgumentError: The factors have another shape, or the first call with these names is inside a capture.
        """
        self.fields.scale(name, of, factor, self._mask, "ResetRandomizer.scale_field")

    def random(self, name: str, shape: int | Sequence[int] = ()) -> Any:
        """Return uniform random numbers in [0, 1) for a name, as a torch tensor, shape (nworld, *shape), float32.

        The numbers depend only on the seed and episode of the world's layout, the split, and the name.
        """
        view, nworld, shape = self.layouts.view, self.data.nworld, as_shape(shape, "random: shape")
        values = wp.empty((nworld, math.prod(shape)), dtype=float, device=self.device)
        draw_named(view.seed, view.episode, self.split, name, values)
        return wp.to_torch(values).reshape(nworld, *shape)

    @launching
    def refresh(self) -> None:
        """Recompute the quantities derived from modified model fields, in the worlds of the latest reset.

        Derived quantities are inverse weights, subtree masses, poses of cameras and lights, and controls that hold the
        pose. A refresh also updates world poses and `needs`, in all worlds.

        Raises:
            FixedError: An array of a field was replaced instead of written to.
        """
        self.fields.check()
        self._refresh_graph.replay()

    @launching
    def write(self, layouts: Layouts | LayoutTable, rows: Any) -> None:
        """Reset worlds to stored layouts, with their physics and appearance. `self.layouts` does not change.

        Args:
            layouts: Layouts of this scene, on the device or on the host.
            rows: Row of `layouts` for each world, or -1 to leave a world unchanged, shape (nworld,).

        Raises:
            SceneMismatchError: The layouts belong to another scene, or were drawn with other params.
            UnknownNameError, ArgumentError: The scene does not have a param of the layouts, or a param's value is out
                of range.
            ArgumentError, ArgumentTypeError: The rows are not integers, have the wrong shape or do not exist.
        """
        stored = stored_rows(layouts, self.layouts, str(self.device))
        nrow = stored.seed.shape[0]
        on_device = as_rows(rows, nrow, self.data.nworld, self.device)
        with wp.ScopedDevice(self.device):
            mask_of_rows(on_device, nrow, self._mask)
            self._writer.launch(stored, on_device)

    @launching
    def snapshot(self, worlds: Any = None) -> Snapshot:
        """Copy the state of worlds, for `restore`.

        A snapshot contains the physics state, the layout with its variants, the seed, episode and params of the next
        layout, the redraw count, and the model fields with a row for each world. With a curriculum, `levels.state()`
        stores the next layouts instead. On a CPU, restored worlds continue bitwise as before. On a GPU, the restored
        state is bitwise the same, but later steps differ by rounding.

        Args:
            worlds: As in `reset`. If these are ids, the rows of the snapshot have the order of the ids.

        Raises:
            ArgumentTypeError, ArgumentError: As in `reset`.
        """
        from sceniris_gym.sim.snapshot import on_warp_stream, take

        with on_warp_stream(self.device):
            return take(self._source, self._live, as_world_ids(worlds, self.data.nworld))

    @launching
    def restore(self, snapshot: Snapshot, worlds: Any = None) -> None:
        """Continue from a snapshot. The other worlds keep their state bitwise, as in `reset`.

        Waits for the device, so it cannot be captured in a graph. `data.contact` lists no contacts of the restored
        worlds until the next step, unless `needs` has "contacts". With a curriculum, first restore `levels.state()` of
        the same step.

        Args:
            snapshot: A snapshot by this randomizer, or by one with the same scene, split, params and model fields.
                Either both randomizers have a curriculum, or neither. Positions in a snapshot are absolute, so they
                include `origins`.
            worlds: As in `reset`, with one world for each row. Ids may have any order. None writes each row into its
                original world.

        Raises:
            ArgumentTypeError: The value is not a Snapshot.
            SceneMismatchError: The snapshot does not fit, or it has non-finite values or indices out of range.
            ArgumentError: The number of rows differs from the number of worlds. A world does not exist, or occurs
                twice. The value of a param is out of range.
            ArgumentTypeError, ArgumentError: As in `reset`.
        """
        from sceniris_gym.sim.snapshot import on_warp_stream

        self.fields.check()
        chosen = None if worlds is None else as_world_ids(worlds, self.data.nworld)
        with on_warp_stream(self.device), wp.ScopedDevice(self.device):
            self._put_back(snapshot, self._live, chosen, "ResetRandomizer.restore: snapshot")
            self._update()

    def _put_back(self, snapshot: Any, live: Mapping[str, Any], worlds: np.ndarray | None, name: str) -> Any:
        """Check a snapshot, write it into worlds, and return a mask of these worlds, a torch tensor."""
        from sceniris_gym.sim.snapshot import check_rows, put

        check_rows(snapshot, self._source, live, self.layouts, name)
        restored = put(snapshot, live, worlds, name)
        fill_mask(wp.from_torch(restored, dtype=wp.bool), self._mask)
        if (variants := self._writer.variants) is not None:
            reader = VariantReader(self.data, variants, self.layouts.view)
            reader.launch(self._mask)
            variants.launch(poses_of(reader.state), self._mask, reader.state.present)
            put(snapshot, live, worlds, name)  # the model has the nominal values of its variants now
        self._writer.contacts.launch_drop()  # and with them the NaNs of a broken world's constraint rows
        return restored

    @property
    def _source(self) -> tuple[str, ...]:
        """The scene's hash, the split of the layouts, and the names of their params."""
        return self.compiled.hash, self.split, *self.layouts.params.names

    @property
    def _live(self) -> dict[str, Any]:
        """The torch tensors with a row for each world that snapshots store, by name."""
        from sceniris_gym.sim.snapshot import live_tensors

        chooser, d = self.pipeline.chooser, self.data
        chosen = None if chooser is None else chooser.rows()
        of_layouts = (*columns(), *(NEXT if chosen is None else ()))
        rows = {f"data.{name}": getattr(d, name) for name in (*self.STATE_FIELDS, *fields_of_data("tree_awake"))}
        rows |= {f"layout.{name}": getattr(self.layouts.view, name) for name in of_layouts}
        rows |= {f"model.{name}": array for name, array in self.fields.rows.items()}
        rows |= {f"redraws.{i}": array for i, array in enumerate(self.redrawer.counts[:2])}
        rows |= {"variant": self._writer.variant}
        # new tensors, as `live_tensors` returns them
        of_chooser = {f"chooser.{name}": tensor[: d.nworld] for name, tensor in (chosen or {}).items()}
        return live_tensors(rows, d.nworld) | of_chooser

    @launching
    def check_budget(self) -> None:
        """Check that `data` has room for all contacts: of the current state, and of each world's steps since its reset.

        mujoco_warp drops contacts that do not fit. The check waits for the device, so call it after the first reset or
        at long intervals.

        Raises:
            ContactBudgetError: The room was too small. The message names the argument of `mjw.make_data` to increase
                and its new value.
        """
        check_budget(self.model, self.data)

    def _launch_reset(self) -> None:
        self.pipeline.launch_generate(self._mask)
        self._writer.launch(self.layouts.view)

    def _launch_refresh(self) -> None:
        self.fields.launch_follow(self._mask)
        self._update()
