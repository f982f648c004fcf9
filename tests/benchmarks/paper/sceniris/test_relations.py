"""Constraints of the original package's configurations: which relation each becomes."""

from __future__ import annotations

import math
import pickle
import re
import warnings
from typing import Any

import numpy as np
import pytest

from benchmarks.paper.sceniris.reader import read_sceniris
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from tests.benchmarks.paper.sceniris.configurations import ONE, QUARTER_TURN, mug, read, relation


def test_the_default_frame_is_the_support_s():
    """The original turns a direction with the support unless it is told otherwise, and so does what is read."""
    found = relation({"anchor_object_ids": ["drawer"], "direction": "front"})
    assert (found.word, found.anchors, found.reference_frame) == ("front_of", ("drawer",), "support")
    assert (found.heading(()), found.half_angle) == pytest.approx((-math.pi / 2, math.pi / 2))
    assert (found.low, found.high, found.by_bounds) == (0.0, math.inf, False)


@pytest.mark.parametrize(
    ("transform", "frame", "heading"),
    [
        ("drawer", "drawer", 0.0),
        ("apple", "apple", 0.0),
        ("world", "world", 0.0),
        (None, "support", 0.0),
        (np.eye(4), "support", 0.0),
        (QUARTER_TURN, "support", math.pi / 2),
        (QUARTER_TURN[:3, :3].tolist(), "support", math.pi / 2),
        ("arm", "world", math.pi / 2),
    ],
)
def test_a_frame_turns_the_direction(transform: Any, frame: str, heading: float):
    """Objects, the world, robots' views and matrices; the right of a quarter turn to the left is the back."""
    for direction in ("right", "x", [1.0, 0.0], np.array([2.0, 0.0])):
        constraint = {"anchor_object_ids": ["drawer"], "direction": direction, "relation_axis_transform": transform}
        cfg = mug(constraints=[constraint]) | {"env": {"robot_centric_axis_transforms": {"arm": QUARTER_TURN}}}
        config, left_out = read(cfg)
        (found,) = config.objects["mug"].relations
        assert left_out == []
        assert found.reference_frame == frame
        assert found.heading(()) == pytest.approx(heading)


@pytest.mark.parametrize(
    ("direction", "heading"),
    [("left", math.pi), ("-x", math.pi), ("Back", math.pi / 2), ("y", math.pi / 2), ("-y", -math.pi / 2)],
)
def test_sides_and_axes_are_directions(direction: str, heading: float):
    """Left, right, front and back are -x, x, -y and y."""
    found = relation({"anchor_object_ids": ["drawer"], "direction": direction, "direction_tolerance_angle": 10})
    assert found.heading(()) == pytest.approx(heading)
    assert found.half_angle == pytest.approx(math.radians(10))


@pytest.mark.parametrize("direction", ["right", None])
@pytest.mark.parametrize(
    ("distance", "low", "high"),
    [
        ({"distance_type": "greater"}, 0.4, math.inf),
        ({"distance_type": "less"}, 0.0, 0.4),
        ({"distance_type": "equal"}, 0.39, 0.41),
        ({}, 0.39, 0.41),
        ({"distance_type": "equal", "distance_relax": 0.1}, 0.3, 0.5),
    ],
)
def test_a_distance_is_a_limit_or_a_band(direction: str | None, distance: dict, low: float, high: float):
    """At least, at most, or about d away, in a direction or all around."""
    found = relation({"anchor_object_ids": ["drawer"], "direction": direction, "distance": 0.4, **distance})
    assert (found.low, found.high) == pytest.approx((low, high))
    assert found.half_angle == pytest.approx(math.pi if direction is None else math.pi / 2)
    assert found.anchors == ("drawer",)


def test_a_distance_from_bounds_is_measured_between_bounds():
    """`distance_start_bbox`, with and without a distance."""
    bounds = {"anchor_object_ids": ["drawer"], "direction": "left", "distance_start_bbox": True}
    assert relation(bounds | {"distance": 0.3, "distance_type": "less"}).by_bounds
    assert relation(bounds).low == pytest.approx(0.01)
    assert not relation(bounds | {"distance_start_bbox": False, "max_mesh_projection_z": 0.5}).by_bounds


@pytest.mark.parametrize("keys", [{"direction": "middle"}, {"distance_type": "middle"}, {}])
def test_several_anchors_are_between(keys: dict):
    """In all the ways in which the original says it."""
    found = relation({"anchor_object_ids": ["drawer", "apple"], "direction_tolerance_angle": 10, **keys})
    assert (found.word, found.anchors) == ("between", ("drawer", "apple"))


