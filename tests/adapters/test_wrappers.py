"""Wrappers of other libraries take our vector environments as they are, where these libraries are installed."""

from __future__ import annotations

import itertools
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach, reach_scene

__all__ = ["reach_scene"]


@pytest.mark.parametrize("output", ["torch", "numpy"])
def test_torchrl_steps_and_resets_in_part(reach_scene: CompiledScene, output: str):
    """TorchRL resets finished worlds itself, with a mask, when autoreset is disabled."""
    gym = pytest.importorskip("torchrl.envs.libs.gym")
    envs = SceneVectorEnv(Reach, 3, scene=reach_scene, max_episode_steps=3, autoreset_mode="Disabled", output=output)
    wrapped = gym.GymWrapper(envs, device="cpu")
    wrapped.set_seed(0)
    rollout = wrapped.rollout(7, lambda td: td.set("action", torch.zeros(3, 5)), break_when_any_done=False)
    assert rollout.batch_size == (3, 7)
    assert rollout["next", "done"].squeeze(-1).tolist() == [[False, False, True, False, False, True, False]] * 3
    assert rollout["policy"].shape == (3, 7, 19)
    assert torch.isfinite(rollout["next", "critic"]).all()


def test_skrl_steps_with_a_state_for_the_critic(reach_scene: CompiledScene):
    """Skrl's wrapper for batched simulators takes the group `policy` as observation and `critic` as state."""
    skrl = pytest.importorskip("skrl.envs.wrappers.torch")
    envs = SceneVectorEnv(Reach, 3, scene=reach_scene, max_episode_steps=3)
    wrapped = skrl.wrap_env(envs, wrapper="isaaclab", verbose=False)
    observation, _ = wrapped.reset()
    assert observation.shape == (3, 19)
    for step in range(4):
        observation, reward, terminated, truncated, _ = wrapped.step(torch.zeros(3, 5))
        assert truncated.flatten().tolist() == [step == 2] * 3
    assert (observation.shape, reward.shape, terminated.shape) == ((3, 19), (3, 1), (3, 1))
    assert wrapped.state().shape == (3, 28)


def test_skrl_takes_numpy_too(reach_scene: CompiledScene):
    """Skrl's wrapper for Gymnasium lays the groups side by side."""
    skrl = pytest.importorskip("skrl.envs.wrappers.torch")
    envs = SceneVectorEnv(Reach, 3, scene=reach_scene, max_episode_steps=3, output="numpy")
    wrapped = skrl.wrap_env(envs, wrapper="gymnasium", verbose=False)
    wrapped.reset()
    for _ in range(4):
        observation, *_ = wrapped.step(torch.zeros(3, 5))
    assert observation.shape == (3, 47)


def _from_polyline(corners: np.ndarray, joints: np.ndarray) -> float:
    """Return the distance of joints from a polyline, by 20,000 points on each piece."""
    pieces = [np.linspace(a, b, 20000) for a, b in itertools.pairwise(corners)]
    return float(np.abs(np.concatenate(pieces) - joints).max(axis=1).min())


@pytest.mark.parametrize("wrapper", ["rsl_rl", "sb3"])
def test_episodes_of_other_libraries_start_on_paths(wrapper: str):
    """Each of two episodes starts on its own path, also where the wrapper's library resets it."""
    words: dict[str, Any] = {f"objects.{name}.reachable": "path" for name in ("can", "lemon", "block")}
    words["start"] = [{"robot": "path", "of": name, "share": [0.1, 0.9]} for name in ("can", "lemon", "block")]
    envs = gymnasium.make_vec("sceniris_gym/TabletopLift-v0", num_envs=3, overrides=words, max_episode_steps=2)
    raw, seen = envs.unwrapped, []
    assert isinstance(raw, SceneVectorEnv)
    if wrapper == "rsl_rl":
        env = pytest.importorskip("sceniris_gym.adapters.rsl_rl").RslRlVecEnvWrapper(raw, seed=3)
    else:
        env = pytest.importorskip("sceniris_gym.adapters.sb3").Sb3VecEnvWrapper(raw)
        env.seed(3)
        env.reset()
    for _ in range(2):
        s = raw.state
        paths = [s.path(name)[0].numpy() for name in ("can", "lemon", "block")]
        joints = s.qpos("robot").numpy()[:, :7]
        for world in range(3):
            assert min(_from_polyline(path[world], joints[world]) for path in paths) < 1e-4
        seen.append(joints.copy())
        for _ in range(2):
            zeros = torch.zeros(raw.action_space.shape or 0)
            env.step(zeros if wrapper == "rsl_rl" else zeros.numpy())
    assert (np.abs(seen[0] - seen[1]).max(axis=1) > 0.01).all()
