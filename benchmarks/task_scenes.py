"""The scenes and environments of the package's tasks, as every experiment makes them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import gymnasium

from sceniris_gym.scene.config import SceneConfig
from sceniris_gym.scene.world import World
from sceniris_gym.vector.vector_env import SceneVectorEnv

SEED_SPACING = 1 << 20
"""The least there is between seeds of experiments: worlds of neighbouring ones would share layouts otherwise."""


def scene_of(task: str, *, reachable: bool) -> SceneConfig:
    """Return the scene of a task, with or without its words `reachable`."""
    entry = gymnasium.spec(f"sceniris_gym/{task}").kwargs["task"]
    module, _, name = entry.partition(":")
    scene = SceneConfig.load(getattr(import_module(module), name).scene)
    if reachable:
        return scene
    data = scene.model_dump(by_alias=True, exclude_unset=True)
    for part in data["objects"].values():
        part.pop("reachable", None)
    return SceneConfig.load(data)


def make_env(task: str, num_envs: int, world: World, **kwargs: Any) -> SceneVectorEnv:
    """Return the environment of a task on a World."""
    envs = gymnasium.make_vec(f"sceniris_gym/{task}", num_envs=num_envs, scene=world, **kwargs)
    assert isinstance(envs, SceneVectorEnv)
    return envs
