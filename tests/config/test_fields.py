"""The kinds of values: which are taken, and what is said of the others."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.bounds import MAX_POINTS
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import Floor
from sceniris_gym.errors import SceneKeyError, ScenirisError
from tests.config.scenes import SMALL, refusal, refused

WRONG: dict[str, tuple] = {
    "negative": ({"objects.apple.clearance": -1}, SceneKeyError, ["objects.apple.clearance: -1", "at least 0"]),
    "bool for number": ({"objects.apple.gap": True}, SceneKeyError, ["objects.apple.gap: True", "a number"]),
    "text for number": ({"objects.apple.gap": "1"}, SceneKeyError, ["objects.apple.gap: '1'", "a number"]),
    "not finite": ({"objects.apple.gap": math.inf}, SceneKeyError, ["objects.apple.gap", "finite"]),
    "yaw upside down": ({"objects.apple.orientation.yaw": [9, -9]}, SceneKeyError, ["orientation.yaw", "low <= high"]),
    "fraction above one": (
        {"objects.apple.region.fraction": [[0, 0], [1, 2]]},
        SceneKeyError,
        ["objects.apple.region.fraction.1.1: 2", "at most 1"],
    ),
    "box upside down": (
        {"objects.apple.region.box": [[1, 1], [0, 0]]},
        SceneKeyError,
        ["region.box", "low corner"],
    ),
    "crossing polygon": (
        {"objects.apple.region.polygon": [[0, 0], [1, 1], [1, 0], [0, 1]]},
        SceneKeyError,
        ["region.polygon", "edges do not cross"],
    ),
    "no points": ({"objects.apple.region.points": []}, SceneKeyError, ["region.points", "should be 1 to 4,096 points"]),
    "points of several dimensions": (
        {"objects.apple.region.points": [[0, 0], [0, 0, 0]]},
        SceneKeyError,
        ["region.points", "all of them [x, y] or all of them [x, y, z]"],
    ),
    "points on a line": ({"objects.apple.region.points": [[0], [1]]}, SceneKeyError, ["region.points", "[x, y]"]),
    "a point that is a number": (
        {"objects.apple.region.points": [0.1, 0.2]},
        SceneKeyError,
        ["objects.apple.region.points.0", "list"],
    ),
    "more points than there is room for": (
        {"objects.apple.region.points": [[0, 0]] * (MAX_POINTS + 1)},
        SceneKeyError,
        ["region.points", f"should be 1 to {MAX_POINTS:,} points"],
    ),
    "a point too far away": (
        {"objects.goal.region": {"points": [[0, 0, 0], [0, 0, 101]]}},
        SceneKeyError,
        ["objects.goal.region.points.1.2: 101", "from -100 to 100 m"],
    ),
    "unknown tier": (
        {"objects.apple.reachable": "map_stric"},
        SceneKeyError,
        [
            "objects.apple.reachable: 'map_stric'",
            "true, false, or one of map, map_strict, ik, clear",
            "mean 'map_strict'",
        ],
    ),
    "short floor": ({"floor.size": [1]}, SceneKeyError, ["floor.size.1", "missing"]),
    "long floor": ({"floor.size": [1, 1, 1]}, SceneKeyError, ["floor.size", "2 values"]),
    "empty floor": ({"floor.size": [0, 1]}, SceneKeyError, ["floor.size.0: 0", "above 0"]),
    "endless floor": ({"floor.size": [1, 201]}, SceneKeyError, ["floor.size.1: 201", "to 200 m"]),
    "bad name": ({"objects.an apple": {"asset": "apple"}}, SceneKeyError, ["an apple", "letters, digits"]),
    "name of an attached body": (
        {"objects.cab/cup": {"on": "floor"}},
        SceneKeyError,
        ["objects.cab/cup", "letters, digits", "can be the body 'cab/cup', by 'body'"],
    ),
    "taken name": (
        {"objects.floor": {"asset": "apple"}},
        SceneKeyError,
        ["objects.floor", "should be a different name"],
    ),
    "an object named as a frame": (
        {"objects.support": {"asset": "mug"}},
        SceneKeyError,
        ["objects.support", "should be a different name"],
    ),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_value_is_refused_by_its_path_and_with_what_is_right(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Numbers, intervals, boxes, polygons, sizes, names and tiers."""
    refused(tmp_path, SMALL, overrides, error, says)


@pytest.mark.parametrize("size", [[1, 2], (1.0, 2.0), np.array([1.0, 2.0]), np.array([1, 2])], ids=repr)
def test_any_sequence_of_numbers_is_a_list(size: Any):
    """Lists, tuples and NumPy's arrays, of whole numbers too."""
    assert Floor(size=size).size == (1.0, 2.0)


@pytest.mark.parametrize("size", ["12", b"12", {"x": 1, "y": 2}, 1.0], ids=repr)
def test_what_has_no_order_is_no_list(size: Any):
    """Texts, bytes, mappings and single numbers."""
    with pytest.raises(SceneKeyError, match=r"size: .* should be a list"):
        Floor(size=size)


@pytest.mark.parametrize("polygon", [[[0, 0], [1, 1]], [[0, 0], [1, 1], [2, 2]], [[0, 0], [1, 0], [1, 0]]], ids=str)
def test_a_polygon_without_an_area_is_refused(polygon: list):
    """Two corners, corners on a line, and a corner given twice."""
    assert "at least three corners" in refusal(SMALL, {"objects.apple.region.polygon": polygon}, SceneKeyError)


def test_a_polygon_goes_either_way_round_and_may_be_hollow():
    """Clockwise or not; an inward corner is no crossing."""
    arrow = [[0, 0], [2, 0], [1, 0.5], [1, 2]]
    for polygon in (arrow, arrow[::-1]):
        region = SceneConfig.load(SMALL, {"objects.apple.region.polygon": polygon}).objects["apple"].region
        assert region is not None
        assert region.polygon == tuple(map(tuple, polygon))


def test_a_gap_is_more_than_rounding():
    """Nearer than 0.02 mm counts as touching, so an object would be rejected at every draw."""
    assert SceneConfig.load(SMALL, {"objects.apple.gap": 2e-5}).objects["apple"].gap == 2e-5
    assert "at least 0.00002 m" in refusal(SMALL, {"objects.apple.gap": 1.9e-5}, SceneKeyError)


@pytest.mark.parametrize(
    ("name", "taken"), [("a", True), ("_mug-2", True), ("2mugs", False), ("a/b", False), ("a.b", False), ("", False)]
)
def test_a_name_is_one_that_models_and_dotted_keys_can_hold(name: str, taken: bool):
    """Letters, digits, '_' and '-', with no digit at its head and no '/' or '.' in it."""
    scene = {"objects": {name: {"asset": "mug", "kind": "static"}}}
    if taken:
        assert list(SceneConfig.load(scene).objects) == [name]
    else:
        assert "letters, digits" in refusal(scene, {}, SceneKeyError)
