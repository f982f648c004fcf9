"""`LayoutGenerator`: the launch sequence of a reset, which advances the masked worlds and makes their layouts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from sceniris_gym.config.messages import short
from sceniris_gym.device.fixed import Fixed
from sceniris_gym.device.launch_lock import launching
from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.device.random import SPLITS
from sceniris_gym.device.sequence import LaunchSequence, repeat_launches
from sceniris_gym.errors import ArgumentError, MaskError, MaskTypeError, check_type
from sceniris_gym.layout.counts import as_count
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.loading import load_kernels
from sceniris_gym.layout.reaching.stage import ReachStage
from sceniris_gym.layout.seeds import launch_reseed, seeds_on_device
from sceniris_gym.layout.wave.accept import launch_accept
from sceniris_gym.layout.wave.collision import launch_test_collisions
from sceniris_gym.layout.wave.containment import launch_test_containment
from sceniris_gym.layout.wave.draw import launch_draw
from sceniris_gym.layout.wave.points import launch_draw_points
from sceniris_gym.layout.wave.prefilter import launch_prefilter
from sceniris_gym.layout.wave.region_pieces import launch_find_pieces, launch_measure_pieces
from sceniris_gym.layout.wave.rounds import (
    launch_finish,
    launch_open_candidates,
    launch_open_rows,
    launch_reopen,
    launch_settle,
    launch_start,
)
from sceniris_gym.layout.wave.search import SearchSize, create_search, default_size
from sceniris_gym.layout.wave.sides import launch_build_sides
from sceniris_gym.program.checks.memory import check_memory
from sceniris_gym.program.compiled import USER_SPLITS, CompiledScene
from sceniris_gym.program.device import REACH_CAUSES, Cause
from sceniris_gym.program.device_reach import Reach

# Regions of more pieces than this make a candidate so dear that fewer restarts are tried at once.
_MOST_PIECES = 1024


class LayoutGenerator(Fixed, StaysHere):
    """Makes layouts for a batch of worlds, each a pure function of (scene, split, seed, episode).

    Args:
        compiled: The scene.
        nworld: Number of worlds.
        seed: World i gets seed + i; a sequence of length nworld is used as it is. 64-bit, not negative.
        split: "train" or "eval": independent streams of the same seeds, each with a bank of its own.
        size: Capacities, which affect the speed and never the layouts; None for what suits the device.
        rejected: Length of a record of the first candidates that collided, for audits.
        every_cause: Whether that record is of all candidates that were rejected where they would have stood.

    Raises:
        SeedError: A seed that is not a 64-bit integer, or a wrong number of them.
        ArgumentError: An unknown split.
        CountError: A number of worlds that is no integer, or out of range.
        FixedError: An attribute that is assigned to: launches are captured with what they were.
        MemoryLimitError: More worlds than there is memory for.
    """

    FIXED = ("compiled", "split", "size", "layouts")
    ARGUMENTS = ("nworld", "seed", "rejected")

    @launching
    def __init__(
        self,
        compiled: CompiledScene,
        nworld: int,
        *,
        seed: int | Sequence[int] | np.ndarray = 0,
        split: str = "train",
        size: SearchSize | None = None,
        rejected: int = 0,
        every_cause: bool = False,
    ) -> None:
        check_type(compiled, CompiledScene, "LayoutGenerator: compiled")
        if not isinstance(split, str) or split not in SPLITS:
            raise ArgumentError(f"LayoutGenerator: unknown split {short(split)}. Valid: {', '.join(USER_SPLITS)}.")
        nworld = as_count(nworld, "LayoutGenerator: nworld")
        rejected = as_count(rejected, "LayoutGenerator: rejected", 0)
        if size is None:
            size = default_size(compiled.device)
            if compiled.pieces > _MOST_PIECES:
                size = replace(size, rows=size.rows // 8)
        if rejected > 0:
            size = replace(size, rows=0)  # rows of restarts that may not be reached are not recorded
        _check_memory(compiled, nworld, size)
        self.compiled, self.split, self.size = compiled, split, size
        self.layouts = Layouts.create(compiled, nworld, rejected=rejected, every_cause=every_cause, rows=size.rows)
        self._search = create_search(compiled, nworld, size)
        reaching = compiled.reaching
        self._reaches = [Reach()] if reaching is None else [one.view for one in reaching.arms]
        self._reach = self._reaches[0]  # what all of them have in common
        self._stage = None
        if reaching is not None and reaching.staged:
            self._stage = ReachStage(compiled, reaching, nworld, SPLITS[split], size)
        self._related = compiled.related
        self._visual = compiled.config.geometry == "visual"
        # as long as rows do not fit, all candidates are used; then every row has one in every wave
        most_trials, capacity = len(compiled.placed) * compiled.attempts, self._search.cause.shape[0]
        self._most_waves = most_trials + -(-(nworld + size.rows) * most_trials // capacity)
        self._mask, self._all = (wp.ones(nworld, dtype=wp.bool, device=compiled.device) for _ in range(2))
        self._generate = LaunchSequence(lambda: self.launch_generate(self._mask), wp.get_device(compiled.device))
        load_kernels(
            compiled.device,
            block_dim=size.block_dim,
            related=self._related,
            visual=self._visual,
            staged=self._stage is not None,
        )
        self.reseed(seed)

    @property
    def nworld(self) -> int:
        """Number of worlds."""
        return self.layouts.nworld

    @launching
    def reseed(self, seed: int | Sequence[int] | np.ndarray | wp.array, mask: wp.array | None = None) -> None:
        """Give the masked worlds new seeds; the next layout they get is that of episode 0.

        Args:
            seed: As in the class, or a uint64 Warp array of length nworld on the device of the compiled scene.
            mask: Which worlds, shape (nworld,), bool; all if None.

        Raises:
            SeedError: See the class.
            MaskError, MaskTypeError: A mask of the wrong shape, or not of booleans.
        """
        check_mask(mask, self.layouts)
        self.launch_reseed(seeds_on_device(seed, self.nworld, self.compiled.device), mask)

    def launch_reseed(self, seeds: wp.array, mask: wp.array | None) -> None:
        """See `LayoutSource`."""
        launch_reseed(seeds, mask, self.layouts.seed, self.layouts.episode)

    @launching
    def generate(self, mask: wp.array | None = None) -> None:
        """Advance the masked worlds by one episode and write their new layouts into `layouts`.

        Launches without allocation or host synchronisation, captured into a graph at the first call. They can also be
        part of a capture of the caller's.

        Args:
            mask: Which worlds, shape (nworld,), bool; all if None.

        Raises:
            MaskError, MaskTypeError: A mask of the wrong shape, or not of booleans.
        """
        check_mask(mask, self.layouts)
        wp.copy(self._mask, self._all if mask is None else mask)
        self._generate()

    def launch_generate(self, mask: wp.array | None) -> None:
        """See `LayoutSource`."""
        self.launch_make(mask)
        launch_finish(mask, self.layouts.view, self._device)

    def launch_make(self, mask: wp.array | None) -> None:
        """Make the next layouts of the masked worlds; their episodes and what was rejected do not count yet."""
        self._start(mask)
        if self._stage is None:
            self._place()
        else:
            repeat_launches(self._search.worlds_left, self._place_and_reach, self.compiled.config.restarts + 1)

    def launch_placing(self, mask: wp.array | None) -> None:
        """Advance the masked worlds and place their objects, without the stage that may follow."""
        self._start(mask)
        self._place()
        launch_finish(mask, self.layouts.view, self._device)

    def _start(self, mask: wp.array | None) -> None:
        launch_start(self.compiled.program, mask, SPLITS[self.split], self.layouts.view, self._search, self._device)
        if self._stage is not None:
            self._stage.launch_start()

    def _place_and_reach(self) -> None:
        """Place the objects of pending worlds, and let those for which no joints are found be pending again."""
        assert self._stage is not None
        self._place()
        self._stage.launch(self.layouts.view, self._search)
        launch_reopen(self._search, self._device)

    def _place(self) -> None:
        """Let worlds try restart after restart until each has placed everything, or falls back."""
        repeat_launches(self._search.worlds_left, self._round, self.compiled.config.restarts + 1)

    def _round(self) -> None:
        """Let every pending world try its next restart, or several."""
        program, reach, view, search = self.compiled.program, self._reach, self.layouts.view, self._search
        launch_open_rows(program, reach, view, search, self._device)
        repeat_launches(search.rows_left, self._wave, self._most_waves)
        launch_settle(program, reach, SPLITS[self.split], self._stage is not None, view, search, self._device)

    def _wave(self) -> None:
        """Draw candidates of all rows, test them, and accept the first of each row that passes."""
        program, reach, view, search = self.compiled.program, self._reach, self.layouts.view, self._search
        split, size, device = SPLITS[self.split], self.size, self._device
        launch_open_candidates(program, size, search, device)
        launch_draw(program, split, size.lanes, view, search, device)
        if self._related:
            launch_build_sides(program, size.lanes, view, search, device)
            launch_find_pieces(program, size, view, search, device)
            launch_measure_pieces(program, split, size, view, search, device)
            launch_draw_points(program, split, size, view, search, device)
        launch_prefilter(program, self._reaches, size, view, search, device)
        launch_test_collisions(program, reach, size, self._visual, view, search, device)
        if self._visual:
            launch_test_containment(program, size, view, search, device)
        launch_accept(program, reach, size, view, search, device)

    @property
    def _device(self) -> str:
        return self.compiled.device

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """How many candidates were rejected for the layouts so far, by object and cause. Waits for the device."""
        return rejection_counts(self.layouts)


def _check_memory(compiled: CompiledScene, nworld: int, size: SearchSize) -> None:
    """Refuse more worlds than fit into memory, by what the largest arrays of layouts and candidates take."""
    mjm = compiled.mjm
    state = 4 * mjm.nq + 28 * mjm.nbody  # joints, and the poses of all bodies
    row = state + 36 * len(compiled.slots) + 32 * mjm.nmocap + 4 * len(compiled.placed) * len(Cause)
    what = f"LayoutGenerator: {nworld} worlds of '{compiled.config.name}'"
    needed = (nworld + size.rows) * row + size.candidates * state
    check_memory(what, needed, compiled.device, "Use fewer worlds at once, or another device.")


def rejection_counts(layouts: Layouts) -> dict[str, dict[str, int]]:
    """`Layouts.rejections` by name: object (in placement order), then cause in lower case.

    Causes of failing to reach are included if there are reach targets, and `unsound` if there was such a layout.
    """
    counts = layouts.rejections.numpy()
    unused = {Cause.NONE, *(REACH_CAUSES if layouts.compiled.reaching is None else ())}
    if not counts[:, Cause.UNSOUND].any():
        unused.add(Cause.UNSOUND)
    causes = [c for c in Cause if c not in unused]
    return {name: {c.name.lower(): int(counts[i, c]) for c in causes} for i, name in enumerate(layouts.compiled.placed)}


def check_mask(mask: wp.array | None, layouts: Layouts) -> None:
    """Refuse a mask on the device that kernels would read beyond its end, or as something else.

    Raises:
        MaskTypeError: Not of booleans.
        MaskError: Of the wrong shape, or on another device.
    """
    if mask is None:
        return
    if not isinstance(mask, wp.array) or mask.dtype is not wp.bool:
        found = mask.dtype.__name__ if isinstance(mask, wp.array) else type(mask).__name__
        raise MaskTypeError(f"mask should be a Warp array of booleans, got {found}.")
    if mask.shape != (layouts.nworld,) or mask.device != layouts.seed.device:
        raise MaskError(
            f"mask should have shape ({layouts.nworld},) and be on {layouts.seed.device}, got {tuple(mask.shape)} on "
            f"{mask.device}."
        )
