"""Results of a step: rewards, broken worlds, and results that are kept."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.stepping import actions, leaves


def test_without_copy_all_but_observations_is_kept(make_env):
    """The final info is of the episode that ended, and neither it nor the new one changes in later steps."""
    envs = make_env(2, copy=False, max_episode_steps=2)
    envs.task.success = lambda s: flags  # a task may return a tensor that it writes to
    flags = torch.ones(2, dtype=torch.bool)
    envs.reset(seed=5)
    envs.step(actions(2))
    *outcome, info = envs.step(actions(2))
    flags.fill_(False)
    final = info["final_info"]
    kept = [outcome[1:], {name: value for name, value in info.items() if name != "final_obs"}]
    copies = [leaf.clone() for leaf in leaves(kept)]
    for _ in range(3):
        envs.step(actions(2))
    assert final["layout_episode"].tolist() == [0, 0]
    assert info["layout_episode"].tolist() == [1, 1]
    assert final["success"].tolist() == info["success"].tolist() == [True, True]
    for leaf, copy in zip(leaves(kept), copies, strict=True):
        assert torch.equal(leaf, copy)


def test_a_world_with_nans_is_ended_and_cured(make_env):
    """A broken world is terminated with reward 0 and starts anew; its neighbour goes on."""
    envs = make_env(2)
    envs.reset(seed=0)
    qvel = envs.batch.data.qvel.numpy()
    qvel[0] = np.nan
    envs.batch.data.qvel.assign(qvel)
    observation, reward, terminated, _, info = envs.step(actions(2))
    assert terminated.tolist() == info["_final_obs"].tolist() == info["broken"].tolist() == [True, False]
    assert info["final_info"]["broken"].tolist() == [True, False]
    assert info["final_info"]["layout_seed"].tolist() == [0, 1]
    assert envs.statistics.read()["broken"] == 1
    assert float(reward[0]) == 0.0
    assert torch.isfinite(observation["critic"]).all()
    twin = make_env(2)
    twin.reset(seed=0)
    twin.reset()
    np.testing.assert_array_equal(envs.step(actions(2))[0]["critic"][0], twin.step(actions(2))[0]["critic"][0])


def _poison_ctrl(envs: SceneVectorEnv, value: Tensor) -> None:
    envs.task.apply = lambda s, action: s.ctrl[:, 2].copy_(value)  # which its range keeps from the positions


def _poison_act(envs: SceneVectorEnv, value: Tensor) -> None:
    act = wp.to_torch(envs.batch.data.act)
    envs.task.apply = lambda s, action: act[:, 0].copy_(value)


def _poison_reward(envs: SceneVectorEnv, value: Tensor) -> None:
    envs.task.reward = lambda s, action: {"near": value.clone(), "one": torch.ones(2)}


def _poison_observation(envs: SceneVectorEnv, value: Tensor) -> None:
    envs.task.observe = lambda s: {"policy": {"x": value[:, None] * s.elapsed[:, None].clamp(max=1)}}


POISONS = (_poison_ctrl, _poison_act, _poison_reward, _poison_observation)


@pytest.mark.parametrize("mode", ["SameStep", "NextStep", "Disabled"])
@pytest.mark.parametrize("poison", POISONS)
def test_a_world_is_broken_in_the_step_that_has_the_nan(make_env, poison, mode: str):
    """By controls, activations, rewards or observations: terminated with reward 0, once, and finite after its reset."""
    envs, value = make_env(2, autoreset_mode=mode, observation_groups="policy"), torch.zeros(2)
    poison(envs, value)
    envs.reset(seed=0)
    assert not envs.step(actions(2))[-1]["broken"].any()
    value[1] = np.nan if mode != "NextStep" else np.inf
    _, reward, terminated, _, info = envs.step(actions(2))
    assert info["broken"].tolist() == terminated.tolist() == [False, True]
    assert float(reward[1]) == 0.0
    assert info["reward_terms"]["near"].isfinite().all()
    assert envs.statistics.read()["broken"] == 1
    value.zero_()
    if mode == "Disabled":
        envs.reset(options={"reset_mask": terminated})
    observation, _, terminated, _, info = envs.step(actions(2))
    assert not (info["broken"] | terminated).any()
    assert observation["policy"].isfinite().all()
    assert envs.state.finite.all()


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16, torch.int64])
def test_rewards_are_of_single_precision_whatever_a_task_returns(make_env, dtype):
    """Their terms too."""
    envs = make_env(2)
    envs.task.reward = lambda s, action: {"three": torch.full((2,), 3, dtype=dtype)}
    envs.reset(seed=0)
    _, reward, _, _, info = envs.step(actions(2))
    assert reward.dtype == info["reward_terms"]["three"].dtype == torch.float32
    assert reward.tolist() == [3.0, 3.0]
