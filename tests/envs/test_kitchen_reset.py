"""KitchenReset-v0: the most furniture, and nothing to achieve."""

from __future__ import annotations

import importlib

import gymnasium
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.registration import ENVS
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated

ENV_ID = "sceniris_gym/KitchenReset-v0"
KitchenReset = importlib.import_module("sceniris_gym.envs.kitchen_reset").KitchenReset


@pytest.mark.slow
def test_it_resets_and_steps_and_rewards_nothing():
    """No reward, no success, and everything stays where it was put for a moment."""
    envs = gymnasium.make_vec(ENV_ID, num_envs=2, device="cpu")
    assert isinstance(envs, SceneVectorEnv)
    check_stated(KitchenReset, envs, [])
    envs.reset(seed=0)
    before = envs.state.poses(("mug", "bowl", "tin", "glass", "lemon")).clone()
    info = {}
    for _ in range(5):
        _, reward, terminated, _, info = envs.step(torch.zeros(2, 7))
        assert torch.equal(reward, torch.zeros(2))
        assert not (terminated | info["success"]).any()
    assert info["layout"]["fallback"].sum() == 0
    after = envs.state.poses(("mug", "bowl", "tin", "glass", "lemon"))
    torch.testing.assert_close(after[:, :, :3], before[:, :, :3], rtol=0, atol=2e-3)


def test_it_has_the_most_furniture():
    """More objects that others stand on than in the scene of any other task."""
    sizes = {}
    for env_id, (task, _) in ENVS.items():
        module, _, name = task.partition(":")
        kind = getattr(importlib.import_module(f"sceniris_gym.envs.{module}"), name)
        objects = SceneConfig.load(kind.scene).objects
        sizes[env_id] = len({str(part.on).partition("/")[0] for part in objects.values()} & set(objects))
    assert max(sizes, key=lambda env_id: sizes[env_id]) == ENV_ID
