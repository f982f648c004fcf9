"""The buffer of levels: what is kept of them, and which ones worlds are given."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sceniris_gym.levels.buffer import arrays_of, launch_choose, launch_forget
from sceniris_gym.levels.curriculum import LevelReplay
from sceniris_gym.levels.refresh import launch_refresh
from tests.levels.filling import NWORLD, SCORES, chosen, column, created, filled, tell


def test_the_share_of_replays_is_the_one_asked_for():
    """The rest are fresh levels, each with a seed of its own; without any level in the buffer all are fresh."""
    levels = LevelReplay("custom", capacity=32)
    empty = created(levels, NWORLD)
    assert (chosen(empty, 2) == -1).all()
    buffer = filled(levels, SCORES)
    launch_forget(buffer, column(np.arange(NWORLD), wp.uint64), None)
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
    levels = LevelReplay("custom", capacity=32)
    whole, parts = filled(levels, SCORES), filled(levels, SCORES)
    mask = np.arange(NWORLD) % 3 == 0
    launch_forget(whole, column(np.arange(NWORLD), wp.uint64), None)
    launch_forget(parts, column(np.arange(NWORLD), wp.uint64), None)
    launch_choose(whole, None, 7, 0.5)
    for part in (~mask, mask):
        launch_choose(parts, column(part, bool), 7, 0.5)
    for name in ("next_level", "next_seed", "next_episode", "decision"):
        np.testing.assert_array_equal(getattr(whole, name).numpy(), getattr(parts, name).numpy(), err_msg=name)


@pytest.mark.parametrize(("score", "function"), [("learnability", lambda p: p * (1 - p)), ("failure", lambda p: 1 - p)])
def test_successes_move_a_rate(score: str, function):
    """It begins at 0.5; a level that another one has replaced is not touched by what comes late."""
    levels = LevelReplay(score, alpha=0.25, capacity=1)
    buffer = created(levels, 4)
    tell(buffer, [-1], [5], [1.0])
    assert buffer.value.numpy()[0] == pytest.approx(0.625)
    tell(buffer, [0], [5], [0.0])
    assert buffer.value.numpy()[0] == pytest.approx(0.46875)
    launch_refresh(buffer, levels)
    low = function(0.375) < function(0.46875)
    tell(buffer, [-1], [6], [0.0])  # a rate of 0.375
    assert buffer.seed.numpy()[0] == (5 if low else 6)
    before = buffer.value.numpy()[0]
    tell(buffer, [0], [99], [1.0])  # played level 0 when it had another seed: fresh by now, and there is no room
    assert buffer.value.numpy()[0] == before


def test_a_million_levels_take_little_memory():
    """At most 32 MB."""
    buffer = created(LevelReplay(capacity=1_000_000), 4096)
    assert sum(array.capacity for array in arrays_of(buffer).values()) <= 32e6
