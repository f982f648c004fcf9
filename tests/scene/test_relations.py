"""Relations and orientations in scene files: what each word means, what refers to what, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.orientation import DrawnOrientation, Orientation
from sceniris_gym.config.relations import Relation
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import CycleError, SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.scene.model import build_model

RIGHT, BACK, LEFT, FRONT = 0.0, math.pi / 2, math.pi, -math.pi / 2
SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "objects": {
        "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor"},
        "apple": {"asset": "apple", "on": "floor"},
        "mug": {"asset": "mug", "on": "cabinet"},
        "post": {"asset": "mug", "kind": "static"},
        "goal": {"kind": "marker", "on": "floor"},
    },
}


def related(*relations: Any, **overrides: Any) -> SceneConfig:
    """Return the scene in which the apple has the relations."""
    return SceneConfig.load(SCENE, {"objects.apple.relations": list(relations), **overrides})


def only(relation: dict) -> Relation:
    """Return the apple's only relation."""
    return related(relation).objects["apple"].relations[0]


@pytest.mark.parametrize(
    ("words", "heading"),
    [
        ({"front_of": "cabinet"}, FRONT),
        ({"back_of": "cabinet"}, BACK),
        ({"left_of": "cabinet"}, LEFT),
        ({"right_of": "cabinet"}, RIGHT),
        ({"direction": [0, 2], "of": "cabinet"}, BACK),
        ({"direction": [-1.0, -1.0], "of": "cabinet"}, -0.75 * math.pi),
    ],
)
def test_a_directional_word_is_a_heading_in_the_anchor_s_frame(words: dict, heading: float):
    """The half-plane on that side, at any distance between origins."""
    relation = only(words)
    assert (relation.kind, relation.anchors, relation.frame) == ("direction", ("cabinet",), "anchor")
    assert (relation.heading, relation.half_angle) == pytest.approx((heading, math.pi / 2))
    assert (relation.low, relation.high, relation.bounds) == (0.0, math.inf, False)


@pytest.mark.parametrize(
    ("side", "axis", "degrees"),
    [("right", [1, 0], 0.0), ("back", [0, 1], 90.0), ("left", [-1, 0], 180.0), ("front", [0, -1], -90.0)],
)
def test_a_side_is_an_axis(side: str, axis: list[int], degrees: float):
    """The front is -y, the right x; generator and audit both take their directions from here."""
    words = [{f"{side}_of": "mug"}, {"direction": axis, "of": "mug"}, {"beside": "mug", "side": side}]
    for relation in map(only, words):
        assert math.degrees(relation.heading) == pytest.approx(degrees, abs=1e-12)


def test_options_of_a_direction_are_carried():
    """Angle, frame, distance and measure."""
    relation = only(
        {"left_of": "cabinet", "angle": 30, "frame": "mug", "distance": {"min": 0.2, "max": 1}, "measure": "bounds"}
    )
    assert relation.half_angle == pytest.approx(math.radians(30))
    assert (relation.frame, relation.frame_object) == ("mug", "mug")
    assert (relation.low, relation.high, relation.bounds) == (0.2, 1.0, True)
    assert [only({"near": "mug", "distance": {"max": 1}}).frame_object] == [None]


@pytest.mark.parametrize("frame", ["anchor", "support", "world", "cabinet", "mug", "post", "goal"])
def test_a_frame_is_a_word_or_an_object(frame: str):
    """Every object, placed or not, and the anchor itself by its name."""
    assert only({"left_of": "cabinet", "frame": frame}).frame == frame


@pytest.mark.parametrize(
    ("distance", "low", "high"),
    [
        ({"min": 0.5}, 0.5, math.inf),
        ({"max": 0.5}, 0.0, 0.5),
        ({"equal": 0.5}, 0.49, 0.51),
        ({"equal": 0.5, "tolerance": 0.2}, 0.3, 0.7),
        ({"equal": 0.0, "tolerance": 1e-4}, 0.0, 1e-4),
        ({"equal": 0.005}, 0.0, 0.015),
    ],
)
def test_a_distance_is_an_interval(distance: dict, low: float, high: float):
    """One that is equal is a band, which does not reach below 0."""
    relation = only({"front_of": "cabinet", "distance": distance})
    assert (relation.low, relation.high) == pytest.approx((low, high))


