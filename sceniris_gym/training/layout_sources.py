"""Layout sources that replace fresh layouts in training: replay of stored layouts, or placement without checks.

In every episode, a task makes its random choices again, such as the object to lift. Even with a bank of a single
layout, all objects are therefore chosen over time.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import warp as wp

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program, copied
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.batch import default_budget, with_options
from sceniris_gym.training.task_scenes import spec_of
from sceniris_gym.vector.arguments import as_task


def valid_rows(compiled: CompiledScene, count: int, seed: int) -> LayoutTable:
    """Make `count` valid layouts of the train split: episode 0 of the seeds from `seed` on, skipping invalid ones."""
    parts: list[LayoutTable] = []
    room = max(count, 64)
    while sum(map(len, parts)) < count:
        table = make_table(compiled, room, seed)
        parts.append(table[table.valid])
        seed += room
    return LayoutTable.concatenate(parts)[:count]


def words_of(source: Callable[[CompiledScene, int], Any]) -> dict[str, Any]:
    """Return arguments of SceneVectorEnv for a `layout_source`. A source excludes registered params and curricula."""
    return {"layout_source": source, "params": (), "curriculum": None}


def bank(table: LayoutTable) -> Callable[[CompiledScene, int], StoredLayouts]:
    """Return a `layout_source` for SceneVectorEnv that serves all rows of a table, even if there are fewer worlds.

    With n > 1 worlds, the world of seed s gets row s + (n - 1) * episode, modulo the row count. If the worlds have
    consecutive seeds, the first world therefore gets the row that the last world had in the previous episode.
    """
    return lambda compiled, num_envs: StoredLayouts(compiled, table, num_envs, stride=max(1, num_envs - 1))


def uniform(split: str = "train") -> Callable[[CompiledScene, int], LayoutGenerator]:
    """Return a `layout_source` for SceneVectorEnv that places objects without checks for collisions."""
    return lambda compiled, num_envs: LayoutGenerator(unchecked(compiled), num_envs, split=split)


def words_of_uniform(task: str, scene: SceneModel, split: str = "train") -> dict[str, Any]:
    """Return arguments of SceneVectorEnv for a task with the `layout_source` `uniform`.

    Objects overlap in these layouts, so a world has room for twice the constraint rows of the task, or of the default
    for its scene. Of 1,024 such layouts of TabletopLift-v0, some need more than its 192 rows, and valid ones at most
    105.
    """
    own = as_task(spec_of(task).kwargs["task"])
    rows = own.sim_config.njmax or default_budget(with_options(scene.sim.mjm, own.options), scene)[1]
    return words_of(uniform(split)) | {"sim_config": {"njmax": 2 * rows}}


def unchecked(compiled: CompiledScene) -> CompiledScene:
    """Return a CompiledScene that draws the same candidates, without tests for collisions.

    The reach of objects is still tested. To place without any test, pass a scene whose objects are not `reachable`.
    """
    program = copied(Program, compiled.program)
    program.obj_pairnum = wp.zeros_like(compiled.program.obj_pairnum)
    program.obj_broadnum = wp.zeros_like(compiled.program.obj_broadnum)
    return replace(compiled, program=program)
