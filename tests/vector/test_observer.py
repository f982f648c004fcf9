"""Observations: their groups, names and spaces, and the tensors that they are returned in."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.vector.observer import action_space, flatten, names_of, observation_space
from tests.vector.stepping import actions, assert_equal


def test_without_copy_the_observation_buffers_are_used_again(make_env):
    """copy=False is opt-in: the same memory every time, apart from final_obs, with the same values as with copies."""
    envs, twin = make_env(2, sim_config={"copy": False}), make_env(2)
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
    with pytest.raises(ArgumentError, match="observation_groups"):
        make_env(3, observation_groups=())
    with pytest.raises(UnknownNameError, match=r"unknown observation group 'polcy'. Did you mean 'policy'"):
        make_env(3, observation_groups=("polcy",))


def test_a_single_name_of_a_group_gives_its_array(make_env):
    """In spaces, resets, steps and final observations; adapters still see the group by its name."""
    envs, whole = (make_env(3, observation_groups=groups, max_episode_steps=1) for groups in ("critic", None))
    assert envs.single_observation_space == whole.single_observation_space["critic"]
    assert envs.observation_space.shape == (3, 28)
    first, _ = envs.reset(seed=0)
    assert torch.equal(first, whole.reset(seed=0)[0]["critic"])
    after, *_, info = envs.step(torch.zeros(3, 5))
    wanted, *_, other = whole.step(torch.zeros(3, 5))
    assert torch.equal(after, wanted["critic"])
    assert torch.equal(info["final_obs"], other["final_obs"]["critic"])
    assert list(envs.groups_of(after)) == list(envs.observation_names) == ["critic"]


def test_observations_are_flat_groups_with_named_parts(make_env):
    """Spaces, shapes and names agree, and the seed's worlds differ from each other."""
    envs = make_env(3)
    observation, info = envs.reset(seed=1)
    assert envs.observation_names["policy"] == [("arm", (4,)), ("tcp", (7,)), ("last", (5,)), ("noise", (3,))]
    assert {group: tuple(t.shape) for group, t in observation.items()} == {"policy": (3, 19), "critic": (3, 28)}
    assert envs.single_observation_space["critic"].shape == (28,)
    assert envs.observation_space["policy"].shape == (3, 19)
    assert envs.action_space.shape == (3, 5)
    assert envs.observation_space.contains({g: t.numpy() for g, t in observation.items()})
    assert info["layout"]["seed"].tolist() == [1, 2, 3]
    assert info["layout"]["episode"].tolist() == [0, 0, 0]
    assert info["layout"]["fallback"].tolist() == [False, False, False]
    assert len(np.unique(observation["critic"][:, 19:22].numpy(), axis=0)) == 3


def observed() -> dict[str, dict[str, torch.Tensor]]:
    """Return what a task of three worlds may observe: scalars, vectors, matrices, flags and whole numbers."""
    drawn = torch.arange(3 * 12, dtype=torch.float64).reshape(3, 12) / 7.0
    policy = {"flag": drawn[:, 0] > 1.0, "vector": drawn[:, 1:4], "matrix": drawn[:, 4:10].reshape(3, 2, 3)}
    return {"policy": policy, "critic": {"count": torch.tensor([[4], [5], [6]]), **policy}}


def test_tensors_lie_side_by_side_as_their_names_say():
    """Cut up again by the names' shapes, a flat group gives the tensors back, in single precision."""
    observation = observed()
    flat, names = flatten(observation), names_of(observation)
    assert {group: t.shape for group, t in flat.items()} == {"policy": (3, 10), "critic": (3, 11)}
    for group, parts in names.items():
        assert flat[group].dtype == torch.float32
        rest = flat[group].numpy()
        assert [name for name, _ in parts] == list(observation[group])
        for name, shape in parts:
            size = int(np.prod(shape))
            np.testing.assert_array_equal(
                rest[:, :size].reshape(3, *shape), observation[group][name].numpy().astype(np.float32), err_msg=name
            )
            rest = rest[:, size:]
        assert rest.shape[1] == 0


def test_given_buffers_are_written_to():
    """The same memory, whatever was in it."""
    out = {group: torch.full_like(t, torch.nan) for group, t in flatten(observed()).items()}
    found = flatten(observed(), out)
    for group, fresh in flatten(observed()).items():
        assert found[group].data_ptr() == out[group].data_ptr()
        assert torch.equal(out[group], fresh)


def test_spaces_hold_one_world():
    """Of an observation any numbers, of an action those in [-1, 1]; both of single precision."""
    flat = flatten(observed())
    space = observation_space(flat)
    assert space.contains({group: t[0].numpy() for group, t in flat.items()})
    assert not space.contains({group: t.numpy() for group, t in flat.items()})
    action = action_space(2)
    for value, inside in (([-1.0, 1.0], True), ([-1.01, 0.0], False), ([0.0], False)):
        assert action.contains(np.array(value, np.float32)) == inside
