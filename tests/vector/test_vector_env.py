"""The vector environment: autoreset, episodes, outputs and pictures."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

from sceniris_gym.errors import FixedError, MemoryLimitError
from sceniris_gym.program.checks import simulation
from tests.vector.stepping import actions, assert_equal, leaves, memory_of_a_world, state


def test_the_autoreset_mode_is_the_instances_own(make_env):
    """Mode and metadata belong to one environment, and take members and their values."""
    default, other = make_env(1), make_env(1, autoreset_mode="NextStep")
    assert default.metadata["autoreset_mode"] is default.autoreset_mode is AutoresetMode.SAME_STEP
    assert other.metadata["autoreset_mode"] is other.autoreset_mode is AutoresetMode.NEXT_STEP
    with pytest.raises(ValueError, match="Sometimes"):
        make_env(1, autoreset_mode="Sometimes")


def test_same_step_returns_the_reset_observation_and_the_final_one(make_env):
    """Worlds that end get episode 1 in the same step; what they ended with is in final_obs and final_info."""
    envs, twin = make_env(3), make_env(3, autoreset_mode=AutoresetMode.DISABLED)
    for each in (envs, twin):
        each.reset(seed=4)
    action = actions(3, ending=(1,))
    observation, reward, terminated, truncated, info = envs.step(action)
    final, final_reward, final_terminated, _, final_info = twin.step(action)
    assert terminated.tolist() == final_terminated.tolist() == info["_final_obs"].tolist() == [False, True, False]
    assert not truncated.any()
    assert_equal(info["final_obs"], final)
    assert_equal({"reward": reward}, {"reward": final_reward})
    assert info["final_info"]["layout"]["episode"].tolist() == [0, 0, 0]
    assert info["layout"]["episode"].tolist() == [0, 1, 0]
    assert_equal(info["final_info"]["reward_terms"], final_info["reward_terms"])
    reset, _ = twin.reset(options={"reset_mask": np.array([False, True, False])})
    assert_equal(observation, reset)


def test_next_step_resets_in_the_step_after(make_env):
    """The ending step returns the last observation, the next one the reset, with reward 0 and no flags."""
    envs, twin = make_env(3, autoreset_mode=AutoresetMode.NEXT_STEP), make_env(3, autoreset_mode="Disabled")
    for each in (envs, twin):
        each.reset(seed=4)
    action = actions(3, ending=(1,))
    observation, _, terminated, _, info = envs.step(action)
    last, *_ = twin.step(action)
    assert terminated.tolist() == [False, True, False]
    assert "final_obs" not in info
    assert_equal(observation, last)
    observation, reward, terminated, truncated, info = envs.step(action)
    assert info["layout"]["episode"].tolist() == [0, 1, 0]
    assert float(reward[1]) == float(info["reward_terms"]["near"][1]) == 0.0
    assert not (terminated | truncated).any()
    twin.step(action)
    reset, _ = twin.reset(options={"reset_mask": np.array([False, True, False])})
    assert_equal(observation, reset)
    _, reward, terminated, *_ = envs.step(action)
    assert terminated.tolist() == [False, True, False]
    assert float(reward[1]) < 0.0


def test_disabled_leaves_resets_to_the_user(make_env):
    """Truncation stays until the world is reset, and only that world starts anew."""
    envs = make_env(2, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=2)
    envs.reset(seed=0)
    flags = [envs.step(actions(2))[3].tolist() for _ in range(3)]
    assert flags == [[False, False], [True, True], [True, True]]
    envs.reset(options={"reset_mask": np.array([False, True])})
    assert envs.step(actions(2))[3].tolist() == [True, False]


def test_calls_out_of_order_are_refused(make_env):
    """No step and no masked reset before the first reset, nothing after close; close may come twice."""
    envs = make_env(2)
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(actions(2))
    with pytest.raises(gymnasium.error.ResetNeeded, match="all worlds"):
        envs.reset(options={"reset_mask": np.array([True, False])})
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(2, 5\), got \(5,\)"):
        envs.step(np.zeros(5))
    envs.close()
    envs.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        envs.reset()


@pytest.mark.parametrize(
    "arguments",
    [
        {"output": "jax"},
        {"render_mode": "ansi"},
        {"num_envs": 0},
        {"num_envs": 2.0},
        {"max_episode_steps": 0},
        {"max_episode_steps": -5},
        {"max_episode_steps": 1.5},
        {"render_config": {"size": (0, 0)}},
        {"render_config": {"size": (32, -24)}},
        {"render_config": {"size": 32}},
        {"render_config": {"num_envs": 0}},
    ],
)
def test_wrong_arguments_are_refused(make_env, arguments):
    """Outputs, render modes and sizes that there are not."""
    with pytest.raises(ValueError, match=next(iter(arguments))):
        make_env(**arguments)


@pytest.mark.parametrize("source", [3, lambda: 3])
def test_what_makes_no_layout_source_is_refused(make_env, source):
    """It is a function of the scene and the number of worlds."""
    with pytest.raises(TypeError, match=r"LayoutDataset or a function \(compiled, num_envs\), got"):
        make_env(layout_source=source)


def test_integers_of_numpy_are_integers(make_env):
    """Sizes are often computed."""
    envs = make_env(np.int64(2), max_episode_steps=np.int32(1), render_config={"size": np.array([48, 32])})
    assert envs.reset(seed=np.uint32(3))[1]["layout"]["seed"].tolist() == [3, 4]
    assert envs.step(actions(2))[3].tolist() == [True, True]
    assert (envs.num_envs, envs.np_random_seed) == (2, 3)


def test_returned_tensors_are_never_overwritten(make_env):
    """Results that a caller keeps from a step stay as they were through later steps and resets."""
    envs = make_env(2, max_episode_steps=2)
    kept = [envs.reset(seed=0), *(envs.step(actions(2)) for _ in range(2))]
    copies = [[leaf.clone() for leaf in leaves(result)] for result in kept]
    for _ in range(3):
        envs.step(-actions(2))
    envs.reset()
    for result, copied in zip(kept, copies, strict=True):
        for leaf, copy in zip(leaves(result), copied, strict=True):
            torch.testing.assert_close(leaf, copy, rtol=0, atol=0)


def test_numpy_output_suits_gymnasiums_wrappers(make_env):
    """Plain arrays, no objects and no key `episode` in `info`; statistics and lists of infos can be made of them."""
    envs = make_env(2, output="numpy", max_episode_steps=2)
    plain, _ = envs.reset(seed=0)
    result = envs.step(envs.action_space.sample())

    def check(value) -> None:
        if isinstance(value, dict):
            for item in value.values():
                check(item)
        else:
            assert isinstance(value, np.ndarray)
            assert value.dtype != object

    for value in (plain, *result):
        check(value)
    assert not {"episode", "_episode"} & {*result[-1], *result[-1].get("final_info", {})}
    wrapped = DictInfoToList(RecordEpisodeStatistics(envs))
    wrapped.reset(seed=0)
    total = np.zeros(2)
    for _ in range(2):
        _, reward, _, truncated, infos = wrapped.step(np.zeros((2, 5), np.float32))
        total += reward
    assert truncated.all()
    np.testing.assert_allclose([info["episode"]["r"] for info in infos], total, rtol=1e-5)
    assert infos[1]["final_info"]["layout"]["episode"] == 0


def test_it_steps_under_inference_mode(make_env):
    """Buffers made outside are written inside, and can be used outside again."""
    envs = make_env(2, max_episode_steps=2)
    envs.reset(seed=0)
    with torch.inference_mode():
        for _ in range(3):
            envs.step(actions(2))
    envs.reset()
    _, _, _, truncated, _ = envs.step(actions(2))
    assert not truncated.any()


def test_it_may_be_made_under_inference_mode(make_env):
    """Tensors made under it, the task's too, can be written to outside, and inside again."""
    with torch.inference_mode():
        envs = make_env(2, max_episode_steps=2)
        envs.reset(seed=0)
        envs.step(actions(2))
    for _ in range(2):
        envs.reset()
        observation, _, _, truncated, _ = [envs.step(actions(2)) for _ in range(2)][-1]
        assert truncated.all()
        assert not observation["policy"].is_inference()
    with torch.inference_mode():
        envs.step(actions(2))
        envs.reset()


