"""One world of a task, beside a batch of one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from sceniris_gym.errors import FixedError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.single_env import SceneEnv
from tests.vector.conftest import Reach


@pytest.fixture
def make_one(reach_scene: CompiledScene) -> Callable[..., SceneEnv]:
    """Return a function that makes one world of the reaching task."""
    return lambda **kwargs: SceneEnv(Reach, scene=reach_scene, **kwargs)


def assert_first(one: Any, batch: Any) -> None:
    """Check that nested dicts of one world are the first row of those of a batch, to the bit."""
    if isinstance(batch, dict):
        assert set(one) == set(batch)
        for name in batch:
            assert_first(one[name], batch[name])
    else:
        np.testing.assert_array_equal(one, batch[0])


def test_it_is_the_first_world_of_a_batch(make_one, make_env):
    """Observations, rewards, flags and infos of some steps and of a second episode; plain numbers and arrays."""
    one, batch = make_one(), make_env(1, output="numpy", autoreset_mode="Disabled")
    rng = np.random.default_rng(0)
    for seed in (8, None):
        found, expected = one.reset(seed=seed), batch.reset(seed=seed)
        assert_first(found[0], expected[0])
        assert_first(found[1], expected[1])
        for action in rng.uniform(-0.8, 0.8, (3, 5)).astype(np.float32):
            observation, reward, terminated, truncated, info = one.step(action)
            expected = batch.step(action[None])
            assert_first(observation, expected[0])
            assert_first(info, expected[4])
            assert (reward, terminated, truncated) == (expected[1][0], expected[2][0], expected[3][0])
            assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
    assert one.observation_space.contains(observation)  # pyrefly: ignore[unbound-name]


def test_a_finished_episode_goes_on_until_it_is_reset(make_one):
    """There is no autoreset: the flags stay up, and the episode is the same."""
    one = make_one(max_episode_steps=2)
    one.reset(seed=1)
    for step in range(1, 4):
        *_, terminated, truncated, info = one.step(np.zeros(5, np.float32))
        assert (terminated, truncated) == (False, step >= 2)
        assert info["layout"]["episode"] == 0
    *_, terminated, _, _ = one.step(np.ones(5, np.float32))
    assert terminated
    assert one.reset()[1]["layout"]["episode"] == 1


def test_the_seed_that_was_given_is_the_worlds(make_one):
    """It is recorded as Gymnasium wants it; without one the drawn seed is, and brings the layout back."""
    one, other = make_one(), make_one()
    _, info = one.reset(seed=12)
    assert one.np_random_seed == info["layout"]["seed"] == 12
    drawn, _ = other.reset()
    assert other.np_random_seed != 12
    again, _ = one.reset(seed=other.np_random_seed)
    np.testing.assert_array_equal(again["critic"], drawn["critic"])


def test_a_picture_is_one_array(make_one):
    """Of the size that was asked for; none without a render mode."""
    one = make_one(render_mode="rgb_array", render_config={"size": (48, 32)})
    one.reset(seed=0)
    picture = one.render()
    assert (picture.shape, picture.dtype) == ((32, 48, 3), np.uint8)
    assert picture.std() > 5.0
    assert one.metadata["render_fps"] == 100
    assert make_one().render() is None


def test_a_closed_world_is_refused(make_one):
    """Closing may come twice."""
    one = make_one()
    one.reset(seed=0)
    one.close()
    one.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        one.step(np.zeros(5, np.float32))


@pytest.mark.parametrize("name", ["num_envs", "output", "autoreset_mode"])
def test_what_one_world_cannot_have_is_no_argument(make_one, name: str):
    """A batch, tensors, or resets of its own."""
    with pytest.raises(TypeError, match=name):
        make_one(**{name: 1})


@pytest.mark.parametrize("name", ["envs", "scene", "overrides", "compiled", "layout_source"])
def test_another_scene_is_refused(make_one, name: str):
    """Assigned to the unwrapped environment, where nothing would follow from it."""
    one = make_one()
    one.reset(seed=0)
    with pytest.raises(FixedError, match=f"SceneEnv.{name} cannot be changed"):
        setattr(one.unwrapped, name, one.envs)


def test_one_world_has_an_id_a_redraw_and_snapshots(make_one):
    """For options of later resets, as in a batch."""
    env = make_one()
    env.reset(seed=8)
    layout, kept, qpos = env.layout_id(), env.snapshot(), env.envs.batch.data.qpos
    before = qpos.numpy().copy()
    env.redraw("block")
    assert (qpos.numpy() != before).any()
    env.reset(options={"state": kept})
    np.testing.assert_array_equal(qpos.numpy(), before)
    env.reset(seed=9)
    _, info = env.reset(options={"layouts": layout})
    assert (info["layout"]["seed"], info["layout"]["episode"]) == (8, 0)
    assert env.layout_id() == layout
