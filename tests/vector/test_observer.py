"""Observations: their groups, and the tensors that they are returned in."""

from __future__ import annotations

import pytest
import torch

from sceniris_gym.errors import ArgumentError, UnknownNameError
from tests.vector.stepping import actions, assert_equal


def test_without_copy_the_observation_buffers_are_used_again(make_env):
    """copy=False is opt-in: the same memory every time, apart from final_obs, with the same values as with copies."""
    envs, twin = make_env(2, copy=False), make_env(2)
    envs.reset(seed=0)
    twin.reset(seed=0)
    first, *_ = envs.step(actions(2))
    twin.step(actions(2))
    second, _, _, _, info = envs.step(actions(2))
    assert first["policy"].data_ptr() == second["policy"].data_ptr() != info["final_obs"]["policy"].data_ptr()
    assert_equal(second, twin.step(actions(2))[0])


def test_only_the_groups_that_are_asked_for_are_observed(make_env):
    """In their order, in spaces, steps and final observations; unknown ones are named."""
    envs = make_env(3, observation_groups=("policy",), max_episode_steps=1)
    whole = make_env(3, max_episode_steps=1)
    assert list(envs.single_observation_space) == list(envs.observation_names) == ["policy"]
    first, _ = envs.reset(seed=0)
    assert list(first) == ["policy"]
    assert torch.equal(first["policy"], whole.reset(seed=0)[0]["policy"])
    after, *_, info = envs.step(torch.zeros(3, 5))
    assert list(after) == list(info["final_obs"]) == ["policy"]
    assert list(make_env(3, observation_groups=["critic", "policy"]).reset(seed=0)[0]) == ["critic", "policy"]
    assert list(make_env(3, observation_groups="policy").reset(seed=0)[0]) == ["policy"]
    with pytest.raises(ArgumentError, match="observation_groups"):
        make_env(3, observation_groups=())
    with pytest.raises(UnknownNameError, match=r"unknown observation group 'polcy'. Did you mean 'policy'"):
        make_env(3, observation_groups=("polcy",))
