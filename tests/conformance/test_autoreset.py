"""In each autoreset mode the environment does what Gymnasium's own SyncVectorEnv does with the same worlds."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.conformance.conftest import MAX_STEPS

MODES = pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.value)
NUM_ENVS, STEPS = 3, 14


def assert_same(ours: Any, own: Any, where: np.ndarray | slice = slice(None)) -> None:
    """Compare arrays, and dicts of them, in some worlds; Gymnasium's masks say where its infos mean something."""
    if isinstance(own, dict):
        for key, value in own.items():
            if not key.startswith("_"):
                mask = own.get(f"_{key}", np.ones(NUM_ENVS, bool))
                both = mask if isinstance(where, slice) else mask & where
                assert_same(ours[key], value, both)
    else:
        worlds = np.flatnonzero(where) if isinstance(where, np.ndarray) else range(NUM_ENVS)
        for i in worlds:
            if isinstance(own[i], dict):  # final_obs is an array of dicts there
                for group in own[i]:
                    np.testing.assert_allclose(ours[group][i], own[i][group], rtol=0, atol=1e-6)
            else:
                np.testing.assert_allclose(ours[i], own[i], rtol=0, atol=1e-6)


def pair(make_env, make_own, mode: AutoresetMode) -> tuple:
    """Make our environment and Gymnasium's, of the same worlds."""
    ours = make_env(NUM_ENVS, output="numpy", autoreset_mode=mode, max_episode_steps=MAX_STEPS)
    return ours, make_own(NUM_ENVS, mode, max_episode_steps=MAX_STEPS)


@pytest.fixture(scope="module")
def made(make_env, make_own) -> Callable[[AutoresetMode], tuple]:
    """Return a function that gives the pair of a mode and a twin of ours, made once: each test begins with a reset."""

    def make(mode: AutoresetMode) -> tuple:
        twin = make_env(NUM_ENVS, output="numpy", autoreset_mode=mode, max_episode_steps=MAX_STEPS)
        return *pair(make_env, make_own, mode), twin

    return cache(make)


@MODES
def test_steps_are_those_of_gymnasiums_vector_environment(make_env, make_own, mode):
    """Observations, rewards, flags and infos agree through ends of both kinds; with DISABLED masks reset by hand."""
    ours, own = pair(make_env, make_own, mode)
    assert ours.metadata["autoreset_mode"] is own.metadata["autoreset_mode"] is mode
    for mine, theirs in zip(ours.reset(seed=3), own.reset(seed=3), strict=True):
        assert_same(mine, theirs)
    own.action_space.seed(0)
    ended = np.zeros(2, int)
    for _ in range(STEPS):
        action = own.action_space.sample()
        mine, theirs = ours.step(action), own.step(action)
        for one, other in zip(mine[:4], theirs[:4], strict=True):
            assert_same(one, other)
        assert_same(mine[4], theirs[4])
        done = theirs[2] | theirs[3]
        ended += theirs[2].sum(), (theirs[3] & ~theirs[2]).sum()
        if mode is AutoresetMode.SAME_STEP:
            np.testing.assert_array_equal(mine[4]["_final_obs"], done)
            np.testing.assert_array_equal(mine[4]["_final_info"], done)
            assert ("final_obs" in theirs[4]) == done.any()
        else:
            assert "final_obs" not in mine[4]
            assert "final_info" not in mine[4]
        if mode is AutoresetMode.DISABLED and done.any():
            mine, theirs = (envs.reset(options={"reset_mask": done.copy()}) for envs in (ours, own))
            assert_same(mine[0], theirs[0])
            assert_same(mine[1], theirs[1], done)
    assert (ended > 0).all(), "episodes were terminated, and truncated"


