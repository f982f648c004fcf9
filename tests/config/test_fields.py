"""The kinds of values: which are taken, and what is said of the others."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from sceniris_gym.config.bounds import MAX_POINTS
from sceniris_gym.config.fields import reading, where_now
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
        ["objects.cab/cup", "letters, digits", "write 'body: cab/cup'"],
    ),
    "taken name": (
        {"objects.floor": {"asset": "apple"}},
        SceneKeyError,
        ["objects.floor", "should not be floor, robot"],
    ),
    "an object named as a frame": (
        {"objects.support": {"asset": "mug"}},
        SceneKeyError,
        ["objects.support", "should not be floor, robot"],
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


def test_all_wrong_keys_are_told_at_once():
    """One message lists every problem of a scene, a line for each."""
    with pytest.raises(SceneKeyError) as caught:
        SceneConfig.load(SMALL, {"attempts": 0, "objects.apple.gap": -1, "objects.goal.knd": 1})
    assert len(str(caught.value).splitlines()) == 3


def test_the_word_on_read_as_true_by_another_loader_is_recognised():
    """A loader of YAML 1.1 turns the key `on` into true; the error says so."""
    with pytest.raises(SceneKeyError, match=r"objects\.a\.True.*YAML 1\.1"):
        SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"a": {"asset": "apple", True: "floor"}}})


def test_only_what_is_found_wrong_with_values_is_said_anew():
    """An error of another kind comes through a reading as it is."""
    problem = KeyError("mug")
    with pytest.raises(KeyError) as caught, reading("scene.yaml"):
        raise problem
    assert caught.value is problem


def test_what_is_read_is_known_inside_of_a_reading_alone():
    """The inner one of two, the outer one again after it, and none when both have failed."""

    def read_both() -> None:
        with contextlib.suppress(ValueError), reading("inner.yaml"):
            assert where_now.get() == "inner.yaml"
            raise ValueError
        assert where_now.get() == "outer.yaml"
        raise KeyError

    assert where_now.get() is None
    with pytest.raises(KeyError), reading("outer.yaml"):
        read_both()
    assert where_now.get() is None


def test_a_mistake_without_words_of_its_own_is_told_with_its_place():
    """By the path of the key, the value, and what pydantic says of it."""

    class Lamp(BaseModel):
        lit: list[bool]

    says = r"^lamp\.yaml: lit\.1: 'dim' is wrong: .*bool"
    with pytest.raises(SceneKeyError, match=says) as caught, reading("lamp.yaml"):
        Lamp.model_validate({"lit": [True, "dim"]})
    assert caught.value.__suppress_context__


def test_a_long_value_is_cut_off_in_a_message():
    """A message stays readable whatever was given; its beginning tells what it was."""
    said = refusal(SMALL, {"objects.apple.clearance": ["0123456789"] * 1000}, SceneKeyError)
    assert said.startswith("scene: objects.apple.clearance: ['0123456789', '0123")
    assert said.endswith("... should be a number.")
    assert len(said) < 150


def test_half_of_a_surrogate_pair_is_refused():
    """Pydantic cannot write it into an error, as a key or as a value."""
    for overrides in ({"\ud800": 1}, {"objects.apple.kind": "\ud800"}, {"objects.apple.\ud800": 1}):
        assert refusal(SMALL, overrides, SceneKeyError).startswith("scene: ")


def test_what_is_wrong_with_a_whole_scene_is_told_without_its_first_words():
    """They are the scene's name and floor, whatever is wrong."""
    words = {"robots": {"left": {"asset": "panda"}}, "objects": {"left": {"asset": "mug", "on": "floor"}}}
    with pytest.raises(SceneKeyError, match=r"scene: scene: it should have different names for robots and objects"):
        SceneConfig.load({"floor": {"size": [1, 1]}, **words})
