"""Worlds of a task: their episodes, and the sources of their layouts."""

from __future__ import annotations

import torch

from tests.vector.stepping import actions


def test_truncation_counts_the_steps_of_each_world(make_env):
    """A world that ended early is truncated later than the others."""
    envs = make_env(2, max_episode_steps=3)
    envs.reset(seed=0)
    envs.step(actions(2, ending=(0,)))
    flags = [envs.step(actions(2))[3].tolist() for _ in range(3)]
    assert flags == [[False, False], [False, True], [True, False]]


def test_layouts_made_ahead_change_nothing(make_env):
    """Observations through ends of episodes, and after a reset of some worlds with new seeds."""
    seen = []
    for prefetch in (False, True):
        envs = make_env(3, max_episode_steps=2, prefetch=prefetch)
        assert (envs.randomizer.pipeline.ahead is not None) == prefetch
        found = [envs.reset(seed=3)[0]]
        for step in range(5):
            found.append(envs.step(torch.full((3, 5), 0.1))[0])
            if step == 2:
                mask = torch.tensor([True, False, True])
                found.append(envs.reset(seed=[9, 0, 4], options={"reset_mask": mask})[0])
        seen.append(found)
    for plain, ahead in zip(*seen, strict=True):
        assert all(torch.equal(plain[group], ahead[group]) for group in plain)