@MODES
def test_spaces_and_types_are_those_of_gymnasiums_vector_environment(make_env, make_own, mode):
    """Single and batched spaces are equal; what is returned lies in them and has the types of the interface."""
    ours, own = pair(make_env, make_own, mode)
    for name in ("single_observation_space", "observation_space", "single_action_space", "action_space"):
        assert getattr(ours, name) == getattr(own, name)
    observation, info = ours.reset(seed=0)
    assert observation in ours.observation_space
    assert isinstance(info, dict)
    for _ in range(MAX_STEPS + 1):
        observation, reward, terminated, truncated, info = ours.step(ours.action_space.sample())
        assert observation in ours.observation_space
        assert (reward.shape, terminated.shape, truncated.shape) == ((NUM_ENVS,),) * 3
        assert np.issubdtype(reward.dtype, np.floating)
        assert terminated.dtype == truncated.dtype == np.bool_
        assert isinstance(info, dict)


@MODES
@pytest.mark.parametrize("seed", [7, [7, 70, 700], (2, None, 5)], ids=str)
def test_seeds_mean_what_they_mean_to_gymnasium(made, mode, seed):
    """An integer counts up, a list is taken as it is, and no seed (in a list, too) goes on."""
    ours, own, _ = made(mode)
    for envs in (ours, own):
        envs.reset(seed=[40, 50, 60])
    for again in (seed, None, seed):
        mine, theirs = ours.reset(seed=again), own.reset(seed=again)
        assert_same(mine[0], theirs[0])
        assert_same(mine[1], theirs[1])


@MODES
def test_an_ended_world_that_is_reset_by_hand_is_not_reset_again(make_env, make_own, mode):
    """A partial reset between the end and the next step stands."""
    ours, own = pair(make_env, make_own, mode)
    for envs in (ours, own):
        envs.reset(seed=0)
    action = np.zeros((NUM_ENVS, 5), np.float32)
    action[1, 0] = 1.0
    done = np.array([False, True, False])
    for envs in (ours, own):
        assert envs.step(action)[2].tolist() == done.tolist()
        envs.reset(options={"reset_mask": done.copy()})
    action[1, 0] = 0.5
    mine, theirs = ours.step(action), own.step(action)
    for one, other in zip(mine, theirs, strict=True):
        assert_same(one, other)


@MODES
@pytest.mark.parametrize(
    "mask",
    [
        [True, False, True],
        (True, False, True),
        True,
        np.array([1, 0, 1]),
        np.array([1.0, 0.0, 1.0]),
        np.array(["a", "", "b"]),
        np.array([True, False]),
        np.array([[True, False, True]]),
        np.array(True),
        np.array([False, False, False]),
    ],
    ids=repr,
)
def test_a_wrong_reset_mask_fails_as_with_gymnasium(made, mode, mask):
    """The same kind of exception, and the worlds are as they were: they go on as a twin does that was not asked."""
    ours, own, twin = made(mode)
    for envs in (ours, own, twin):
        envs.reset(seed=0)
    with pytest.raises((TypeError, ValueError)) as theirs:
        own.reset(options={"reset_mask": mask})
    with pytest.raises((TypeError, ValueError)) as mine:
        ours.reset(options={"reset_mask": mask})
    assert isinstance(mine.value, theirs.type)
    action = np.full((NUM_ENVS, 5), 0.3, np.float32)
    for one, other in zip(ours.step(action), twin.step(action), strict=True):
        assert_same(one, other)


@MODES
@pytest.mark.parametrize("seed", [[1, 2], [1, 2, 3, 4], []], ids=str)
def test_too_few_or_too_many_seeds_fail_as_with_gymnasium(made, mode, seed):
    """One for each world."""
    for envs in made(mode):
        with pytest.raises(ValueError, match=r"3"):
            envs.reset(seed=seed)


@MODES
def test_infos_of_all_worlds_are_arrays_without_masks(make_env, mode):
    """Every entry has a row for each world; none is of objects, none is called `episode`."""
    envs = make_env(NUM_ENVS, output="numpy", autoreset_mode=mode, max_episode_steps=2)
    infos = [envs.reset(seed=0)[1], *(envs.step(envs.action_space.sample())[4] for _ in range(4))]

    def check(info: dict) -> None:
        for value in info.values():
            if isinstance(value, dict):
                check(value)
            else:
                assert isinstance(value, np.ndarray)
                assert value.dtype != object
                assert len(value) == NUM_ENVS

    for info in infos:
        assert not {"episode", "_episode"} & {*info, *info.get("final_info", {})}
        check(info)
