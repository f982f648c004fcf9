"""TabletopReachEasy-v0: what the policy is told there, and that nothing else differs from TabletopReach-v0."""

from __future__ import annotations

import importlib

import gymnasium
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated, values

TabletopReachEasy = importlib.import_module("sceniris_gym.envs.tabletop_reach_easy").TabletopReachEasy


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("tabletop_reach", {"bank": 8}), "cpu")


def test_the_docstring_lists_what_is_observed(compiled):
    """Names, shapes and sizes."""
    envs = gymnasium.make_vec("sceniris_gym/TabletopReachEasy-v0", num_envs=1, scene=compiled)
    assert isinstance(envs, SceneVectorEnv)
    assert envs.max_episode_steps == 100
    check_stated(TabletopReachEasy, envs, [("object_velocities", (5, 3))])


def test_the_policy_is_told_what_only_the_critic_of_the_other_task_knows(compiled):
    """The hints of the one are numbers that the other one's critic has, in the same layouts."""
    envs = [
        gymnasium.make_vec(f"sceniris_gym/TabletopReach{easy}-v0", num_envs=4, scene=compiled) for easy in ("", "Easy")
    ]
    seen = [each.reset(seed=7)[0] for each in envs]
    for name in ("tcp_to_target",):
        assert name not in dict(envs[0].unwrapped.observation_names["policy"])  # pyrefly: ignore[missing-attribute]
        hint = values(envs[0], seen[0], name, "critic")  # pyrefly: ignore[bad-argument-type]
        assert torch.equal(values(envs[1], seen[1], name), hint)  # pyrefly: ignore[bad-argument-type]