LEFT_OUT: dict[str, tuple] = {
    "another support for a constraint": (
        {"constraints": [{"anchor_object_ids": ["apple"], "direction": "left", "base_support_id": "x"}]},
        ["objects.mug.constraints.0.base_support_id"],
    ),
    "the height of what is measured": (
        {
            "constraints": [
                {
                    "anchor_object_ids": ["apple"],
                    "direction": "left",
                    "distance_start_bbox": True,
                    "max_mesh_projection_z": 0.1,
                }
            ]
        },
        ["objects.mug.constraints.0.max_mesh_projection_z"],
    ),
    "bounds of what is around": (
        {"constraints": [{"anchor_object_ids": ["apple", "drawer"], "distance_start_bbox": True}]},
        ["objects.mug.constraints.0.distance_start_bbox"],
    ),
    "a direction from several": (
        {"constraints": [{"anchor_object_ids": ["apple", "drawer"], "direction": "left"}]},
        ["objects.mug.constraints.0"],
    ),
    "no anchors": ({"constraints": [{"anchor_object_ids": None, "direction": "left"}]}, ["objects.mug.constraints.0"]),
    "next to": (
        {"constraints": [{"anchor_object_ids": ["apple"], "direction": "next_to"}]},
        ["objects.mug.constraints.0"],
    ),
    "a distance of next to": (
        {"constraints": [{"anchor_object_ids": ["apple"], "direction": "left", "distance": "next_to"}]},
        ["objects.mug.constraints.0.distance"],
    ),
    "neither direction nor distance": (
        {"constraints": [{"anchor_object_ids": ["apple"]}]},
        ["objects.mug.constraints.0"],
    ),
}


@pytest.mark.parametrize(("keys", "left_out"), LEFT_OUT.values(), ids=LEFT_OUT.keys())
def test_a_constraint_that_cannot_be_carried_over_is_listed_by_its_key(keys: dict, left_out: list[str]):
    """The whole of it, or what of it has no meaning here."""
    config, found = read(mug(**keys))
    assert found == left_out
    assert list(config.objects) == ["mug", "drawer", "apple"]


CHANGED: dict[str, tuple] = {
    "the middle of two": ({"direction": "middle"}, 2, {"direction": "a strip .*, a rectangle"}),
    "the middle of two as a distance": ({"distance_type": "middle"}, 2, {"distance_type": "a strip"}),
    "two anchors alone": ({}, 2, {"anchor_object_ids": "a strip"}),
    "a distance from bounds": (
        {"direction": "left", "distance": 0.3, "distance_start_bbox": True},
        1,
        {"distance_start_bbox": "between the bounds of both here"},
    ),
    "a frame that is no anchor": (
        {"direction": "left", "relation_axis_transform": "apple"},
        1,
        {"relation_axis_transform": "with 'apple' here, with the support in the original"},
    ),
    "a frame that is the anchor": ({"direction": "left", "relation_axis_transform": "drawer"}, 1, {}),
    "the middle of three": ({"direction": "middle"}, 3, {}),
}


@pytest.mark.parametrize(("keys", "anchors", "changed"), CHANGED.values(), ids=CHANGED.keys())
def test_what_means_another_thing_is_told_by_its_key(keys: dict, anchors: int, changed: dict[str, str]):
    """The warning says what it means here and what it meant there; nothing is said of the rest."""
    cfg = mug(constraints=[{"anchor_object_ids": ["drawer", "apple", "pear"][:anchors], **keys}])
    cfg["objects"].append({"id": "pear", "asset_path": "pear"})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_sceniris(cfg)
    found = {path: meaning for w in caught for path, meaning in getattr(w.message, "changed", {}).items()}
    assert list(found) == [f"objects.mug.constraints.0.{key}" for key in changed]
    for (path, meaning), says in zip(found.items(), changed.values(), strict=True):
        assert re.search(says, meaning)
        assert f"{path} ({meaning})" in str(caught[0].message)
        assert pickle.loads(pickle.dumps(caught[0].message)).changed == found


WRONG: dict[str, tuple] = {
    "an unknown anchor": (
        mug(constraints=[{"anchor_object_ids": ["aple"]}]),
        UnknownNameError,
        r"mug\.constraints\.0\.anchor_object_ids: unknown object 'aple'.*mean 'apple'",
    ),
    "an anchor of another kind": (
        mug(constraints=[{"anchor_object_ids": [["apple"]]}]),
        UnknownNameError,
        "unknown object",
    ),
    "anchors as a text": (
        mug(constraints=[{"anchor_object_ids": "apple"}]),
        SceneKeyError,
        "'apple' should be a list",
    ),
    "the middle of one": (
        mug(constraints=[{**ONE, "direction": "middle"}]),
        SceneKeyError,
        "two objects or more for 'middle'",
    ),
    "an unknown direction": (
        mug(constraints=[{**ONE, "direction": "lefft"}]),
        UnknownNameError,
        r"direction: unknown direction 'lefft'\. Did you mean 'left'",
    ),
    "a direction in space": (
        mug(constraints=[{**ONE, "direction": [0, 0, 1]}]),
        SceneKeyError,
        r"constraints\.0\.direction: \[0, 0, 1\] should be \[x, y\]",
    ),
    "an unknown frame": (
        mug(constraints=[{**ONE, "direction": "left", "relation_axis_transform": "wrld"}]),
        UnknownNameError,
        "unknown frame 'wrld'.*mean 'world'",
    ),
    "an unknown type of distance": (
        mug(constraints=[{**ONE, "distance": 1.0, "distance_type": "lesss"}]),
        UnknownNameError,
        "unknown distance type 'lesss'.*mean 'less'",
    ),
}


@pytest.mark.parametrize(("cfg", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_constraint_is_refused_by_its_key(cfg: dict, error: type[ScenirisError], says: str):
    """With what it should be, or the nearest name that there is."""
    with pytest.raises(error, match=says):
        read_sceniris(cfg)
