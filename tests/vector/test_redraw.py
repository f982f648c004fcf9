"""New places for some objects of environments: the episode goes on, and what was redrawn can be redrawn again."""

from __future__ import annotations

import gymnasium
import pytest
import torch

from sceniris_gym.errors import ArgumentError, ArgumentTypeError
from tests.vector.stepping import actions, assert_equal, state

SOME = torch.tensor([False, True, False, True])


def test_an_episode_goes_on_with_its_objects_elsewhere(make_env):
    """Seeds, episodes and the memory of the task stay; `info` counts the redraws of each world."""
    envs = make_env(4)
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.redraw("block")
    for wrong in (3, [["block"]]):
        with pytest.raises(ArgumentTypeError, match="redraw: objects should be one name or several names"):
            envs.randomizer.redraw(wrong)
    _, info = envs.reset(seed=2)
    for mask, error in ((torch.ones(4), ArgumentTypeError), (torch.ones(3, dtype=torch.bool), ArgumentError)):
        with pytest.raises(error, match="worlds should"):
            envs.redraw("block", mask)
    assert "redraws" not in info["layout"]
    envs.step(actions(4))
    before, block = state(envs), envs.state.pose("block").clone()
    last = envs.task.last.clone()
    envs.redraw(["block"], SOME)
    assert_equal(state(envs), before, [0, 2])
    torch.testing.assert_close(envs.task.last, last, rtol=0.0, atol=0.0)
    moved = (envs.state.pose("block") != block).any(dim=1)
    assert moved.tolist() == SOME.tolist()
    *_, info = envs.step(actions(4, ending=(3,)))
    assert info["layout"]["redraws"].tolist() == [0, 1, 0, 0]
    assert info["final_info"]["layout"]["redraws"].tolist() == [0, 1, 0, 1]
    assert info["layout"]["episode"].tolist() == [0, 0, 0, 1]
    assert not info["layout"]["redraw_failed"].any()


def test_a_snapshot_has_the_number_of_redraws(make_env):
    """So that the next redraw is the same after it was restored."""
    envs = make_env(4)
    envs.reset(seed=2)
    envs.redraw("block")
    kept, found = envs.snapshot(), []
    for mask in (SOME, SOME.numpy()):
        envs.redraw("block", mask)
        found.append(envs.state.pose("block").clone())
        envs.reset(options={"state": kept})
    torch.testing.assert_close(found[0], found[1], rtol=0.0, atol=0.0)
