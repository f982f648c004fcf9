"""`np_random_seed` as Gymnasium documents it: a seed that brings the same worlds back, or -1 where none is known."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest


def critic(observation) -> np.ndarray:
    """Return what the critic sees."""
    return np.asarray(observation["critic"])


@pytest.mark.parametrize("asked_before", [True, False])
def test_the_seed_of_an_unseeded_batch_brings_it_back(make_env, asked_before):
    """Drawn when the environment is made, it is the first reset's, and later resets do not change it."""
    envs, other = make_env(2), make_env(2)
    before = envs.np_random_seed if asked_before else None
    first, info = envs.reset()
    second, _ = envs.reset()
    seed = envs.np_random_seed
    assert before in (seed, None)
    assert other.np_random_seed != seed
    assert info["layout"]["seed"].tolist() == [seed, seed + 1]
    np.testing.assert_array_equal(critic(other.reset(seed=seed)[0]), critic(first))
    np.testing.assert_array_equal(critic(other.reset()[0]), critic(second))


@pytest.mark.parametrize("asked_before", [True, False])
def test_the_seed_of_an_unseeded_world_brings_it_back(env_id, asked_before):
    """The same holds for what gymnasium.make gives."""
    env = gymnasium.make(env_id)
    before = env.unwrapped.np_random_seed if asked_before else None
    first, info = env.reset()
    env.reset()
    seed = env.unwrapped.np_random_seed
    assert before in (seed, None)
    assert info["layout"]["seed"] == seed
    again, info = env.reset(seed=seed)
    assert (info["layout"]["seed"], info["layout"]["episode"]) == (seed, 0)
    np.testing.assert_array_equal(critic(again), critic(first))


def test_a_world_that_is_given_a_wrong_seed_keeps_its_own(env_id):
    """After a seed is refused, np_random_seed is still the seed of the layouts."""
    env = gymnasium.make(env_id)
    env.reset(seed=3)
    with pytest.raises(ValueError, match="seed"):
        env.reset(seed=1 << 64)
    assert env.unwrapped.np_random_seed == 3
    assert env.reset()[1]["layout"]["seed"] == 3


@pytest.mark.parametrize(
    "again",
    [
        {"seed": [5, 60, 7]},
        {"seed": [None, 5, None]},
        {"seed": 100, "options": {"reset_mask": np.array([False, True, False])}},
    ],
    ids=str,
)
def test_the_seed_is_unknown_where_worlds_were_given_their_own(make_env, again):
    """No integer brings them back, and -1 is none; the generator depends on the seeds alone."""
    generators = []
    for _ in range(2):
        envs = make_env(3)
        envs.reset(seed=7)
        envs.reset(**again)
        assert envs.np_random_seed == -1
        envs.reset()
        assert envs.np_random_seed == -1
        generators.append(envs.np_random.bit_generator.state)
    assert generators[0] == generators[1]
    envs.reset(seed=8)
    assert envs.np_random_seed == 8


def test_the_seed_stays_known_where_no_world_was_given_one(make_env):
    """A partial reset without a seed, a list of None, and a seed for a world that is not reset, go on."""
    envs = make_env(3)
    envs.reset(seed=7)
    envs.reset(options={"reset_mask": np.array([False, True, False])})
    envs.reset(seed=[None] * 3)
    _, info = envs.reset(seed=[None, 5, None], options={"reset_mask": np.array([True, False, False])})
    assert envs.np_random_seed == 7 and list(info["layout"]["seed"]) == [7, 8, 9]


def test_a_generator_of_the_users_own_has_an_unknown_seed(make_env, env_id):
    """So Gymnasium says; the first reset draws all the same."""
    envs, env = make_env(2), gymnasium.make(env_id).unwrapped
    for each in (envs, env):
        each.np_random = np.random.default_rng(3)
        assert each.np_random_seed == -1
        first, _ = each.reset()
        assert (critic(each.reset()[0]) != critic(first)).any()