def test_near_is_all_around_within_a_distance():
    """At most so far, or about so far."""
    relation = only({"near": "post", "distance": {"min": 0.1, "max": 0.3}})
    assert (relation.kind, relation.anchors, relation.half_angle) == ("near", ("post",), math.pi)
    assert (relation.low, relation.high) == (0.1, 0.3)
    assert only({"near": "post", "distance": {"equal": 0.3}, "measure": "bounds"}).bounds


def test_between_has_two_to_eight_anchors():
    """And a width, by default the object's own."""
    relation = only({"between": ["cabinet", "mug"]})
    assert (relation.kind, relation.anchors, relation.width) == ("between", ("cabinet", "mug"), None)
    assert only({"between": ["cabinet", "mug", "post"], "width": 0.1}).width == 0.1


@pytest.mark.parametrize(("side", "heading"), [("left", LEFT), ("right", RIGHT), ("front", FRONT), ("back", BACK)])
def test_beside_has_a_side_and_a_gap(side: str, heading: float):
    """The gap is 1 cm by default; the frame turns the side."""
    relation = only({"beside": "cabinet", "side": side})
    assert (relation.kind, relation.anchors, relation.gap) == ("beside", ("cabinet",), 0.01)
    assert relation.heading == pytest.approx(heading)
    assert only({"beside": "cabinet", "side": side, "gap": 0, "frame": "world"}).gap == 0.0


def test_the_robot_may_be_an_anchor_and_a_frame():
    """By the name 'robot', where there is one."""
    robot = {"robot": {"asset": "panda"}}
    apple = related({"front_of": "robot", "frame": "robot"}, **robot).objects["apple"]
    assert apple.needs == ("robot",)
    with pytest.raises(UnknownNameError, match="unknown object 'robot'"):
        related({"front_of": "robot"})


@pytest.mark.parametrize(
    ("orientation", "turn"),
    [
        (None, DrawnOrientation("yaw", (-math.pi, math.pi))),
        ("fixed", DrawnOrientation("yaw", (0.0, 0.0))),
        ({"yaw": [-90, 45]}, DrawnOrientation("yaw", (-math.pi / 2, math.pi / 4))),
        ("any", DrawnOrientation("any", (-math.pi, math.pi))),
        ("stable", DrawnOrientation("stable", (-math.pi, math.pi))),
        ({"stable": {}}, DrawnOrientation("stable", (-math.pi, math.pi))),
        ({"stable": {"yaw": "free"}}, DrawnOrientation("stable", (-math.pi, math.pi))),
        ({"stable": {"yaw": [0, 90]}}, DrawnOrientation("stable", (0.0, math.pi / 2))),
        ({"face_to": "mug"}, DrawnOrientation("face_to", (0.0, 0.0), "mug")),
        ({"face_to": "mug", "yaw": [-90, 90]}, DrawnOrientation("face_to", (-math.pi / 2, math.pi / 2), "mug")),
    ],
)
def test_an_orientation_is_a_turn(orientation: Any, turn: DrawnOrientation):
    """Every form of it; angles are degrees in files and radians here."""
    apple = SceneConfig.load(SCENE, {"objects.apple.orientation": orientation}).objects["apple"]
    assert (apple.drawn_orientation.kind, apple.drawn_orientation.target) == (turn.kind, turn.target)
    assert apple.drawn_orientation.yaw == pytest.approx(turn.yaw)
    assert apple.yaw == apple.drawn_orientation.yaw


def test_a_form_of_orientation_replaces_the_base_s():
    """A yaw of the base is no offset of the child's face_to."""
    base = SceneConfig.load(SCENE, {"objects.apple.orientation": {"yaw": [-10, 10]}})
    child = SceneConfig.load(base, {"objects.apple.orientation": {"face_to": "mug"}})
    assert child.objects["apple"].drawn_orientation == DrawnOrientation("face_to", (0.0, 0.0), "mug")
    assert (
        SceneConfig.load(child, {"objects.apple.orientation.stable": {}}).objects["apple"].drawn_orientation.kind
        == "stable"
    )


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


def test_relations_and_orientations_are_in_the_canonical_form():
    """They shape layouts, so they are in the hash; a scene read again from its parts is the same."""
    plain = SceneConfig.load(SCENE)
    near = related({"near": "mug", "distance": {"max": 0.3}})
    texts = {
        plain.canonical(),
        near.canonical(),
        related({"near": "mug", "distance": {"max": 0.4}}).canonical(),
        *(SceneConfig.load(SCENE, {"objects.apple.orientation": word}).canonical() for word in ("any", "stable")),
        SceneConfig.load(SCENE, {"objects.apple.orientation": {"face_to": "mug"}}).canonical(),
    }
    assert len(texts) == 6
    assert SceneConfig.load(near, {"attempts": 10}).canonical() == near.canonical()
    assert build_model(near).hash != build_model(plain).hash


