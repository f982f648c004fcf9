"""Objects in scene files: which words go together, and what an object refers to."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError
from tests.config.scenes import NEAR, NEIGHBOURS, SMALL, refused, related


def test_what_an_object_needs_is_placed_before_it():
    """Its support's object, anchors, frames and target, each once, without the floor."""
    config = related(
        {"between": ["mug", "post"]},
        {"left_of": "cabinet", "frame": "goal"},
        **{"objects.apple.on": "cabinet/upper_drawer", "objects.apple.orientation": {"face_to": "mug"}},
    )
    assert config.objects["apple"].needs == ("cabinet", "mug", "post", "goal")
    assert config.objects["mug"].needs == ("cabinet",)
    assert config.objects["cabinet"].needs == ()


WRONG: dict[str, tuple] = {
    "bool for word": ({"objects.apple.on": True}, SceneKeyError, ["objects.apple.on: True", "a name"]),
    "unknown kind": ({"objects.apple.kind": "fre"}, SceneKeyError, ["objects.apple.kind", "Did you mean 'free'"]),
    "two supports": (
        {"objects.apple": {"asset": "apple", "on": "floor", "in": "shelf"}},
        SceneKeyError,
        ["objects.apple:", "has on and in"],
    ),
    "static on something": ({"objects.apple.kind": "static"}, SceneKeyError, ["objects.apple:", "never move"]),
    "two forms of region": (
        {"objects.apple.region": {"box": [[0, 0], [1, 1]], "fraction": [[0, 0], [1, 1]]}},
        SceneKeyError,
        ["objects.apple.region", "exactly one of box, fraction, polygon"],
    ),
    "points beside a box": (
        {"objects.apple.region": {"box": [[0, 0], [1, 1]], "points": [[0, 0]]}},
        SceneKeyError,
        ["objects.apple.region", "exactly one of box, fraction, polygon, points"],
    ),
    "3D points on a support": (
        {"objects.apple.region.points": [[0, 0, 1]]},
        SceneKeyError,
        ["objects.apple:", "3D points are only for objects without a support"],
    ),
    "2D points without support": (
        {"objects.goal.region.points": [[0, 0], [1, 1]]},
        SceneKeyError,
        ["objects.goal:", "should have a support", "3D points"],
    ),
    "3D box on a support": (
        {"objects.apple.region.box": [[0, 0, 0], [1, 1, 1]]},
        SceneKeyError,
        ["objects.apple:", "2D region"],
    ),
    "2D box without support": (
        {"objects.goal.region.box": [[0, 0], [1, 1]]},
        SceneKeyError,
        ["objects.goal:", "should have a support"],
    ),
    "3D box too far away": (
        {"objects.goal.region.box": [[0, 0, 0], [1, 101, 1]]},
        SceneKeyError,
        ["objects.goal.region.box.1.1: 101", "from -100 to 100 m"],
    ),
    "ratio of a support that is not there": (
        {"objects.goal.ratio_on_support": 0.5},
        SceneKeyError,
        ["objects.goal:", "a 'ratio_on_support' only with a support"],
    ),
    "joint without a word": ({"objects.apple.joints.a": {}}, SceneKeyError, ["objects.apple.joints.a", "has none"]),
    "joint with two words": (
        {"objects.apple.joints.a": {"value": 1, "noise": 1}},
        SceneKeyError,
        ["objects.apple.joints.a", "has value and noise"],
    ),
    "between": (
        {"objects.apple.between": ["goal"]},
        SceneKeyError,
        ["objects.apple.between", "given in 'relations'"],
    ),
    "front_of": (
        {"objects.apple.front_of": "shelf"},
        SceneKeyError,
        ["objects.apple.front_of", "given in 'relations'"],
    ),
    "reachable static": (
        {"objects.post": {"asset": "cabinet", "kind": "static", "reachable": True}},
        SceneKeyError,
        ["objects.post", "should have a support"],
    ),
    "by without reachable": (
        {"objects.apple.by": "robot"},
        SceneKeyError,
        ["objects.apple", "'by' only together with 'reachable'"],
    ),
    "reachable with an unknown word": (
        {"objects.apple.reachable": {"teir": "ik"}},
        SceneKeyError,
        [
            "objects.apple",
            "should have only the keys tier, by, grasp, firm, margin in 'reachable'",
            "Did you mean 'tier'",
        ],
    ),
    "firm without reachable": (
        {"objects.apple.firm": True},
        SceneKeyError,
        ["objects.apple", "'firm' only together with 'reachable'"],
    ),
    "firm misspelt": (
        {"objects.apple.reachable": {"tier": "ik", "frim": True}},
        SceneKeyError,
        ["objects.apple", "Did you mean 'firm'"],
    ),
    "firm that is no boolean": (
        {"objects.apple.reachable": "ik", "objects.apple.firm": "very"},
        SceneKeyError,
        ["objects.apple.firm", "very"],
    ),
    "firm of what no hand lifts": (
        {"objects.apple.kind": "fixture", "objects.apple.reachable": "ik", "objects.apple.firm": True},
        SceneKeyError,
        ["objects.apple", "'firm' only if its kind is 'free'"],
    ),
    "by twice": (
        {"objects.apple.reachable": {"by": "robot"}, "objects.apple.by": "robot"},
        SceneKeyError,
        ["objects.apple", "should have 'by' only once"],
    ),
    "grasp without reachable": (
        {"objects.apple.grasp": "top*"},
        SceneKeyError,
        ["objects.apple", "'grasp' only together with 'reachable'"],
    ),
    "by another": (
        {"objects.apple.reachable": True, "objects.apple.by": "shelf"},
        SceneKeyError,
        ["objects.apple.reachable", "the scene has no robot"],
    ),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_words_of_an_object_that_do_not_go_together_are_refused(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Supports, regions, joints, kinds, and words that belong somewhere else."""
    refused(tmp_path, SMALL, overrides, error, says)


WRONG_RELATIONS: dict[str, tuple] = {
    "a word beside relations": (
        {"objects.apple.near": "mug"},
        SceneKeyError,
        ["objects.apple.near", "given in 'relations'"],
    ),
    "relations of a static object": (
        {"objects.post.relations": [{"front_of": "mug"}]},
        SceneKeyError,
        ["objects.post:", "'static' objects never move"],
    ),
    "relations of what is not placed": (
        {"objects.goal": {"kind": "marker", "on": None, "relations": [NEAR]}},
        SceneKeyError,
        ["objects.goal:", "should have a support", "or a 3D region (box or points), because it has relations"],
    ),
    "the support's frame without a support": (
        {
            "objects.goal": {
                "kind": "marker",
                "on": None,
                "region": {"box": [[0, 0, 0], [1, 1, 1]]},
                "relations": [{"left_of": "mug", "frame": "support"}],
            }
        },
        SceneKeyError,
        ["objects.goal:", "should name its support", "a relation has 'frame: support'"],
    ),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG_RELATIONS.values(), ids=WRONG_RELATIONS.keys())
def test_relations_that_an_object_cannot_have_are_refused(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Of what is not placed, or has no support whose frame they could be in."""
    refused(tmp_path, NEIGHBOURS, overrides, error, says)


@pytest.mark.parametrize(
    ("words", "placed"),
    [
        ({"on": "floor"}, True),
        ({"region": {"box": [[0, 0, 0], [1, 1, 1]]}}, True),
        ({"kind": "fixture", "inside": "floor"}, True),
        ({}, False),
        ({"kind": "static"}, False),
    ],
    ids=str,
)
def test_an_object_is_placed_where_the_scene_says_so(words: dict, placed: bool):
    """On a support or in a box in space; else it stays where the model has it."""
    assert ObjectConfig.model_validate({"asset": "mug", **words}).is_placed == placed


def test_references_name_the_key_that_each_stands_at():
    """In the order of the file, with the path that a message about one of them needs."""
    part = ObjectConfig.model_validate(
        {
            "on": "table",
            "relations": [
                {"direction": [1, 0], "of": "mug", "frame": "can"},
                {"between": ["mug", "bowl"]},
                {"left_of": "can", "frame": "world"},
            ],
            "orientation": {"face_to": "bowl"},
        }
    )
    assert part.references == [
        ("relations.0.of", "mug"),
        ("relations.0.frame", "can"),
        ("relations.1.between", "mug"),
        ("relations.1.between", "bowl"),
        ("relations.2.left_of", "can"),
        ("orientation.face_to", "bowl"),
    ]
    assert part.needs == ("table", "mug", "can", "bowl")


def test_a_box_in_space_is_as_large_as_single_precision_allows():
    """100 m from the origin along each axis is taken on either side."""
    box = [[-100, -100, -100], [100, 100, 100]]
    region = SceneConfig.load(SMALL, {"objects.goal.region.box": box}).objects["goal"].region
    assert region is not None
    assert region.is_3d
    crop = SceneConfig.load(SMALL, {"objects.apple.region.box": [[0, 0], [1, 1]]}).objects["apple"].region
    assert crop is not None
    assert not crop.is_3d


def test_reachable_may_hold_the_words_beside_it():
    """A mapping of tier, robot and grasps is the same object as the three words."""
    words = {"asset": "can", "on": "floor"}
    short = ObjectConfig.model_validate({**words, "reachable": {"by": "left", "grasp": "rim*"}})
    assert short == ObjectConfig.model_validate({**words, "reachable": True, "by": "left", "grasp": "rim*"})
    assert ObjectConfig.model_validate({**words, "reachable": {"tier": "ik"}}).reachable == "ik"


def test_reach_can_be_turned_off_with_its_words_left():
    """As `check` does it, to see what `reachable` costs."""
    words = {"by": "robot", "grasp": "top*"}
    can = {"asset": "can", "on": "floor", "reachable": words}
    scene = SceneConfig.load({"floor": {"size": [2.0, 2.0]}, "robot": {"asset": "panda"}, "objects": {"can": can}})
    off = SceneConfig.load(scene, {"objects.can.reachable": False}).objects["can"]
    assert (off.reachable, off.by, off.grasp) == (False, "robot", "top*")
