"""Weights of levels against the formulas in double precision, and the places that are given to others."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.stats import chisquare, rankdata

from sceniris_gym.errors import ArgumentError
from sceniris_gym.levels.curriculum import ADR, LevelReplay
from sceniris_gym.levels.refresh import launch_refresh
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.levels.filling import NWORLD, SCORES, chosen, created, filled, tell
from tests.vector.conftest import Reach, reach_scene  # noqa: F401, a fixture
from tests.vector.stepping import actions


@pytest.mark.parametrize("staleness", [0.0, 0.4])
@pytest.mark.parametrize("priority", ["rank", "proportional", "uniform"])
def test_levels_are_chosen_by_their_weights(priority: str, staleness: float):
    """rank^(-1/T) or score^(1/T), and a share by the time since a level was chosen last; p > 0.001."""
    levels = LevelReplay("custom", prioritization=priority, temperature=0.7, staleness_coef=staleness, capacity=32)
    buffer = filled(levels, SCORES)
    ages = np.arange(len(SCORES))
    buffer.age.assign(np.append(ages, np.full(32 - len(ages), -1)))
    launch_refresh(buffer, levels)
    weights = {
        "rank": rankdata(-SCORES) ** (-1 / 0.7),
        "proportional": SCORES ** (1 / 0.7),
        "uniform": np.ones(len(SCORES)),
    }[priority]
    share = (1 - staleness) * weights / weights.sum() + staleness * ages / ages.sum()
    found = np.bincount(chosen(buffer, 40), minlength=len(SCORES))
    assert found.sum() == 40 * NWORLD
    wanted = share * found.sum()
    many = wanted > 5
    if priority != "proportional":  # scores are rounded by up to 2.2%
        assert (
            chisquare(
                np.append(found[many], found[~many].sum() + 1), np.append(wanted[many], wanted[~many].sum() + 1)
            ).pvalue
            > 1e-3
        )
    np.testing.assert_allclose(found / found.sum(), share, atol=0.02)


@pytest.mark.parametrize("priority", ["rank", "proportional"])
def test_many_levels_of_one_score_are_chosen_alike(priority: str):
    """However steep the choice is: their weights are no smaller than that of a single one."""
    levels = LevelReplay("custom", prioritization=priority, temperature=0.02, staleness_coef=0.0, capacity=1 << 16)
    buffer = created(levels, NWORLD)
    buffer.value.fill_(1e-5)
    buffer.age.zero_()
    launch_refresh(buffer, levels)
    found = chosen(buffer, 4)
    assert found.min() >= 0
    assert len(np.unique(found)) > 0.97 * len(found)
    assert abs(found.mean() / (1 << 16) - 0.5) < 0.03


def test_the_lowest_scores_make_room():
    """A full buffer keeps the best of all that it was given, whatever the order; empty places are filled first."""
    levels, rng = LevelReplay("custom", capacity=64), np.random.default_rng(0)
    buffer = created(levels, 16)
    scores = rng.permutation(np.geomspace(0.001, 100.0, 640))
    for i, part in enumerate(np.split(np.arange(640), 40)):
        tell(buffer, np.full(16, -1), part, scores[part])
        launch_refresh(buffer, levels)
        assert (buffer.age.numpy() >= 0).sum() == min(16 * (i + 1), 64)
    best = np.argsort(scores)[::-1]
    assert set(best[:40]) <= set(buffer.seed.numpy().tolist())
    np.testing.assert_allclose(buffer.value.numpy(), scores[buffer.seed.numpy().astype(int)], rtol=1e-6)


SLIDE = "objects.cabinet.joints.slide"


class _Won(Reach):
    """Reach that is always a success, or never."""

    wins = True

    def success(self, s):
        """Say so."""
        return torch.full((s.num_envs,), self.wins, dtype=torch.bool)


def test_ranges_widen_with_success_and_narrow_with_failure(reach_scene):  # noqa: F811
    """Up to the scene file's interval and back to the start; layouts lie within, and a state is restored."""
    start = {SLIDE: [0.1, 0.11]}
    words = LevelReplay(replay_prob=0.0, adr=ADR(start, delta=0.25, boundary_fraction=1.0, queue_length=8))
    envs = SceneVectorEnv(_Won, 16, scene=reach_scene, max_episode_steps=1, curriculum=words)
    levels = envs.randomizer.levels
    assert levels is not None
    envs.reset(seed=1)
    widths = []
    for step in range(60):
        envs.task.wins = step < 30  # pyrefly: ignore[missing-attribute]
        envs.step(actions(16))
        low, high = levels.ranges[SLIDE]
        widths.append(round(float(high - low), 4))
    assert max(widths) == pytest.approx(0.12)
    assert widths[-1] == pytest.approx(0.01)
    assert widths[:30] == sorted(widths[:30])
    kept = levels.state()
    other = SceneVectorEnv(_Won, 16, scene=reach_scene, max_episode_steps=1, curriculum=words)
    other.reset(seed=9)
    resumed = other.randomizer.levels
    assert resumed is not None
    resumed.restore(kept)
    np.testing.assert_array_equal(resumed.ranges[SLIDE], levels.ranges[SLIDE])
    with pytest.raises(ArgumentError, match="delta should be above 0"):
        ADR(start, delta=0.0)


def test_a_snapshot_keeps_levels_and_the_ends_that_they_are_at(reach_scene):  # noqa: F811
    """So that a restored episode counts for the level and the end that it is of."""
    words = LevelReplay(
        replay_prob=0.5, refresh_interval=1, capacity=64, adr=ADR({SLIDE: [0.1, 0.11]}, boundary_fraction=0.8)
    )
    envs = SceneVectorEnv(_Won, 8, scene=reach_scene, max_episode_steps=1, curriculum=words)
    levels = envs.randomizer.levels
    assert levels is not None
    envs.reset(seed=1)
    for _ in range(8):
        info = envs.step(actions(8))[-1]
    kept, before = envs.snapshot(), levels.state()
    envs.step(actions(8))
    assert (levels.state()["boundary"] != before["boundary"]).any()
    restored = envs.reset(options={"state": kept})[1]
    assert restored["layout"]["level"].tolist() == info["layout"]["level"].tolist()
    assert levels.state()["boundary"].tolist() == before["boundary"].tolist()
