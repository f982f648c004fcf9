"""Scenes and environments of the package's tasks, shared by all experiments."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import gymnasium

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.vector_env import SceneVectorEnv

SEED_SPACING = 1 << 20
"""Least spacing between the seeds of experiments, so that their worlds do not share layouts."""


def scene_of(task: str, *, reachable: bool) -> SceneConfig:
    """Return the scene of a task, with or without `reachable`."""
    entry = gymnasium.spec(f"sceniris_gym/{task}").kwargs["task"]
    module, _, name = entry.partition(":")
    scene = SceneConfig.load(getattr(import_module(module), name).scene)
    if reachable:
        return scene
    data = scene.model_dump(by_alias=True, exclude_unset=True)
    for part in data["objects"].values():
        part.pop("reachable", None)
    return SceneConfig.load(data)


def make_env(task: str, num_envs: int, compiled: CompiledScene, **kwargs: Any) -> SceneVectorEnv:
    """Return the environment of a task on a CompiledScene."""
    envs = gymnasium.make_vec(f"sceniris_gym/{task}", num_envs=num_envs, scene=compiled, **kwargs)
    assert isinstance(envs, SceneVectorEnv)
    return envs
