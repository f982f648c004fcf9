"""`LayoutGenerator`: generates the next layouts of the masked worlds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.device.fixed import Fixed
from sceniris_gym.device.random import SPLITS
from sceniris_gym.device.sequence import launch_beside, launch_if, launching, repeat_launches
from sceniris_gym.errors import ArgumentError, SceneMismatchError, check_type
from sceniris_gym.layout.layouts import Layouts, allocate_record, column_of
from sceniris_gym.layout.masks import as_count, fill_mask
from sceniris_gym.layout.reaching.stage import ReachStage
from sceniris_gym.layout.reading import read_layouts
from sceniris_gym.layout.redraw import Redraw, RedrawCounts
from sceniris_gym.layout.seeds import launch_close
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.layout.wave.accept import launch_accept
from sceniris_gym.layout.wave.ahead import count_ahead, launch_draw_ahead
from sceniris_gym.layout.wave.boxes import launch_draw_in_boxes
from sceniris_gym.layout.wave.collision import launch_test_collisions
from sceniris_gym.layout.wave.conditions import launch_draw_presence
from sceniris_gym.layout.wave.draw import launch_draw
from sceniris_gym.layout.wave.points import launch_draw_points
from sceniris_gym.layout.wave.prefilter import launch_prefilter
from sceniris_gym.layout.wave.rounds import launch_begin_episodes, launch_open_rows
from sceniris_gym.layout.wave.search import SearchSize, Workspace, create_search, default_size, suited_size
from sceniris_gym.layout.wave.settle import launch_settle
from sceniris_gym.layout.wave.sides import create_regions
from sceniris_gym.layout.wave.standing import launch_test_standing
from sceniris_gym.layout.wave.start_kinds import launch_draw_kinds, launch_put_at_markers
from sceniris_gym.layout.world_columns import Masses, search_columns
from sceniris_gym.program.checks.simulation import array_bytes, check_worlds
from sceniris_gym.program.compiled import CompiledScene, check_split
from sceniris_gym.program.device import REACH_CAUSES, Cause
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.part import chosen_objects, part_of
from sceniris_gym.scene.layout_table import LayoutTable

# A redraw places few objects in few worlds, so a small wave suffices. Further candidates wait for the next wave.
_MOST_REDRAWN = 1 << 14
# The test for standing of a stack with more levels takes longer than the collision test.
_LOW_STACK = 2


class LayoutGenerator(Fixed, LayoutSource):
    """A source of fresh layouts, each a pure function of (scene, split, seed, episode).

    Args:
        compiled: The scene.
        nworld: Number of worlds.
        seed: One integer (world i gets seed + i), or one 64-bit seed per world.
        split: "train" or "eval". The splits share no random numbers and have separate banks.
        params: Names of params, or patterns such as "objects.*.joints.*". See `set_params`.
        size: Capacities, which affect only the speed, not the layouts. None takes defaults for the device, the scene
            and the number of worlds.

    Raises:
        UnknownNameError: An unknown param.
        ArgumentError: A seed is not a 64-bit integer, or the number of seeds is not the number of worlds. The split is
            unknown, a part of the scene cannot be a param, or `nworld` is not an integer or is out of range.
        FixedError: Raised on assignment to an attribute that captured graphs already use.
        MemoryLimitError: The worlds do not fit into memory.
    """

    _FIXED = ("compiled", "split", "size", "layouts")
    _ARGUMENTS = ("nworld", "seed", "params")
    _masses: Masses | None = None

    @launching
    def __init__(
        self,
        compiled: CompiledScene,
        nworld: int,
        *,
        seed: int | Sequence[int] | np.ndarray = 0,
        split: str = "train",
        params: str | Sequence[str] = (),
        size: SearchSize | None = None,
    ) -> None:
        check_type(compiled, CompiledScene, "LayoutGenerator: compiled")
        check_split(split, "LayoutGenerator", tuple(SPLITS))  # a user does not need to know the others
        nworld = as_count(nworld, "LayoutGenerator: nworld")
        size = suited_size(compiled, nworld) if size is None else size
        check_type(size, SearchSize, "LayoutGenerator: size")
        check_worlds(compiled.config.where, nworld, compiled.device, generator_memory(compiled, size))
        self.compiled, self.size = compiled, size
        self.split: str = split  # pyrefly: ignore[bad-override-mutable-attribute]
        self.layouts = Layouts.create(compiled, nworld, rows=size.rows, params=params, split=split)
        draws_joints = compiled.starts is not None and any(kind.joints for kind in compiled.config.start)
        at_marker = np.zeros((1, 0)) if compiled.starts is None else compiled.starts.marker.numpy() >= 0
        self._at_markers = int(np.flatnonzero(at_marker.any(axis=0)).max(initial=-1)) + 1
        by_world = ("draw_range",) if draws_joints else ()
        self._columns, program, statics = search_columns(compiled, nworld, self.layouts.params, by_world, self._masses)
        self._usual_range = wp.clone(program.draw_range) if draws_joints else None
        self._boxes = self.layouts.params.boxes(compiled)
        search, reaching = create_search(compiled, nworld, size), compiled.reaching
        self._regions = create_regions(compiled, search.cause.shape[0])
        cuts = int((program.obj_cutnum.numpy() > 0).sum())
        # if most waves cut no regions, they are worth a test that takes as long as two launches
        self._cuts, self._cuts_rarely = cuts > 0, 0 < 3 * cuts <= len(compiled.placed)
        # pyrefly: ignore[missing-argument]
        reaches = [Reach()] if reaching is None else [one.view for one in reaching.arms]
        ahead, view = 0 if self._boxes is not None else count_ahead(compiled, size), self.layouts.view
        self._work = Workspace(compiled, program, statics, ahead, reaches, SPLITS[split], size, view, search)
        few = replace(size, lanes=min(size.lanes, SearchSize.lanes), blocks=min(size.blocks, SearchSize.blocks))
        self._few_rows = replace(self._work, size=few)  # with few rows, more lanes and blocks would be idle
        staged = reaching is not None and (reaching.staged or compiled.starts is not None)
        self._stage = ReachStage(self._work, reaching) if reaching is not None and staged else None
        self._stacks_are_low = statics is not None and statics.obj_levelnum.numpy().max() <= _LOW_STACK
        # First, waves are full: there are more rows than candidates. Later, each wave has a candidate of every row.
        most_trials, capacity = len(compiled.placed) * compiled.attempts, search.cause.shape[0]
        self._most_waves = most_trials + -(-(nworld + size.rows) * most_trials // capacity)
        self._mask = wp.zeros(nworld, dtype=wp.bool, device=compiled.device)
        self._redraws: dict[tuple[str, ...], Redraw] = {}
        if self._stage is not None:
            self._stage.launch_pose_hands()
        self.reseed(seed=seed)

    @classmethod
    def _recording(
        cls, compiled: CompiledScene, nworld: int, rejected: int, *, every_cause: bool = False, **options: Any
    ) -> LayoutGenerator:
        """Return a generator that records rejected candidates, for audits.

        Args:
            compiled: The scene.
            nworld: Number of worlds.
            rejected: Maximum number of recorded candidates. The first candidates that collide are recorded.
            every_cause: Also record candidates that had a pose but were rejected for another cause than a collision.
            options: Other arguments of the class.
        """
        # no parallel restarts and no objects drawn ahead, because some of their candidates are not needed
        size = replace(options.pop("size", None) or default_size(compiled.device), rows=0)
        generator = cls(compiled, nworld, size=size, **options)
        generator._work = replace(generator._work, ahead=0)
        generator.layouts.view.record_all = int(every_cause)
        allocate_record(generator.layouts.view, as_count(rejected, "LayoutGenerator: rejected", 0))
        return generator

    @property
    def nworld(self) -> int:
        """Number of worlds."""
        return self.layouts.nworld

    def launch_generate(self, mask: wp.array | None) -> None:
        """See `LayoutSource`. The first kernel of `launch_make` sets the seed and episode of the next layouts."""
        self.launch_make(mask)
        launch_close(self.layouts.view, mask, self.size.block_dim)

    def launch_make(self, mask: wp.array | None, prepare: Callable[[], None] | None = None) -> None:
        """See `LayoutSource`.

        Args:
            mask: Selected worlds, shape (nworld,), bool. None selects all.
            prepare: A function that launches kernels. These kernels fill the rows of the selected worlds before placing
                begins.
        """
        self._make(mask, self._stage, prepare)

    def launch_placing(self, mask: wp.array | None) -> None:
        """Advance the masked worlds by one episode and place their objects.

        The reach stage, which finds joints for grasps, is left out.
        """
        self._make(mask, None)
        launch_close(self.layouts.view, mask, self.size.block_dim)

    def _make(self, mask: wp.array | None, stage: ReachStage | None, prepare: Callable[[], None] | None = None) -> None:
        """Begin episodes in the masked worlds, and repeat restarts until each has a valid layout or one of the bank."""
        if self._usual_range is not None:  # the last layout's kind of start may have overwritten the intervals
            wp.copy(self._work.program.draw_range, self._usual_range)
        if prepare is None:
            self._columns.launch(mask, self._work.layouts, opens=True)
        launch_begin_episodes(self._work, mask)
        if self._work.compiled.conditions is not None:
            launch_draw_presence(self._work, mask)
        if prepare is not None:
            prepare()
            self._columns.launch(mask, self._work.layouts)
        if self._stage is not None:
            self._stage.search.rows_left.zero_()  # an interrupt of earlier launches may have left rows
        if self._work.compiled.starts is not None:
            launch_draw_kinds(self._work, mask)
        once = partial(self._round, stage)
        repeat_launches(self._work.search.worlds_left, once, self.compiled.config.restarts + 1)

    def _round(self, stage: ReachStage | None) -> None:
        """Try the next restarts of every pending world: place all objects, then find joints for the reach targets."""
        work, wave = self._work, partial(self._wave, stage is not None)
        launch_open_rows(work, stage is not None)
        if work.ahead > 0:
            launch_draw_ahead(work)
        if self._few_rows.size != work.size:
            repeat_launches(work.search.many_rows, partial(wave, work), self._most_waves)
        repeat_launches(work.search.rows_left, partial(wave, self._few_rows), self._most_waves)
        if stage is not None:
            stage.launch()
        launch_settle(work)

    def _wave(self, staged: bool, work: Workspace) -> None:
        """Draw candidates for all rows, test them, and accept the first valid candidate of each row."""
        launch_draw(work, self._regions)
        if self._boxes is not None:
            launch_draw_in_boxes(work, self._boxes)
        if self._cuts_rarely:
            launch_if(work.search.cutting, partial(launch_draw_points, work, self._regions))
        elif self._cuts:
            launch_draw_points(work, self._regions)
        if self._at_markers > 0:
            launch_put_at_markers(work, self._at_markers)
        launch_prefilter(work)
        if work.statics is None:
            launch_test_collisions(work)
        elif self._stacks_are_low:
            both = partial(launch_test_collisions, work), partial(launch_test_standing, work)
            launch_beside(*both, self._mask.device)
        else:
            launch_test_collisions(work)
            launch_test_standing(work)
        if self._stage is not None:
            self._stage.launch_test_hands()
        launch_accept(work, staged)

    def twin(self) -> LayoutGenerator:
        """See `LayoutSource`.

        Raises:
            ArgumentError: The generator records rejected candidates.
        """
        if self.layouts.view.rejected_object.shape[0] > 0:
            raise ArgumentError(
                "LayoutGenerator: cannot prefetch while it records rejected candidates. Use another generator."
            )
        names = self.layouts.params.names
        return LayoutGenerator(self.compiled, self.nworld, split=self.split, size=self.size, params=names)

    def __init_subclass__(cls) -> None:
        """Drop the inherited `twin`, because a subclass may make other layouts and then needs a matching `twin`."""
        super().__init_subclass__()
        cls.twin = cls.__dict__.get("twin", LayoutSource.twin)

    def table(self, nrow: int | None = None) -> LayoutTable:
        """Copy the first `nrow` layouts to the host, or all layouts by default.

        Raises:
            ArgumentError: `nrow` is not an integer of at least 0.
        """
        nrow = nrow if nrow is None else as_count(nrow, "LayoutGenerator.table: nrow", 0)
        return read_layouts(self.layouts, self.split, nrow)

    @launching
    def redraw(self, layouts: Layouts, objects: str | Sequence[str]) -> Layouts:
        """Move objects of finished layouts to new places, or add objects to them. All other objects stay in place.

        To build up layouts step by step, leave objects out by `groups` in the scene file, and add some of them with
        each call. A row of the result is a pure function of scene, split, seed, episode and the layout before the call.
        If no place is found, the row is returned unchanged with the status KEPT. Reach targets that are not
        moved may lose their grasps. Layout ids do not change: they reproduce the original layout, without the added
        objects.

        Args:
            layouts: One layout of this scene per world, on the same device, such as a result of `generate` or of this
                method.
            objects: Names of placed objects. Add supports and anchors no later than the objects that are placed
                relative to them.

        Returns:
            The layouts with these objects. Calls for the same objects always write to the same arrays.

        Raises:
            ArgumentTypeError, SceneMismatchError: Not `Layouts`, or of another scene or number of worlds.
            UnknownNameError: Not an object that the scene places.
            ArgumentError: `objects` is empty, or lacks an object that stands on a named object in these layouts.
        """
        check_type(layouts, Layouts, "redraw: layouts")
        if (layouts.compiled.hash, layouts.nworld) != (self.compiled.hash, self.nworld):
            raise SceneMismatchError(
                f"redraw: layouts should be {self.nworld} layouts of scene {self.compiled.hash} "
                f"('{self.compiled.config.name}'), got {layouts.nworld} of {layouts.compiled.hash} "
                f"('{layouts.compiled.config.name}')."
            )
        if {*layouts.params.names} & {*layouts.params.of_draws.values()}:
            raise ArgumentError(
                "redraw: the layouts have params of drawn physics, but a redraw draws physics from the scene file. "
                "Make the layouts without these params."
            )
        there = column_of(layouts, "present").numpy().any(axis=0)
        present = [self.compiled.slots[i] for i in np.flatnonzero(there)]
        names = chosen_objects(self.compiled, objects, "redraw", present)
        if names not in self._redraws:
            self._redraws[names] = make_redraw(self.compiled, names, self.nworld, self.split)
        fill_mask(None, self._mask)
        self._redraws[names].launch(layouts.view, self._mask, RedrawCounts.zeros(self.nworld, layouts.view.seed.device))
        return self._redraws[names].layouts

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """Return `Layouts.rejections` by object (in placement order), then by cause in lower case.

        Causes of the reach stage are included if the scene has reach targets, `unsound` if it occurred, and `falls` if
        objects can fall.
        """
        counts = self.layouts.view.rejections.numpy()
        unused = {Cause.NONE, *(REACH_CAUSES if self.compiled.reaching is None else ())}
        unused |= set() if counts[:, Cause.UNSOUND].any() else {Cause.UNSOUND}
        unused |= {Cause.FALLS} if self.compiled.statics is None else set()
        causes = [c for c in Cause if c not in unused]
        return {
            name: {c.name.lower(): int(counts[i, c]) for c in causes} for i, name in enumerate(self.compiled.placed)
        }


class _PartGenerator(LayoutGenerator):
    """A generator that places only some objects, for a `Redraw`. `masses` is as in `make_redraw`."""

    def __init__(self, *given: Any, masses: Masses | None, **options: Any) -> None:
        self._masses = masses
        super().__init__(*given, **options)


def make_redraw(
    compiled: CompiledScene, objects: Sequence[str], nworld: int, split: str, masses: Masses | None = None
) -> Redraw:
    """Return a `Redraw` of the objects that `chosen_objects` returned, in finished layouts or in the simulation.

    `masses` are `body_mass` and `body_ipos` of the simulated Model, in which absent objects stay absent. If `masses` is
    None, the draws in the scene file determine the masses, and absent objects are added.
    """
    size = default_size(compiled.device)
    # no rows for parallel restarts: each of them would need a copy of the state
    size = replace(size, rows=0, candidates=min(size.candidates, _MOST_REDRAWN))
    generator = _PartGenerator(part_of(compiled, objects), nworld, split=split, size=size, masses=masses)
    return Redraw(compiled, objects, generator, adds=masses is None)


def generator_memory(compiled: CompiledScene, size: SearchSize) -> tuple[int, int]:
    """Return the bytes of a LayoutGenerator with these capacities, as a part of `check_worlds`."""
    row, one = array_bytes(Layouts.create(compiled, 1).view), replace(size, rows=0, candidates=1, narrow_pairs=0)
    candidate = array_bytes(create_search(compiled, 1, one), create_regions(compiled, 1))
    return size.rows * row + size.most_candidates(compiled) * candidate + 16 * size.narrow_pairs, row
