"""The table of bounds: what is inside of them, and that no number of a scene file is without one."""

from __future__ import annotations

from typing import Any

import pytest

from sceniris_gym.config.bounds import BOUNDS, Bound
from sceniris_gym.errors import SceneKeyError
from tests.config.scenes import SMALL, refusal

HUGE: dict[str, Any] = {
    "floor.size": [1e300, 1],
    "robot.base": [0, 0, 1e300],
    "robot.yaw": 1e42,
    "objects.apple.gap": 1e300,
    "objects.apple.clearance": 1e300,
    "objects.apple.orientation": {"yaw": [0, 1e42]},
    "objects.apple.region": {"box": [[0, 0], [1, 1e30]]},
    "objects.apple.relations": [{"near": "shelf", "distance": {"max": 1e30}}],
    "objects.shelf.joints": {"*": {"range": [-1e30, 1e30]}},
    "objects.goal.region": {"box": [[0, 0, 0], [1, 1, 1e9]]},
}
MORE: dict[str, Any] = {
    "objects.apple.orientation": {"stable": {"yaw": [-1e42, 0]}},
    "objects.apple.region": {"polygon": [[0, 0], [1, 0], [0, 1e30]]},
    "objects.apple.relations": [{"direction": [1e300, 1], "of": "shelf"}],
    "objects.shelf.joints": {"*": {"value": -1e30}},
}
MOST: dict[str, Any] = {
    "objects.apple.relations": [{"beside": "shelf", "side": "left", "gap": 1e30}],
    "objects.shelf.joints": {"*": {"noise": 1e30}},
}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), 2.0, -1.1])
def test_what_is_outside_of_a_bound_is_not_inside(value: float):
    """Nan and infinity are not, either."""
    assert not Bound(-1.0, 1.0, "m").holds(value)


def test_ends_belong_to_a_bound():
    """And its advice names both."""
    bound = Bound(-1.0, 1.0, "m")
    assert bound.holds(-1.0)
    assert bound.holds(1.0)
    assert bound.advice == "should be from -1 to 1 m"
    assert all(bound.low < bound.high for bound in BOUNDS.values())


@pytest.mark.parametrize(("key", "value"), [*HUGE.items(), *MORE.items(), *MOST.items()], ids=[*HUGE, *MORE, *MOST])
def test_a_number_of_no_sense_is_refused_by_its_key(key: str, value: Any):
    """Each became a layout with infinite heights or quaternions of zeros, or could have."""
    robot = {"robot.asset": "panda"} if key.startswith("robot") else {}
    said = refusal(SMALL, {**robot, key: value}, SceneKeyError)
    assert f"scene: {key}" in said
    assert "should be from" in said