def test_relations_made_in_python_are_judged_by_themselves():
    """Errors name the class where there is no file."""
    assert Relation(front_of="mug", angle=45.0).half_angle == pytest.approx(math.pi / 4)
    with pytest.raises(SceneKeyError, match=r"Relation: scene: .*should have exactly one of front_of"):
        Relation(front_of="mug", near="cup")
    with pytest.raises(SceneKeyError, match=r"Orientation: .*should have one of yaw, any, stable, face_to"):
        Orientation(any=True, face_to="mug")


def test_a_circle_of_references_is_an_error_that_names_it():
    """Parents, anchors, frames and targets are all edges."""
    with pytest.raises(CycleError, match="placed relative to each other: cabinet -> mug -> cabinet"):
        SceneConfig.load(SCENE, {"objects.cabinet.relations": [{"front_of": "mug"}]})
    with pytest.raises(CycleError, match="apple -> goal -> apple"):
        related({"front_of": "cabinet", "frame": "goal"}, **{"objects.goal.relations": [{"left_of": "apple"}]})
    with pytest.raises(CycleError, match="cabinet -> apple -> mug -> cabinet"):
        related(
            {"between": ["post", "mug"]},
            **{"objects.cabinet.orientation": {"face_to": "apple"}},
        )


NEAR = {"near": "mug", "distance": {"max": 0.3}}
WRONG_RELATIONS = {
    "no list": (NEAR, SceneKeyError, ["relations: {'near'", "should be a list"]),
    "no mapping": (["near"], SceneKeyError, ["relations.0: 'near'", "mapping of keys"]),
    "no word": ([{"angle": 3}], SceneKeyError, ["relations.0:", "exactly one of front_of", "has none"]),
    "two words": ([{"front_of": "mug", **NEAR}], SceneKeyError, ["relations.0:", "has front_of and near"]),
    "five relations": ([NEAR] * 5, SceneKeyError, ["relations:", "4 values at most"]),
    "an unknown word": ([{"frontof": "mug"}], SceneKeyError, ["relations.0.frontof", "mean 'front_of'"]),
    "an unknown option": ([{**NEAR, "distanc": 3}], SceneKeyError, ["relations.0.distanc", "mean 'distance'"]),
    "no name": ([{"front_of": 3}], SceneKeyError, ["relations.0.front_of: 3", "a name"]),
    "an unknown anchor": ([NEAR, {"front_of": "cabinat"}], UnknownNameError, ["relations.1.front_of", "'cabinet'"]),
    "an unknown one of two": ([{"between": ["mug", "mugg"]}], UnknownNameError, ["relations.0.between", "'mug'"]),
    "an unknown of": ([{"direction": [1, 0], "of": "pot"}], UnknownNameError, ["relations.0.of", "Valid: cabinet"]),
    "the floor": ([{"front_of": "floor"}], UnknownNameError, ["relations.0.front_of", "unknown object 'floor'"]),
    "a part": ([{"front_of": "cabinet/upper_drawer"}], UnknownNameError, ["relations.0.front_of"]),
    "itself": ([{"front_of": "apple"}], SceneKeyError, ["relations.0.front_of: 'apple'", "another object"]),
    "its own frame": ([{"front_of": "mug", "frame": "apple"}], SceneKeyError, ["relations.0.frame: 'apple'"]),
    "an unknown frame": ([{"front_of": "mug", "frame": "ancor"}], UnknownNameError, ["relations.0.frame", "'anchor'"]),
    "no frame": ([{"front_of": "mug", "frame": None}], SceneKeyError, ["relations.0.frame: None", "a name"]),
    "no direction": ([{"direction": [0, 0], "of": "mug"}], SceneKeyError, ["0.direction: [0, 0]", "not [0, 0]"]),
    "a direction in space": ([{"direction": [0, 0, 1], "of": "mug"}], SceneKeyError, ["0.direction", "2 values"]),
    "a direction without of": ([{"direction": [0, 1]}], SceneKeyError, ["relations.0:", "with 'of'"]),
    "of without a direction": ([{"front_of": "mug", "of": "mug"}], SceneKeyError, ["'of' only with 'direction'"]),
    "an angle of 0": ([{"front_of": "mug", "angle": 0}], SceneKeyError, ["relations.0.angle: 0", "above 0"]),
    "an angle of 181": ([{"front_of": "mug", "angle": 181}], SceneKeyError, ["0.angle: 181", "at most 180"]),
    "an angle of near": ([{**NEAR, "angle": 9}], SceneKeyError, ["'angle' only with 'front_of'", "not with 'near'"]),
    "a frame of near": ([{**NEAR, "frame": "world"}], SceneKeyError, ["'frame' only with", "not with 'near'"]),
    "near anywhere": ([{"near": "mug"}], SceneKeyError, ["'distance' with 'max' or 'equal'"]),
    "near but far": ([{"near": "mug", "distance": {"min": 1}}], SceneKeyError, ["'distance' with 'max' or 'equal'"]),
    "a number for a distance": ([{"near": "mug", "distance": 1}], SceneKeyError, ["0.distance: 1", "mapping of keys"]),
    "an empty distance": ([{"front_of": "mug", "distance": {}}], SceneKeyError, ["0.distance: {}", "'min', 'max'"]),
    "a negative distance": (
        [{"near": "mug", "distance": {"max": -1}}],
        SceneKeyError,
        ["relations.0.distance.max: -1", "at least 0"],
    ),
    "a distance of 0": ([{"near": "mug", "distance": {"max": 0}}], SceneKeyError, ["0.distance:", "'max' above 0"]),
    "an empty interval": (
        [{"front_of": "mug", "distance": {"min": 1, "max": 1}}],
        SceneKeyError,
        ["relations.0.distance:", "'min' below its 'max'"],
    ),
    "equal and more": (
        [{"front_of": "mug", "distance": {"equal": 1, "max": 2}}],
        SceneKeyError,
        ["relations.0.distance:", "'equal' or 'max', not both"],
    ),
    "a tolerance of a limit": (
        [{"front_of": "mug", "distance": {"min": 1, "tolerance": 0.1}}],
        SceneKeyError,
        ["relations.0.distance:", "'tolerance' only with 'equal'"],
    ),
    "no tolerance": (
        [{"front_of": "mug", "distance": {"equal": 1, "tolerance": 0}}],
        SceneKeyError,
        ["relations.0.distance.tolerance:", "at least 0.0001 m"],
    ),
    "a tolerance that no point can be drawn within": (
        [{"near": "mug", "distance": {"equal": 0.5, "tolerance": 0.00005}}],
        SceneKeyError,
        ["relations.0.distance.tolerance:", "at least 0.0001 m"],
    ),
    "limits with next to nothing between them": (
        [{"near": "mug", "distance": {"min": 0.5, "max": 0.5001}}],
        SceneKeyError,
        ["relations.0.distance:", "'max' at least 0.0002 m above its 'min'"],
    ),
    "an unknown measure": (
        [{**NEAR, "measure": "bound"}],
        SceneKeyError,
        ["relations.0.measure: 'bound'", "mean 'bounds'"],
    ),
    "nothing to measure": ([{"front_of": "mug", "measure": "bounds"}], SceneKeyError, ["a 'distance' with 'measure'"]),
    "between one": ([{"between": ["mug"]}], SceneKeyError, ["relations.0.between", "at least 2 values"]),
    "between a name": ([{"between": "mug"}], SceneKeyError, ["relations.0.between: 'mug'", "a list"]),
    "between nine": ([{"between": [f"m{i}" for i in range(9)]}], SceneKeyError, ["0.between", "8 values at most"]),
    "between the same": ([{"between": ["mug", "mug"]}], SceneKeyError, ["relations.0:", "'between' once"]),
    "a distance of between": (
        [{"between": ["mug", "cabinet"], "distance": {"max": 1}}],
        SceneKeyError,
        ["'distance' only with", "not with 'between'"],
    ),
    "no width": ([{"between": ["mug", "cabinet"], "width": 0}], SceneKeyError, ["0.width: 0", "above 0"]),
    "a width of near": ([{**NEAR, "width": 1}], SceneKeyError, ["'width' only with 'between', not with 'near'"]),
    "beside anywhere": ([{"beside": "mug"}], SceneKeyError, ["'side' with 'beside': left, right, front or back"]),
    "an unknown side": ([{"beside": "mug", "side": "lft"}], SceneKeyError, ["0.side: 'lft'", "mean 'left'"]),
    "a side of near": ([{**NEAR, "side": "left"}], SceneKeyError, ["'side' only with 'beside'"]),
    "a negative gap": ([{"beside": "mug", "side": "left", "gap": -1}], SceneKeyError, ["0.gap: -1", "at least 0"]),
    "a gap of near": ([{**NEAR, "gap": 0.1}], SceneKeyError, ["'gap' only with 'beside', not with 'near'"]),
}