def test_render_takes_pictures_of_the_first_worlds(make_env):
    """One picture per world up to the stated number, different ones, and the worlds stay as they are."""
    envs = make_env(3, render_mode="rgb_array", render_config={"num_envs": 2, "size": (48, 32)})
    envs.reset(seed=0)
    before = state(envs)
    frames = envs.render()
    assert [frame.shape for frame in frames] == [(32, 48, 3)] * 2
    assert all(frame.dtype == np.uint8 for frame in frames)
    assert not np.array_equal(frames[0], frames[1])
    assert ((frames[0][..., 0] > 100) & (frames[0][..., 1] < 60)).any(), "the red block is in the picture"
    assert_equal(state(envs), before)
    assert make_env(1).render() is None


@pytest.mark.parametrize("more", [{}, {"images": {"overview": {"size": (64, 48)}}, "sim_config": {"prefetch": True}}])
def test_memory_is_told_as_it_is_taken(make_env, more):
    """Within a tenth, with and without pictures and layouts made in advance."""
    told, taken = memory_of_a_world(lambda num_envs: make_env(num_envs, **more))
    assert told == pytest.approx(taken, rel=0.1)


def test_more_worlds_than_fit_are_refused(make_env, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture):
    """The error has the number that fits, as the environment has it; what is taken is logged before it is made."""
    monkeypatch.setattr(simulation, "free_memory", lambda device: 1 << 30)
    with caplog.at_level("INFO", "sceniris_gym"):
        most = make_env(2).batch.memory.most
    assert caplog.messages == ["scene: 2 worlds take 0.00 GiB of 1.00 GiB free on cpu."]
    with pytest.raises(
        MemoryLimitError, match=rf"^scene: {most + 1:,} worlds: takes .*Use fewer worlds \(at most {most:,}\)"
    ):
        make_env(most + 1)


@pytest.mark.parametrize("name", ["scene", "overrides", "compiled", "randomizer", "batch", "state", "layout_source"])
def test_another_scene_is_refused_once_steps_are_captured(make_env, name):
    """Assigned to the environment or to its randomizer; a method that would set one does not exist."""
    envs, other = make_env(num_envs=3), make_env(num_envs=3)
    envs.reset(seed=0)
    with pytest.raises(FixedError, match=f"SceneVectorEnv.{name} cannot be changed.*Make a new SceneVectorEnv"):
        setattr(envs.unwrapped, name, getattr(other, name, {}))
    with pytest.raises(FixedError, match=r"ResetRandomizer\.pipeline"):
        envs.randomizer.pipeline = other.randomizer.pipeline
    with pytest.raises(FixedError, match=r"LayoutGenerator\.compiled"):
        envs.randomizer.pipeline.maker.compiled = other.compiled
    with pytest.raises(AttributeError, match="set_scene"):
        envs.unwrapped.set_scene({})
