"""Where the layouts of an experiment come from: made fresh, replayed from a bank, or placed without any check.

What a task draws beside the layout, such as which object it chooses, is drawn afresh in every episode whatever the
source: a bank of a single layout still asks for every object in turn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.layout.stored import StoredGenerator
from sceniris_gym.scene.device import Program
from sceniris_gym.scene.world import World


@dataclass(frozen=True)
class Rows:
    """Stored layouts as numpy arrays, one row each: `qpos`, `mocap_pos` and `mocap_quat` as in Layouts."""

    qpos: np.ndarray
    mocap_pos: np.ndarray
    mocap_quat: np.ndarray


def valid_rows(world: World, count: int, seed: int) -> Rows:
    """Make `count` valid layouts of the train split: episode 0 of the seeds from `seed` on that have one."""
    parts: list[tuple[np.ndarray, ...]] = []
    found, room = 0, max(count, 64)
    generator = LayoutGenerator(world, room, seed=seed)
    while found < count:
        generator.generate()
        valid = generator.layouts.status.numpy() == Status.VALID
        parts.append(tuple(array[valid] for array in _arrays(generator.layouts)))
        found += int(valid.sum())
        seed += room
        generator.reseed(seed)
    qpos, mocap_pos, mocap_quat = (np.concatenate(arrays)[:count] for arrays in zip(*parts, strict=True))
    return Rows(qpos, mocap_pos, mocap_quat)


def episodes(world: World, seeds: list[int], number: int, split: str = "train") -> Rows:
    """Make the first `number` episodes of every seed; row `i * number + e` is episode e of seeds[i]."""
    generator = LayoutGenerator(world, len(seeds), seed=seeds, split=split)
    parts = []
    for _ in range(number):
        generator.generate()
        parts.append(_arrays(generator.layouts))
    stacked = (np.stack(arrays, axis=1) for arrays in zip(*parts, strict=True))
    return Rows(*(array.reshape(-1, *array.shape[2:]) for array in stacked))


def home_rows(world: World, seed: int) -> Rows:
    """Return a single layout, which stands for a scene's one fixed keyframe."""
    return valid_rows(world, 1, seed)


def unchecked(world: World) -> World:
    """Return a World that draws the same candidates, and tests none for collisions.

    For placement without any check, its scene has no words `reachable`.
    """
    program = Program()
    for name in Program.vars:
        setattr(program, name, getattr(world.program, name))
    program.obj_pairnum = wp.zeros_like(world.program.obj_pairnum)
    program.obj_startnum = wp.zeros_like(world.program.obj_startnum)
    return replace(world, program=program)


def replayed(rows: Rows) -> Callable[[World, int], Any]:
    """Return a `generator` for SceneVectorEnv: world with seed s gets row s + episode, modulo their number."""
    return lambda world, num_envs: StoredGenerator(rows, num_envs, device=world.device)


def uniform(split: str = "train") -> Callable[[World, int], Any]:
    """Return a `generator` for SceneVectorEnv that places without checks."""
    return lambda world, num_envs: LayoutGenerator(unchecked(world), num_envs, split=split)


def _arrays(layouts: Any) -> tuple[np.ndarray, ...]:
    # copies: on a CPU `numpy()` is a view of what the next episode is written to
    return tuple(array.numpy().copy() for array in (layouts.qpos, layouts.mocap_pos, layouts.mocap_quat))
