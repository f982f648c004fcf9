"""The layouts on the page, made from a seed and an episode, and their rejected candidates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

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


@dataclass(frozen=True)
class Where:
    """Split, seed and episode of the layouts on the page. World i has seed + i.

    Attributes:
        split: "train" or "eval".
        seed: Seed of the first world, 64 bits.
        episode: Episode of all worlds.
    """

    split: str = "train"
    seed: int = 0
    episode: int = 0

    def moved(self, seeds: int = 0, episodes: int = 0) -> Where:
        """Add numbers to the seed and the episode. A result out of range becomes the nearest valid number."""
        seed = min(max(self.seed + seeds, 0), 2**64 - 1)
        return replace(self, seed=seed, episode=min(max(self.episode + episodes, 0), 2**31 - 1))


@dataclass(frozen=True)
class Candidate:
    """A rejected candidate for the pose of an object.

    Attributes:
        name: The object.
        number: Index of the object in placement order. The objects before it already had a place.
        cause: Why the candidate was rejected, in lower case.
        count: Number of candidates of this object in this layout with the same cause.
        state: The state of the world with the object at the rejected place, one row.
    """

    name: str
    number: int
    cause: str
    count: int
    state: LayoutTable


class LayoutDeck:
    """Makes layouts of a compiled scene: for many worlds, or for one world with its rejected candidates.

    Args:
        compiled: The scene. If it can have no layouts, it was only uploaded to the device, and has no bank.
        num: Number of worlds.
    """

    def __init__(self, compiled: CompiledScene, num: int) -> None:
        self.compiled, self.num = compiled, num
        self._generators: dict[tuple[str, bool], LayoutGenerator] = {}
        self.layouts = self.valid = 0
        self.counts = np.zeros((max(len(compiled.placed), 1), len(Cause)), np.int64)

    def make(self, where: Where) -> LayoutTable:
        """Return the layouts of all worlds, and count their rejected candidates."""
        generator = self._generator(where.split)
        table = _made(generator, where)
        self._count(generator, table)
        return table

    def stands(self, split: str) -> tuple[np.ndarray, np.ndarray]:
        """Return `ShownWorld.stands` for the layout of the latest `make` in the first world."""
        view = self._generator(split).layouts.view
        return view.pivot_pose.numpy()[0].copy(), view.bounds.numpy()[0].copy()

    def count_ahead(self) -> None:
        """Make layouts that only fill the table of rejections. Their seeds are far from the seeds that users choose."""
        generator = LayoutGenerator(self.compiled, _COUNTED, seed=1 << 62)
        generator.generate()
        self._count(generator, generator.table())

    def rejected(self, where: Where) -> list[Candidate]:
        """Return the rejected candidates of the first world's layout, in the order of the trials.

        An object whose region is empty has no candidates.
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
        """The search for the geoms that candidates hit."""
        return Blame(self.compiled)

    def find(self, text: str) -> Where:
        """Return the split, the seed and the episode of a layout by its id.

        Raises:
            ArgumentError: The text does not have the form of an id.
            SceneMismatchError: The layout belongs to another scene.
            NotSupportedError: The id has params that differ from the scene file.
        """
        name = LayoutId.of_scene(text.strip(), self.compiled.scene, "Open the scene of this layout.")
        if name.params:
            raise NotSupportedError("view: shows only layouts without params. Use `sceniris-gym replay` for others.")
        return Where(name.split, name.seed, name.episode)

    def table(self) -> Mapping[str, Mapping[str, int]]:
        """Return the number of rejected candidates so far by object and cause, without empty rows and columns."""
        seen = {c for c in Cause if self.counts[:, c].any()}
        rows = ((name, self.counts[i]) for i, name in enumerate(self.compiled.placed))
        return {name: {c.name.lower(): int(row[c]) for c in sorted(seen)} for name, row in rows if row.any()}

    def _generator(self, split: str, record: bool = False) -> LayoutGenerator:
        """Return the generator of all worlds, or with `record` the recording generator of the first world."""
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
