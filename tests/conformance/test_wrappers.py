"""Gymnasium's own wrappers around the environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers
from gymnasium.wrappers.vector.array_conversion import ArrayConversion
from gymnasium.wrappers.vector.numpy_to_torch import NumpyToTorch

MODES = pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.value)
NUM_ENVS, MAX_STEPS = 3, 4
HOLD = np.zeros((NUM_ENVS, 5), np.float32)


def make(make_env, mode: AutoresetMode = AutoresetMode.SAME_STEP, **kwargs):
    """Make the environment that is wrapped here."""
    return make_env(NUM_ENVS, autoreset_mode=mode, max_episode_steps=MAX_STEPS, **{"output": "numpy", **kwargs})


@MODES
def test_episode_statistics_agree_with_our_own(make_env, mode):
    """RecordEpisodeStatistics counts the same episodes, returns and lengths as `statistics`, with partial resets."""
    inner = make(make_env, mode)
    envs = wrappers.RecordEpisodeStatistics(inner)
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for step in range(13):
        *_, terminated, truncated, info = envs.step(rng.uniform(-1.0, 1.0, (NUM_ENVS, 5)))
        done = terminated | truncated
        assert ("episode" in info) == done.any()
        if mode is AutoresetMode.DISABLED and done.any():
            envs.reset(options={"reset_mask": done})
        if step == 6:
            envs.reset(options={"reset_mask": np.array([True, False, False])})
    found = inner.statistics.read()
    assert found["episodes"] == envs.episode_count > 4
    assert found["return"] == pytest.approx(np.mean(envs.return_queue), rel=1e-5)
    assert found["length"] == pytest.approx(np.mean(envs.length_queue))


@MODES
def test_videos_are_recorded_with_every_world_in_them(make_env, tmp_path: Path, mode):
    """RecordVideo wants a picture of each world, of many more than fit in a row, too."""
    imageio = pytest.importorskip("imageio.v3")
    pytest.importorskip("moviepy")
    count = 18
    inner = make_env(
        count,
        autoreset_mode=mode,
        max_episode_steps=MAX_STEPS,
        output="numpy",
        render_mode="rgb_array",
        render_config={"size": (32, 24)},
    )
    envs = wrappers.RecordVideo(inner, str(tmp_path / "videos"), episode_trigger=lambda episode: episode == 0)
    envs.reset(seed=0)
    assert len(inner.render() or ()) == count
    for _ in range(MAX_STEPS):
        envs.step(np.zeros((count, 5), np.float32))
    envs.close()
    (video,) = (tmp_path / "videos").glob("*.mp4")
    frames = imageio.imread(video)
    # the last picture of an episode is not seen where the reset comes in the same step
    assert len(frames) == MAX_STEPS + (mode is not AutoresetMode.SAME_STEP)
    assert frames.shape[1] * frames.shape[2] == count * 32 * 24
    assert imageio.immeta(video)["fps"] == inner.metadata["render_fps"] == 100


@pytest.mark.slow
def test_a_video_of_a_shipped_task_is_recorded(tmp_path: Path):
    """TabletopLift-v0 moves in it: pictures differ from one step to the next."""
    imageio = pytest.importorskip("imageio.v3")
    pytest.importorskip("moviepy")
    kwargs: dict[str, Any] = {
        "device": "cpu",
        "output": "numpy",
        "render_mode": "rgb_array",
        "render_config": {"size": (64, 48)},
    }
    envs = gymnasium.make_vec("sceniris_gym/TabletopLift-v0", num_envs=2, max_episode_steps=MAX_STEPS, **kwargs)
    envs = wrappers.RecordVideo(envs, str(tmp_path), episode_trigger=lambda episode: episode == 0)
    envs.reset(seed=0)
    for _ in range(MAX_STEPS):
        envs.step(np.ones((2, 5), np.float32))
    envs.close()
    frames = imageio.imread(next(tmp_path.glob("*.mp4"))).astype(int)
    assert len(frames) == MAX_STEPS
    assert frames.shape[1] * frames.shape[2] == 2 * 64 * 48
    assert np.abs(np.diff(frames, axis=0)).max() > 50


def test_flat_observations_are_normalised(make_env):
    """NormalizeObservation cannot take a dict of groups; behind FlattenObservation it has mean 0 and deviation 1."""
    with pytest.raises(np.exceptions.AxisError):
        wrappers.NormalizeObservation(make(make_env, AutoresetMode.NEXT_STEP)).reset(seed=0)
    envs = wrappers.NormalizeObservation(wrappers.FlattenObservation(make(make_env, AutoresetMode.NEXT_STEP)))
    seen = [envs.reset(seed=0)[0]]
    rng = np.random.default_rng(0)
    for _ in range(40):
        seen.append(envs.step(rng.uniform(-0.8, 0.8, (NUM_ENVS, 5)))[0])
    late = np.concatenate(seen[10:])
    assert late.shape[1] == envs.single_observation_space.shape[0]
    moving = late.std(axis=0) > 0.01
    assert moving.sum() > 16
    assert np.abs(late.mean(axis=0)[moving]).max() < 1.0
    assert 0.3 < late.std(axis=0)[moving].mean() < 2.0


def test_observations_are_normalised_where_the_reset_is_a_step_of_its_own(make_env):
    """NormalizeObservation around one group has mean 0 and deviation 1 over what it has seen."""
    envs = wrappers.NormalizeObservation(make(make_env, AutoresetMode.NEXT_STEP, observation_groups="policy"))
    seen = [envs.reset(seed=0)[0]]
    rng = np.random.default_rng(0)
    for _ in range(40):
        seen.append(envs.step(rng.uniform(-0.8, 0.8, (NUM_ENVS, 5)))[0])
    late = np.concatenate(seen[10:])
    moving = late.std(axis=0) > 0.01
    assert moving.sum() > 8
    assert np.abs(late.mean(axis=0)[moving]).max() < 1.0
    assert 0.3 < late.std(axis=0)[moving].mean() < 2.0
    with pytest.raises(ValueError, match="NEXT_STEP"):
        wrappers.NormalizeObservation(make(make_env, AutoresetMode.DISABLED))


def test_observations_are_filtered_and_flattened(make_env):
    """Gymnasium's wrappers know the dict of groups."""
    inner = make(make_env, AutoresetMode.NEXT_STEP)
    plain, _ = inner.reset(seed=0)
    filtered = wrappers.FilterObservation(inner, ["critic"])
    assert filtered.reset(seed=0)[0].keys() == {"critic"}
    flat = wrappers.FlattenObservation(inner)
    assert isinstance(flat.single_observation_space, Box)
    both = np.concatenate([plain["critic"], plain["policy"]], axis=1)
    np.testing.assert_array_equal(flat.reset(seed=0)[0], both)


