"""Training on one thing and on eight."""

from __future__ import annotations

import pytest

from benchmarks.lift_any import ALONE, alone
from sceniris_gym.config.scene import SceneConfig


@pytest.mark.parametrize("thing", ALONE)
def test_one_thing_is_left_for_training(thing: str):
    """Alone in the split `train`; the split `eval` is as it was."""
    all_things = SceneConfig.load("tabletop_lift_any").groups["target"]
    group = SceneConfig.load("tabletop_lift_any", alone(thing)).groups["target"]
    left = [name for name, weight in zip(group.of, group.weights_in("train"), strict=True) if weight]
    assert left == [f"target/{thing}"]
    assert group.weights_in("eval") == all_things.weights_in("eval")
