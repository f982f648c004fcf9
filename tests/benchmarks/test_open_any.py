"""Training on one unit and on eight."""

from __future__ import annotations

from pathlib import Path

import pytest

import sceniris_gym
from benchmarks.open_any import KINDS, scene_with
from sceniris_gym.config.scene import SceneConfig


@pytest.mark.parametrize("units", [1, 4])
def test_units_of_all_kinds_take_turns(tmp_path: Path, units: int):
    """The split `train` has as many units as asked for, first of the seed's kind, and `eval` is as it was."""
    sceniris_gym.furniture(tmp_path, 36, seed=1)
    group = SceneConfig.load("open_any", scene_with(64, 0, tmp_path)).groups["unit"]
    for seed in range(3):
        fewer = SceneConfig.load("open_any", scene_with(units, seed, tmp_path)).groups["unit"]
        left = [name for name, weight in zip(fewer.of, fewer.weights_in("train"), strict=True) if weight]
        assert len(left) == units
        assert {kind for kind in KINDS for name in left if kind in name} == set(KINDS if units == 4 else [KINDS[seed]])
        assert fewer.weights_in("eval") == group.weights_in("eval")