@MODES
def test_actions_and_rewards_are_transformed(make_env, mode):
    """RescaleAction, ClipAction and the reward's wrappers pass on what they do not touch."""
    plain, inner = make(make_env, mode), make(make_env, mode)
    envs = wrappers.NormalizeReward(wrappers.ClipReward(wrappers.ClipAction(inner), -0.3, 0.0))
    rescaled = wrappers.RescaleAction(make(make_env, mode), np.zeros(5, np.float32), np.ones(5, np.float32))
    for each in (plain, envs, rescaled):
        each.reset(seed=0)
    expected, reward, *_ = plain.step(HOLD + 0.5)
    np.testing.assert_array_equal(envs.step(HOLD + 0.5)[0]["critic"], expected["critic"])
    np.testing.assert_allclose(rescaled.step(HOLD + 0.75)[1], reward, atol=1e-6)


@MODES
def test_infos_become_lists(make_env, mode):
    """DictInfoToList gives each world its own, and final ones to the worlds that ended."""
    envs = wrappers.DictInfoToList(make(make_env, mode))
    _, infos = envs.reset(seed=4)
    assert [info["layout"]["seed"] for info in infos] == [4, 5, 6]
    action = HOLD.copy()
    action[2, 0] = 1.0
    infos = envs.step(action)[4]
    assert [("final_info" in info) for info in infos] == [False, False, mode is AutoresetMode.SAME_STEP]
    assert infos[0]["reward_terms"].keys() == {"near", "effort"}


@MODES
def test_numpy_becomes_torch(make_env, mode):
    """NumpyToTorch gives what output="torch" gives, masks of torch included."""
    envs, plain = NumpyToTorch(make(make_env, mode)), make(make_env, mode, output="torch")
    options = {"reset_mask": torch.tensor([False, True, False])}
    results = []
    for each in (envs, plain):
        steps = [each.reset(seed=0), *(each.step(torch.as_tensor(HOLD)) for _ in range(MAX_STEPS + 1))]
        results.append([*steps, each.reset(options=options)])
    for one, other in zip(*results, strict=True):
        assert_equal(one, other)


@MODES
def test_torch_becomes_numpy(make_env, mode):
    """ArrayConversion from torch gives what output="numpy" gives, actions and masks of numpy included."""
    envs = ArrayConversion(make(make_env, mode, output="torch"), env_xp=torch, target_xp=np)
    plain = make(make_env, mode)
    options = {"reset_mask": np.array([False, True, False])}
    results = []
    for each in (envs, plain):
        steps = [each.reset(seed=0), *(each.step(HOLD) for _ in range(MAX_STEPS + 1))]
        results.append([*steps, each.reset(options=options)])
    for one, other in zip(*results, strict=True):
        assert_equal(one, other)


def assert_equal(one, other) -> None:
    """Check that nested tuples and dicts hold arrays of the same kind and values."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_equal(one[key], other[key])
    elif isinstance(one, tuple):
        for left, right in zip(one, other, strict=True):
            assert_equal(left, right)
    else:
        assert type(one) is type(other)
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(np.asarray(one), np.asarray(other))
