"""The buffer of levels: what is kept, and how often each level is chosen, against the formulas in double precision."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from scipy.stats import chisquare, rankdata

from sceniris_gym.levels.buffer import (
    Buffer,
    create_buffer,
    launch_choose,
    launch_forget,
    launch_refresh,
    launch_update,
)
from sceniris_gym.levels.choice import Levels

NWORLD = 500
CPU = wp.get_device("cpu")


def _column(values: object, dtype: type) -> wp.array:
    return wp.array(np.asarray(values), dtype=dtype, device="cpu")


def _tell(buffer: Buffer, level: object, seed: object, outcome: object) -> None:
    episodes = np.zeros(len(np.asarray(seed)))
    columns = _column(level, int), _column(seed, wp.uint64), _column(episodes, int), _column(outcome, float)
    launch_update(buffer, *columns, None)


def _filled(levels: Levels, scores: np.ndarray) -> Buffer:
    """A buffer of one level for each score, with seeds 100, 101, ..."""
    buffer = create_buffer(levels, NWORLD, CPU)
    _tell(buffer, np.full(len(scores), -1), 100 + np.arange(len(scores)), scores)
    launch_refresh(buffer, levels)
    return buffer


def _chosen(buffer: Buffer, rounds: int) -> np.ndarray:
    """The levels that worlds are given, -1 for fresh ones, shape (rounds * nworld,)."""
    launch_forget(buffer, _column(np.arange(NWORLD), wp.uint64), None)
    found = []
    for _ in range(rounds):
        launch_choose(buffer, None, 7, 1.0)
        found.append(buffer.next_level.numpy().copy())
    return np.concatenate(found)


SCORES = np.array([0.5, 0.02, 0.02, 3.0, 0.9, 0.0001, 1.7, 0.3])


@pytest.mark.parametrize("staleness", [0.0, 0.4])
@pytest.mark.parametrize("priority", ["rank", "proportional", "uniform"])
def test_levels_are_chosen_by_their_weights(priority: str, staleness: float):
    """rank^(-1/T) or score^(1/T), and a share by the time since a level was chosen last; p > 0.001."""
    levels = Levels("given", priority=priority, temperature=0.7, staleness=staleness, capacity=32)
    buffer = _filled(levels, SCORES)
    ages = np.arange(len(SCORES))
    stamp = buffer.stamp.numpy().copy()
    stamp[: len(SCORES)] = 10 - ages
    buffer.stamp.assign(stamp)
    buffer.resets.assign([10])
    launch_refresh(buffer, levels)
    weights = {
        "rank": rankdata(-SCORES) ** (-1 / 0.7),
        "proportional": SCORES ** (1 / 0.7),
        "uniform": np.ones(len(SCORES)),
    }[priority]
    share = (1 - staleness) * weights / weights.sum() + staleness * ages / ages.sum()
    found = np.bincount(_chosen(buffer, 40), minlength=len(SCORES))
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


def test_the_share_of_replays_is_the_one_asked_for():
    """The rest are fresh levels, each with a seed of its own; without any level in the buffer all are fresh."""
    levels = Levels("given", capacity=32)
    empty = create_buffer(levels, NWORLD, CPU)
    assert (_chosen(empty, 2) == -1).all()
    buffer = _filled(levels, SCORES)
    launch_forget(buffer, _column(np.arange(NWORLD), wp.uint64), None)
    replayed, seeds = 0, []
    for _ in range(20):
        launch_choose(buffer, None, 7, 0.3)
        fresh = buffer.next_level.numpy() < 0
        replayed += int((~fresh).sum())
        seeds.append(buffer.next_seed.numpy()[fresh])
        assert set(buffer.next_seed.numpy()[~fresh]) <= set(range(100, 108))
    assert abs(replayed / (20 * NWORLD) - 0.3) < 0.02
    fresh = np.concatenate(seeds)
    assert len(np.unique(fresh)) == len(fresh)


def test_choices_do_not_depend_on_which_worlds_choose_beside_them():
    """World by world: the same levels with a mask, in any order of masks."""
    levels = Levels("given", capacity=32)
    whole, parts = _filled(levels, SCORES), _filled(levels, SCORES)
    mask = np.arange(NWORLD) % 3 == 0
    launch_forget(whole, _column(np.arange(NWORLD), wp.uint64), None)
    launch_forget(parts, _column(np.arange(NWORLD), wp.uint64), None)
    launch_choose(whole, None, 7, 0.5)
    for part in (~mask, mask):
        launch_choose(parts, _column(part, bool), 7, 0.5)
    for name in ("next_level", "next_seed", "next_episode", "decision"):
        np.testing.assert_array_equal(getattr(whole, name).numpy(), getattr(parts, name).numpy(), err_msg=name)


@pytest.mark.parametrize(("score", "function"), [("learnability", lambda p: p * (1 - p)), ("failure", lambda p: 1 - p)])
def test_successes_move_a_rate(score: str, function):
    """It begins at 0.5; a level that another one has replaced is not touched by what comes late."""
    levels = Levels(score, rate=0.25, capacity=1)
    buffer = create_buffer(levels, 4, CPU)
    _tell(buffer, [-1], [5], [1.0])
    assert buffer.value.numpy()[0] == pytest.approx(0.625)
    _tell(buffer, [0], [5], [0.0])
    assert buffer.value.numpy()[0] == pytest.approx(0.46875)
    launch_refresh(buffer, levels)
    low = function(0.375) < function(0.46875)
    _tell(buffer, [-1], [6], [0.0])  # a rate of 0.375
    assert buffer.seed.numpy()[0] == (5 if low else 6)
    before = buffer.value.numpy()[0]
    _tell(buffer, [0], [99], [1.0])  # played level 0 when it had another seed: fresh by now, and there is no room
    assert buffer.value.numpy()[0] == before


def test_the_lowest_scores_make_room():
    """A full buffer keeps the best of all that it was given, whatever the order; empty places are filled first."""
    levels, rng = Levels("given", capacity=64), np.random.default_rng(0)
    buffer = create_buffer(levels, 16, CPU)
    scores = rng.permutation(np.geomspace(0.001, 100.0, 640))
    for i, part in enumerate(np.split(np.arange(640), 40)):
        _tell(buffer, np.full(16, -1), part, scores[part])
        launch_refresh(buffer, levels)
        assert (buffer.stamp.numpy() >= 0).sum() == min(16 * (i + 1), 64)
    best = np.argsort(scores)[::-1]
    assert set(best[:40]) <= set(buffer.seed.numpy().tolist())
    np.testing.assert_allclose(buffer.value.numpy(), scores[buffer.seed.numpy().astype(int)], rtol=1e-6)


def test_a_million_levels_take_little_memory():
    """At most 32 MB."""
    buffer = create_buffer(Levels(capacity=1_000_000), 4096, CPU)
    arrays = [getattr(buffer, name) for name in Buffer.vars]
    assert sum(a.capacity for a in arrays if isinstance(a, wp.array)) <= 32e6
