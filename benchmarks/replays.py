"""Layouts that are made before a measurement, and replayed in it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable


def episodes(compiled: CompiledScene, seeds: list[int], number: int) -> LayoutTable:
    """Make the first `number` episodes of every seed; row `i * number + e` is episode e of seeds[i]."""
    generator = LayoutGenerator(compiled, len(seeds), seed=seeds)
    parts = []
    for _ in range(number):
        generator.generate()
        parts.append(generator.table())
    by_seed = np.arange(len(seeds) * number).reshape(number, len(seeds)).T.ravel()
    return LayoutTable.concatenate(parts)[by_seed]


def replayed(table: LayoutTable) -> Callable[[CompiledScene, int], StoredLayouts]:
    """Return a `layout_source` for SceneVectorEnv: a world with seed s gets row s + episode, modulo the row count."""
    return lambda compiled, num_envs: StoredLayouts(compiled, table, num_envs)
