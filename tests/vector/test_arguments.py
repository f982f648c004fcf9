"""Actions as users hand them over."""

from __future__ import annotations

import numpy as np
import torch
from gymnasium.spaces import Box

from sceniris_gym.vector.arguments import as_action

SPACE = Box(-1.0, 1.0, (2, 3), np.float32)


def test_an_action_that_is_not_a_number_is_none():
    """It is taken as 0, so that it cannot stay in the controls; infinite ones are cut off like all others."""
    action = as_action([[np.nan, 0.5, np.inf], [-np.inf, 2.0, -0.25]], SPACE, torch.device("cpu"))
    assert action.tolist() == [[0.0, 0.5, 1.0], [-1.0, 1.0, -0.25]]


def test_actions_of_a_policy_leave_their_gradients_outside(make_env):
    """Nothing that a step returns or keeps has a history, and the policy's gradient is not touched."""
    envs = make_env(2)
    observation, _ = envs.reset(seed=0)
    policy = torch.nn.Linear(19, 5)
    for _ in range(2):
        observation, reward, *_, info = envs.step(policy(observation["policy"]))
    kept = [envs.state.ctrl, envs.statistics.sums(), *info["reward_terms"].values()]
    assert not any(tensor.requires_grad for tensor in [*observation.values(), reward, *kept])
    assert policy.weight.grad is None
