"""Makes the layouts that the viewer shows, from a seed and an episode, and lists their rejected candidates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import warp as wp

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.layout.blame import Blame
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.seeds import as_seeds
from sceniris_gym.layout.tables import read_rejected
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause
from sceniris_gym.scene.layout_table import LayoutTable

MOST_RECORDED = 1024
_COUNTED = 256  # number of layouts that fill a scene's first table of rejections


class Where(NamedTuple):
    """The user's choice of layouts: split, seed and episode. World i has seed + i.

    Attributes:
        split: "train" or "eval".
        seed: Seed of the first world, from 0 to 2^64 - 1.
        episode: Episode of all worlds.
    """

    split: str = "train"
    seed: int = 0
    episode: int = 0

    def moved(self, seeds: int = 0, episodes: int = 0) -> Where:
        """Return a choice with `seeds` added to the seed and `episodes` to the episode, clipped to valid numbers."""
        seed = min(max(self.seed + seeds, 0), 2**64 - 1)
        return self._replace(seed=seed, episode=min(max(self.episode + episodes, 0), 2**31 - 1))


@dataclass(frozen=True)
class Candidate:
    """A candidate pose of an object that was rejected while a layout was made.

    Attributes:
        name: The object.
        number: Index of the object in placement order. Objects with a smaller index already had a place.
        cause: Why the candidate was rejected: a key of `why.CAUSES`, such as "collision".
        count: Number of candidates of this object in this layout that were rejected for the same cause.
        state: The state of the world with the object in the rejected pose, one row.
    """

    name: str
    number: int
    cause: str
    count: int
    state: LayoutTable


class LayoutDeck:
    """Makes layouts of a compiled scene: for all worlds, or for the first world with its rejected candidates.

    Args:
        compiled: The scene. If no valid layout was found for it, it has no bank of layouts.
        num: Number of worlds.
    """

    def __init__(self, compiled: CompiledScene, num: int) -> None:
        self.compiled, self.num = compiled, num
        self._generators: dict[tuple[str, bool], LayoutGenerator] = {}
        self.layouts = self.valid = 0
        self.counts = np.zeros((max(len(compiled.placed), 1), len(Cause)), np.int64)

    def make(self, where: Where) -> LayoutTable:
        """Return the layouts of all worlds, and add their rejected candidates to the counts in `table`."""
        generator = self._generator(where.split)
        table = _made(generator, where)
        self._count(generator, table)
        return table

    def stands(self, split: str) -> tuple[np.ndarray, np.ndarray]:
        """Return `ShownWorld.stands` for the first world: pivots and bounds of its objects in its latest layout."""
        view = self._generator(split).layouts.view
        return view.pivot_pose.numpy()[0].copy(), view.bounds.numpy()[0].copy()

    def count_ahead(self) -> None:
        """Make 256 layouts only to count rejected candidates, with seeds that users are unlikely to choose."""
        generator = LayoutGenerator(self.compiled, _COUNTED, seed=1 << 62)
        generator.generate()
        self._count(generator, generator.table())

    def rejected(self, where: Where) -> list[Candidate]:
        """Return the rejected candidates of the first world's layout, in the order in which they were tried.

        If the region of an object is empty, there are no candidates of this object.
        """
        recorder = self._generator(where.split, record=True)
        view = recorder.layouts.view
        view.rejected_count.zero_()
        before = view.rejections.numpy().copy()
        made = _made(recorder, where)
        counts = view.rejections.numpy() - before
        rejected, found = read_rejected(recorder), []
        for i, (number, cause) in enumerate(zip(rejected.objects.tolist(), rejected.causes.tolist(), strict=True)):
            state = replace(rejected.states[i : i + 1], present=made.present)
            name = self.compiled.placed[number]
            found.append(Candidate(name, number, Cause(cause).name.lower(), int(counts[number, cause]), state))
        return found

    @cached_property
    def blame(self) -> Blame:
        """Finds the geoms with which a rejected candidate collides."""
        return Blame(self.compiled)

    def find(self, text: str) -> Where:
        """Return the split, the seed and the episode of the layout with the id `text`.

        Raises:
            ArgumentError: The text does not have the form of a layout id.
            SceneMismatchError: The layout belongs to another scene.
            NotSupportedError: The id has values of params that differ from the scene file.
        """
        name = LayoutId.of_scene(text.strip(), self.compiled.scene, "Open the scene of this layout.")
        if name.params:
            raise NotSupportedError("view: shows only layouts without params. Use `sceniris-gym replay` for others.")
        return Where(name.split, name.seed, name.episode)

    def table(self) -> Mapping[str, Mapping[str, int]]:
        """Return the rejection counts of all layouts so far: object -> cause -> number of candidates.

        Objects without rejections and causes that never occurred are left out.
        """
        seen = {c for c in Cause if self.counts[:, c].any()}
        rows = ((name, self.counts[i]) for i, name in enumerate(self.compiled.placed))
        return {name: {c.name.lower(): int(row[c]) for c in sorted(seen)} for name, row in rows if row.any()}

    def _generator(self, split: str, record: bool = False) -> LayoutGenerator:
        """Return the generator for all worlds. With `record`, it is for the first world, and records rejections."""
        if (split, record) not in self._generators:
            recorder = partial(LayoutGenerator._recording, rejected=MOST_RECORDED, every_cause=True)
            make = recorder if record else LayoutGenerator
            self._generators[split, record] = make(self.compiled, 1 if record else self.num, split=split)
        return self._generators[split, record]

    def _count(self, generator: LayoutGenerator, table: LayoutTable) -> None:
        self.layouts += len(table)
        self.valid += int((table.status == LayoutStatus.VALID).sum())
        rejections = generator.layouts.view.rejections
        self.counts += rejections.numpy()
        rejections.zero_()


def _made(generator: LayoutGenerator, where: Where) -> LayoutTable:
    generator.reseed(layouts={"seed": as_seeds(where.seed, generator.nworld), "episode": where.episode})
    generator.generate()
    wp.synchronize_device(generator.compiled.device)
    return generator.table()
