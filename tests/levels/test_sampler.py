"""Levels in environments: the layout of a level is that of its id, episodes are told, and a sampler goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError, ArgumentTypeError
from sceniris_gym.levels import Levels
from tests.vector.conftest import Reach, make_env, reach_scene  # noqa: F401, fixtures
from tests.vector.stepping import actions, assert_equal

LEVELS = Levels("failure", replay=0.5, every=1, capacity=64)


def _play(envs, steps: int) -> list[dict]:
    return [envs.step(actions(envs.num_envs, ending=(k % envs.num_envs,)))[-1] for k in range(steps)]


@pytest.mark.parametrize("prefetch", [False, True])
def test_a_level_is_the_layout_of_its_id(make_env, prefetch):  # noqa: F811
    """With replays in between, and the next ones made ahead or not."""
    envs, plain = make_env(3, max_episode_steps=3, levels=LEVELS, prefetch=prefetch), make_env(3)
    envs.reset(seed=5)
    replayed = 0
    for _ in range(24):
        observation, _, _, _, info = envs.step(actions(3))
        if info["_final_obs"].any():
            named = {"seed": info["layout_seed"], "episode": info["layout_episode"]}
            assert_equal(plain.reset(options={"layouts": named})[0], observation)
            replayed += int((info["layout_level"] >= 0).sum())
    assert replayed > 3
    assert envs.randomizer.levels.size > 3


def test_levels_depend_on_seeds_and_outcomes_alone(make_env):  # noqa: F811
    """The same ones in a second run, and after a seed they begin anew."""
    runs = []
    for _ in range(2):
        envs = make_env(4, max_episode_steps=3, levels=LEVELS)
        envs.reset(seed=1)
        runs.append([info["layout_seed"].tolist() for info in _play(envs, 20)])
    assert runs[0] == runs[1]
    assert len(set(map(tuple, runs[0]))) > 4


def test_a_sampler_goes_on_where_it_was(make_env):  # noqa: F811
    """From its state in another process's environment: the same levels follow, with weights refreshed as often."""
    levels = replace(LEVELS, every=7)
    first, second = (make_env(4, max_episode_steps=3, levels=levels) for _ in range(2))
    first.reset(seed=1)
    _play(first, 9)
    second.reset(seed=2)
    second.randomizer.levels.restore(first.randomizer.levels.state())
    assert_equal(first.reset()[1], second.reset()[1])
    runs = [[info["layout_seed"].tolist() for info in _play(envs, 30)] for envs in (first, second)]
    assert runs[0] == runs[1]
    kept, before = first.randomizer.levels.state(), second.randomizer.levels.state()
    for name, shape in (("seed", r"\(64,\)"), ("resets", r"\(\)")):
        with pytest.raises(ArgumentError, match=f"{name} should have shape {shape}"):
            second.randomizer.levels.restore({key: kept[key] for key in kept if key != name})
    np.testing.assert_equal(second.randomizer.levels.state(), before)  # all of it or nothing


def test_a_snapshot_goes_on_with_the_levels_of_its_step(make_env):  # noqa: F811
    """Of the episodes that follow, too, once the sampler was restored."""
    envs = make_env(3, max_episode_steps=3, levels=LEVELS)
    envs.reset(seed=1)
    _play(envs, 8)
    kept, levels, runs = envs.snapshot(), envs.randomizer.levels.state(), []
    for _ in range(2):
        envs.randomizer.levels.restore(levels)
        envs.reset(options={"state": kept})
        infos = _play(envs, 8)
        runs.append([info[f"layout_{name}"].tolist() for info in infos for name in ("seed", "level")])
    assert runs[0] == runs[1]


def test_scores_can_be_given(make_env):  # noqa: F811
    """By infos of episodes that ended before, as torch tensors or NumPy arrays; wrong lengths are refused."""
    envs = make_env(4, max_episode_steps=2, levels=Levels("given", replay=1.0, every=1))
    envs.reset(seed=2**63)
    for _ in range(4):
        info = envs.step(actions(4))[-1]
        last, done = info["final_info"], info["_final_info"]
        columns = [last[f"layout_{name}"][done] for name in ("level", "seed", "episode")]
        envs.randomizer.levels.update(*columns, torch.linspace(0.1, 1.0, int(done.sum())))
    assert envs.randomizer.levels.size > 0
    assert (envs.reset()[1]["layout_level"] >= 0).all()
    with pytest.raises(ArgumentError, match="one length"):
        envs.randomizer.levels.update(np.array([-1]), np.array([1]), np.array([0]), np.array([0.5, 0.5]))
    with pytest.raises(ArgumentError, match=r"shape \(n,\)"):
        envs.randomizer.levels.update(np.int32(-1), 1, 0, 0.5)
    with pytest.raises(ArgumentTypeError, match="should be a Levels"):
        make_env(2, levels="learnability")


def test_many_levels_are_inserted_at_once(make_env):  # noqa: F811
    """More than there are worlds: all of them while there is room, and they are drawn without a reset."""
    levels = make_env(2, levels=Levels("given", capacity=64)).randomizer.levels
    seeds = np.arange(50, dtype=np.uint64) + 7
    levels.insert(seeds, np.arange(50), np.linspace(0.5, 1.0, 50))
    kept = levels.state()
    assert sorted(kept["seed"][kept["age"] >= 0]) == seeds.tolist()
    assert (kept["seed"] == kept["episode"] + np.uint64(7))[kept["age"] >= 0].all()
    assert np.isin(levels.sample(20)["seed"], seeds).all()


def test_levels_of_no_episode_are_left_out(make_env):  # noqa: F811
    """Worlds would play the next episode of their seed in their place, under a wrong name."""
    levels = make_env(2, levels=Levels("given", capacity=8)).randomizer.levels
    levels.insert(np.array([5, 6, 7]), np.array([0, -1, 3]), np.full(3, 0.5))
    kept = levels.state()
    assert sorted(kept["seed"][kept["age"] >= 0]) == [5, 7]


def test_a_level_beyond_the_buffer_is_inserted(make_env):  # noqa: F811
    """No memory beyond the buffer is read."""
    levels = make_env(2, levels=Levels("given", capacity=64)).randomizer.levels
    levels.update(np.array([1 << 29]), np.array([3]), np.array([0]), np.array([1.0]))
    assert levels.size == 1
