"""Worlds of a scene with their ids, and the ways by which an id makes a layout again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
import warp as wp

from sceniris_gym.commands.replay import drawn, replay
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layout_id import ChosenLayouts, LayoutId
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.params import params_in
from sceniris_gym.layout.scene_params import Param, scene_params
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.task import Task
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.stress.mixed import STATUS

WORLDS = 32
Rows = dict[str, np.ndarray]
_LAYOUTS = ("qpos", "mocap_pos", "mocap_quat", "present", "status", "start", "grasp", "grasp_qpos", "pregrasp_qpos")
_DATA = ("qpos", "mocap_pos", "mocap_quat", "ctrl", "act")


class Served:
    """Worlds of a scene in their second episode, with their ids and all that these name.

    Args:
        compiled: The scene.
        seed: Seed of the first world.
        params: Give the worlds all params, and half of them numbers of their own.
    """

    def __init__(self, compiled: CompiledScene, seed: int, *, params: bool) -> None:
        self.compiled, self.names = compiled, param_names(compiled) if params else ()
        self.randomizer = randomizer(compiled, WORLDS, self.names)
        rows = narrowed(self.randomizer, np.random.default_rng(seed)) if self.names else None
        chosen = ChosenLayouts(np.arange(seed, seed + WORLDS, dtype=np.uint64), np.ones(WORLDS, bool), param=rows)
        self.randomizer.pipeline.reseed(layouts=chosen)
        self.randomizer.reset()
        self.randomizer.reset()
        self.ids = self.randomizer.pipeline.ids(self.randomizer.split)
        self.rows = rows_of(self.randomizer)
        self.status = [STATUS.get(int(status), "none") for status in self.rows["layout status"]]


def param_names(compiled: CompiledScene) -> tuple[str, ...]:
    """Return the names of all params that a scene can have."""
    return tuple(name for name, param in scene_params(compiled).items() if isinstance(param, Param))


def randomizer(compiled: CompiledScene, nworld: int, params: Sequence[str]) -> ResetRandomizer:
    """Return worlds that were not reset yet."""
    batch = Batch(compiled.scene, nworld, compiled.device, graph=False)
    return ResetRandomizer.of_batch(batch, compiled, params=params, graph=False)


def narrowed(worlds: ResetRandomizer, rng: np.random.Generator) -> np.ndarray:
    """Return numbers of all params, in every other world within those of the scene file, shape (nworld, nvalue)."""
    table = worlds.layouts.params
    rows = np.tile(table.default, (WORLDS, 1))
    for name, param in table.params.items():
        if not param.half:
            continue
        low, high = param.default[: param.half], param.default[param.half :]
        ends = np.sort(rng.uniform(size=(WORLDS, 2, param.half)), axis=1) ** [[0.7], [0.3]]  # most of them wide
        found = np.clip(low + ends * (high - low), low, high).astype(np.float32)
        found = np.rint(found) if param.form == "count" else found
        rows[1::2, table.first[name] : table.first[name] + 2 * param.half] = found.reshape(WORLDS, -1)[1::2]
    return rows


def layout_rows(layouts: Layouts) -> Rows:
    """Return the rows of layouts by name."""
    return {f"layout {name}": getattr(layouts, name).cpu().numpy().copy() for name in _LAYOUTS}


def rows_of(worlds: ResetRandomizer) -> Rows:
    """Return all that an id names: layouts, states, and model fields with a row for each world."""
    wp.synchronize_device(worlds.device)  # an environment launches on torch's stream
    state = {name: getattr(worlds.data, name).numpy().copy() for name in _DATA}
    fields = {f"field {name}": array.numpy().copy() for name, array in worlds.fields.rows.items()}
    varied = {"variant": worlds.variants.cpu().numpy().copy()}
    return {**layout_rows(worlds.layouts), **state, **fields, **varied}


def by_replay(served: Served, order: np.ndarray) -> Rows:
    """Return the layouts that the command replay makes, with the drawn numbers that it says."""
    tables = [replay(served.compiled, LayoutId.parse(served.ids[world])) for world in order]
    found = {f"layout {name}": np.concatenate([getattr(t, name) for t in tables]) for name in _LAYOUTS[:7]}
    numbers = [drawn(served.compiled, table)[1] for table in tables]
    return found | {f"field drawn.{key}": np.array([each[key] for each in numbers]) for key in numbers[0]}


def by_randomizer(served: Served, order: np.ndarray) -> Rows:
    """Return the worlds of another randomizer with the seeds, episodes and params of the ids."""
    names = [LayoutId.parse(served.ids[world]) for world in order]
    worlds = randomizer(served.compiled, len(order), served.names)
    table = worlds.layouts.params
    params = table.named(np.concatenate([table.rows(params_in(name.params), 1) for name in names]))
    chosen = {"seed": [name.seed for name in names], "episode": [name.episode for name in names], "params": params}
    worlds.reset(layouts=chosen)
    return rows_of(worlds)


class _Idle(Task):
    """A task without a goal."""

    action_size = 1

    def observe(self, s: Any) -> dict[str, dict[str, Any]]:
        return {"policy": {"nothing": torch.zeros(s.num_envs, 1, device=s.device)}}

    def reward(self, s: Any, action: Any) -> dict[str, Any]:
        return {"nothing": torch.zeros(s.num_envs, device=s.device)}

    def success(self, s: Any) -> Any:
        return torch.zeros(s.num_envs, dtype=torch.bool, device=s.device)


def by_options(served: Served, order: np.ndarray) -> Rows:
    """Return the worlds of an environment that was reset to the ids."""
    words: dict[str, Any] = {"params": served.names, "graph": False, "nconmax": 256, "njmax": 1024}
    envs = SceneVectorEnv(_Idle, len(order), scene=served.compiled, **words)
    try:
        envs.reset(options={"layouts": [served.ids[world] for world in order]})
        return rows_of(envs.randomizer)
    finally:
        envs.close()


def by_generator(served: Served, order: np.ndarray) -> Rows:
    """Return the layouts of a generator, chosen as an adapter chooses them."""
    generator = LayoutGenerator(served.compiled, len(order), params=served.names)
    ids = [served.ids[world] for world in order]
    generator.reseed(layouts=ids)
    generator.generate()
    return layout_rows(generator.layouts)


BACK: Mapping[str, Callable[[Served, np.ndarray], Rows]] = {
    "replay": by_replay,
    "randomizer": by_randomizer,
    "options": by_options,
    "generator": by_generator,
}
