"""Intervals of knobs that follow success."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError
from sceniris_gym.levels import Levels, Ranges
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach, reach_scene  # noqa: F401, a fixture
from tests.vector.stepping import actions

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
    words = Levels(replay=0.0, ranges=Ranges(start, step=0.25, probe=1.0, episodes=8))
    envs = SceneVectorEnv(_Won, 16, scene=reach_scene, max_episode_steps=1, levels=words)
    levels = envs.randomizer.levels
    assert levels is not None
    envs.reset(seed=1)
    widths = []
    for step in range(60):
        envs.task.wins = step < 30  # type: ignore[attr-defined]
        envs.step(actions(16))
        low, high = levels.ranges[SLIDE]
        widths.append(round(float(high - low), 4))
    assert max(widths) == pytest.approx(0.12)
    assert widths[-1] == pytest.approx(0.01)
    assert widths[:30] == sorted(widths[:30])
    kept = levels.state()
    other = SceneVectorEnv(_Won, 16, scene=reach_scene, max_episode_steps=1, levels=words)
    other.reset(seed=9)
    resumed = other.randomizer.levels
    assert resumed is not None
    resumed.restore(kept)
    np.testing.assert_array_equal(resumed.ranges[SLIDE], levels.ranges[SLIDE])
    with pytest.raises(ArgumentError, match="step should be above 0"):
        Ranges(start, step=0.0)


def test_a_snapshot_keeps_levels_and_the_ends_that_they_are_at(reach_scene):  # noqa: F811
    """So that a restored episode counts for the level and the end that it is of."""
    words = Levels(replay=0.5, every=1, capacity=64, ranges=Ranges({SLIDE: [0.1, 0.11]}, probe=0.8))
    envs = SceneVectorEnv(_Won, 8, scene=reach_scene, max_episode_steps=1, levels=words)
    levels = envs.randomizer.levels
    assert levels is not None
    envs.reset(seed=1)
    for _ in range(8):
        info = envs.step(actions(8))[-1]
    kept, before = envs.snapshot(), levels.state()
    envs.step(actions(8))
    assert (levels.state()["probe"] != before["probe"]).any()
    restored = envs.reset(options={"state": kept})[1]
    assert restored["layout_level"].tolist() == info["layout_level"].tolist()
    assert levels.state()["probe"].tolist() == before["probe"].tolist()
