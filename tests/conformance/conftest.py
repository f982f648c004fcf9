"""The small reaching task as Gymnasium knows it: by id, by spec, as worlds of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.registration import ENTRY_POINTS
from sceniris_gym.vector.single_env import SceneEnv
from tests.vector.conftest import SCENE, Reach, make_env, reach_scene

__all__ = ["make_env", "reach_scene"]

ENV_ID = "tests/SmallReach-v0"
MAX_STEPS = 5


@pytest.fixture(scope="session")
def env_id() -> Iterator[str]:
    """Register the task as registration.py does with those of the package, and return its id."""
    kwargs = {"task": f"{Reach.__module__}:{Reach.__name__}", "scene": SCENE, "device": "cpu"}
    gymnasium.register(
        id=ENV_ID,
        entry_point=ENTRY_POINTS["entry_point"],
        vector_entry_point=ENTRY_POINTS["vector_entry_point"],
        kwargs=kwargs,
        max_episode_steps=MAX_STEPS,
    )
    yield ENV_ID
    del gymnasium.registry[ENV_ID]


@pytest.fixture(scope="session")
def make_own(reach_scene: CompiledScene) -> Callable[..., SyncVectorEnv]:
    """Return a function that makes Gymnasium's own vector environment of one-world views."""

    def make(num_envs: int, autoreset_mode: AutoresetMode, **kwargs: Any) -> SyncVectorEnv:
        one = [lambda: SceneEnv(Reach, scene=reach_scene, **kwargs)] * num_envs
        return SyncVectorEnv(one, autoreset_mode=autoreset_mode)

    return make
