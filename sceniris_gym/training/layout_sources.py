"""Sources of layouts for experiments: generated fresh, replayed from a bank, or placed without any check.

A task still draws whatever else it draws, such as the object to lift, anew in every episode: even with a bank of a
single layout every object is chosen in turn.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table, read_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.training.unchecked import unchecked


def valid_rows(compiled: CompiledScene, count: int, seed: int) -> LayoutTable:
    """Make `count` valid layouts of the train split: episode 0 of the first seeds from `seed` on that have one."""
    parts: list[LayoutTable] = []
    found, room = 0, max(count, 64)
    while found < count:
        table = make_table(compiled, room, seed)
        parts.append(table[table.valid])
        found += len(parts[-1])
        seed += room
    return LayoutTable.concatenate(parts)[:count]


def episodes(compiled: CompiledScene, seeds: list[int], number: int, split: str = "train") -> LayoutTable:
    """Make the first `number` episodes of every seed; row `i * number + e` is episode e of seeds[i]."""
    generator = LayoutGenerator(compiled, len(seeds), seed=seeds, split=split)
    parts = []
    for _ in range(number):
        generator.generate()
        parts.append(read_table(generator))
    by_seed = np.arange(len(seeds) * number).reshape(number, len(seeds)).T.ravel()
    return LayoutTable.concatenate(parts)[by_seed]


def replayed(table: LayoutTable) -> Callable[[CompiledScene, int], StoredLayouts]:
    """Return a `layout_source` for SceneVectorEnv: a world with seed s gets row s + episode, modulo the row count."""
    return lambda compiled, num_envs: StoredLayouts(compiled, table, num_envs)


def bank(table: LayoutTable) -> Callable[[CompiledScene, int], StoredLayouts]:
    """Return a `layout_source` for SceneVectorEnv that serves all rows of a table, even if there are fewer worlds.

    Of n worlds one with seed s gets row s + (n - 1) * episode, modulo the row count: if the worlds have consecutive
    seeds, each episode goes on where the one before ended.
    """
    return lambda compiled, num_envs: StoredLayouts(compiled, table, num_envs, stride=max(1, num_envs - 1))


def uniform(split: str = "train") -> Callable[[CompiledScene, int], LayoutGenerator]:
    """Return a `layout_source` for SceneVectorEnv that places without checks."""
    return lambda compiled, num_envs: LayoutGenerator(unchecked(compiled), num_envs, split=split)