def refused(folder: Path, overrides: dict, error: type[ScenirisError], says: list[str]) -> None:
    """Assert that the scene with the overrides is refused by file, path and advice, without a foreign traceback."""
    path = folder / "wrong.yaml"
    path.write_text(json.dumps(SCENE))
    with pytest.raises(error) as caught:
        SceneConfig.load(path, overrides)
    for text in (str(path), *says):
        assert text in str(caught.value)
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__ or caught.value.__context__ is None


@pytest.mark.parametrize(("relations", "error", "says"), WRONG_RELATIONS.values(), ids=WRONG_RELATIONS.keys())
def test_a_wrong_relation_is_refused(tmp_path: Path, relations: Any, error: type[ScenirisError], says: list[str]):
    """By its place in the list, with what would be right."""
    refused(tmp_path, {"objects.apple.relations": relations}, error, ["objects.apple.", *says])


WRONG = {
    "a word beside relations": ({"objects.apple.near": "mug"}, SceneKeyError, ["objects.apple.near", "in 'relations'"]),
    "relations of a static object": (
        {"objects.post.relations": [{"front_of": "mug"}]},
        SceneKeyError,
        ["objects.post:", "stays where the model has it"],
    ),
    "relations of what is not placed": (
        {"objects.goal": {"kind": "marker", "on": None, "relations": [NEAR]}},
        SceneKeyError,
        ["objects.goal:", "should name its support", "or have a region that is a 3D box"],
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
        ["objects.goal:", "should name its support", "the frame of one of its relations"],
    ),
    "a point between": (
        {"objects.goal.relations": [{"front_of": "mug"}, {"between": ["cabinet", "mug"]}]},
        SceneKeyError,
        ["objects.goal.relations.1.width: is missing", "no width of its own"],
    ),
    "a stable point": (
        {"objects.goal.orientation": "stable"},
        SceneKeyError,
        ["objects.goal.orientation", "no stable pose"],
    ),
    "a misspelt word": ({"objects.apple.orientation": "stabel"}, SceneKeyError, ["orientation: 'stabel'", "'stable'?"]),
    "no form": ({"objects.apple.orientation": {}}, SceneKeyError, ["orientation: {}", "has none"]),
    "two forms": (
        {"objects.apple.orientation": {"stable": {}, "yaw": [0, 1]}},
        SceneKeyError,
        ["objects.apple.orientation:", "has yaw and stable"],
    ),
    "an unknown form": ({"objects.apple.orientation": {"faceto": "mug"}}, SceneKeyError, ["'face_to'"]),
    "a misspelt yaw": (
        {"objects.apple.orientation": {"stable": {"yaw": "fre"}}},
        SceneKeyError,
        ["orientation.stable.yaw: 'fre'", "mean 'free'"],
    ),
    "a word for a stable pose": (
        {"objects.apple.orientation": {"stable": "free"}},
        SceneKeyError,
        ["orientation.stable: 'free'", "mapping of keys"],
    ),
    "an unknown target": (
        {"objects.apple.orientation": {"face_to": "cabine"}},
        UnknownNameError,
        ["objects.apple.orientation.face_to", "mean 'cabinet'"],
    ),
    "itself as target": (
        {"objects.apple.orientation": {"face_to": "apple"}},
        SceneKeyError,
        ["objects.apple.orientation.face_to: 'apple'", "another object"],
    ),
    "an object named as a frame": ({"objects.support": {"asset": "mug"}}, SceneKeyError, ["objects.support", "taken"]),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_word_in_the_wrong_place_is_refused(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Relations that an object cannot have, and orientations that make no sense."""
    refused(tmp_path, overrides, error, says)


def test_markers_may_be_related():
    """A point may be placed by every word; the strip between others needs a width."""
    goal = SceneConfig.load(
        SCENE, {"objects.goal.relations": [NEAR, {"between": ["cabinet", "mug"], "width": 0.1}, {"left_of": "post"}]}
    ).objects["goal"]
    assert [relation.kind for relation in goal.relations] == ["near", "between", "direction"]
