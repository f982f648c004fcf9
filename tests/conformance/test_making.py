"""Environments made by Gymnasium: by id, by spec, with their module, as batch or as one world."""

from __future__ import annotations

import json
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from sceniris_gym.registration import ENVS
from sceniris_gym.vector.single_env import SceneEnv
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.conformance.conftest import MAX_STEPS

UNBOUNDED = "ignore:.*A Box observation space (maximum|minimum) value"


def observed(envs: gymnasium.vector.VectorEnv) -> np.ndarray:
    """Return what the critic sees after a reset with seed 5."""
    return np.asarray(envs.reset(seed=5)[0]["critic"])


def test_it_is_made_by_id_with_its_module_and_by_spec(env_id):
    """All three give the same worlds, with the episode length of the registration unless another is given."""
    made = [
        gymnasium.make_vec(env_id, num_envs=2),
        gymnasium.make_vec(f"tests.conformance.conftest:{env_id}", num_envs=2),
        gymnasium.make_vec(gymnasium.spec(env_id), num_envs=2),
        gymnasium.make_vec(env_id, num_envs=2, max_episode_steps=3, output="numpy"),
    ]
    for envs, steps in zip(made, [MAX_STEPS] * 3 + [3], strict=True):
        assert isinstance(envs, SceneVectorEnv)
        assert envs.max_episode_steps == steps
        np.testing.assert_array_equal(observed(envs), observed(made[0]))


def test_the_packages_own_ids_are_found_with_the_module():
    """`sceniris_gym:` imports the package, which registers them."""
    for name in ("sceniris_gym:sceniris_gym/DrawerPick-v0", "sceniris_gym/DrawerPick-v0"):
        spec = gymnasium.spec(name.removeprefix("sceniris_gym:"))
        assert spec.vector_entry_point == "sceniris_gym.vector.vector_env:SceneVectorEnv"
    with pytest.raises(gymnasium.error.NameNotFound, match="DrawerPick"):
        gymnasium.make_vec("sceniris_gym:sceniris_gym/DrawerPik-v0")


def test_a_spec_makes_the_environment_again_after_pickling(env_id):
    """It has all arguments, and Gymnasium's registry is not changed by making."""
    before = pickle.dumps(gymnasium.spec(env_id))
    mode = AutoresetMode.NEXT_STEP
    envs = gymnasium.make_vec(env_id, num_envs=2, autoreset_mode=mode, split="eval", output="numpy")
    assert isinstance(envs.spec, EnvSpec)
    again = gymnasium.make_vec(pickle.loads(pickle.dumps(envs.spec)))
    assert (again.num_envs, again.metadata["autoreset_mode"]) == (2, mode)
    np.testing.assert_array_equal(observed(again), observed(envs))
    assert again.spec == envs.spec
    assert pickle.dumps(gymnasium.spec(env_id)) == before


def test_a_spec_of_plain_values_goes_through_json(env_id):
    """With the mode by its value, as text has no enums."""
    envs = gymnasium.make_vec(env_id, num_envs=2, autoreset_mode="Disabled", output="numpy")
    assert envs.spec is not None
    text = envs.spec.to_json()
    assert json.loads(text)["kwargs"]["num_envs"] == 2
    again = gymnasium.make_vec(EnvSpec.from_json(text))
    assert again.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    np.testing.assert_array_equal(observed(again), observed(envs))


def test_making_stepping_and_closing_warns_of_nothing(env_id):
    """Not of metadata, spaces or modes."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = gymnasium.make_vec(env_id, num_envs=2)
        envs.reset(seed=0)
        envs.step(envs.action_space.sample())
        envs.close()


def test_it_may_be_closed_twice_and_not_used_after(env_id):
    """The second call does nothing; the batch and the single world refuse all else."""
    for env in (gymnasium.make_vec(env_id, num_envs=2), gymnasium.make(env_id)):
        env.reset(seed=0)
        env.close()
        env.close()
        for call in (env.reset, lambda env=env: env.step(env.action_space.sample())):
            with pytest.raises(gymnasium.error.ClosedEnvironmentError):
                call()


def test_gymnasium_can_make_a_batch_of_single_worlds(env_id):
    """vectorization_mode="sync" has the same worlds, seed by seed."""
    own = gymnasium.make_vec(env_id, num_envs=2, vectorization_mode="sync")
    assert isinstance(own, SyncVectorEnv)
    np.testing.assert_array_equal(observed(own), observed(gymnasium.make_vec(env_id, num_envs=2)))


@pytest.mark.parametrize("wrong", [{"vector_kwargs": {"copy": False}}, {"wrappers": (gymnasium.Wrapper,)}])
def test_arguments_for_wrapped_single_worlds_are_refused_by_gymnasium(env_id, wrong):
    """A batch of its own takes plain keyword arguments only."""
    with pytest.raises(gymnasium.error.Error, match="vector"):
        gymnasium.make_vec(env_id, num_envs=2, **wrong)


@pytest.mark.filterwarnings("error", UNBOUNDED)
def test_one_world_passes_gymnasiums_checker(env_id):
    """All of it: spaces, seeds, determinism, data that is not used again, pictures, closing; without a warning."""
    env = gymnasium.make(env_id, render_mode="rgb_array", render_config={"size": (32, 24)})
    assert isinstance(env.unwrapped, SceneEnv)
    check_env(env.unwrapped)


def test_two_of_one_world_match_step_by_step(env_id):
    """Gymnasium's comparison of two environments, with the same seeds and actions, finds no difference."""
    first, second = gymnasium.make(env_id), gymnasium.make(env_id)
    check_environments_match(first.unwrapped, second.unwrapped, num_steps=2 * MAX_STEPS, seed=3)


def test_one_world_is_truncated_by_gymnasiums_time_limit(env_id):
    """gymnasium.make has wrappers of its own for that, and for calls out of order."""
    env = gymnasium.make(env_id)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(env.action_space.sample())
    env.reset(seed=0)
    flags = [env.step(np.zeros(5, np.float32))[2:4] for _ in range(MAX_STEPS)]
    assert flags == [(False, False)] * (MAX_STEPS - 1) + [(False, True)]


@pytest.mark.slow
@pytest.mark.filterwarnings("error", UNBOUNDED)
@pytest.mark.parametrize("name", sorted(ENVS))
def test_every_environment_of_the_package_passes_gymnasiums_checker(name):
    """One world of each, with the arguments of its registration, and with pictures."""
    env = gymnasium.make(name, device="cpu", render_mode="rgb_array", render_config={"size": (32, 24)})
    check_env(env.unwrapped, skip_close_check=True)
    env.reset(seed=0)
    frame = np.asarray(env.render())
    assert frame.std(axis=(0, 1)).min() > 5.0, "something is seen"
    env.close()
