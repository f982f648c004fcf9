"""Weights of levels against the formulas in double precision, and the places that are given to others."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chisquare, rankdata

from sceniris_gym.levels.choice import Levels
from sceniris_gym.levels.weights import launch_refresh
from tests.levels.filling import NWORLD, SCORES, chosen, created, filled, tell


@pytest.mark.parametrize("staleness", [0.0, 0.4])
@pytest.mark.parametrize("priority", ["rank", "proportional", "uniform"])
def test_levels_are_chosen_by_their_weights(priority: str, staleness: float):
    """rank^(-1/T) or score^(1/T), and a share by the time since a level was chosen last; p > 0.001."""
    levels = Levels("given", priority=priority, temperature=0.7, staleness=staleness, capacity=32)
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
    levels = Levels("given", priority=priority, temperature=0.02, staleness=0.0, capacity=1 << 16)
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
    levels, rng = Levels("given", capacity=64), np.random.default_rng(0)
    buffer = created(levels, 16)
    scores = rng.permutation(np.geomspace(0.001, 100.0, 640))
    for i, part in enumerate(np.split(np.arange(640), 40)):
        tell(buffer, np.full(16, -1), part, scores[part])
        launch_refresh(buffer, levels)
        assert (buffer.age.numpy() >= 0).sum() == min(16 * (i + 1), 64)
    best = np.argsort(scores)[::-1]
    assert set(best[:40]) <= set(buffer.seed.numpy().tolist())
    np.testing.assert_allclose(buffer.value.numpy(), scores[buffer.seed.numpy().astype(int)], rtol=1e-6)
