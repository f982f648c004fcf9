"""Relations in scene files: what each word means, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.relations import KINDS, Beside, Between, Direction, Joined, Near
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from tests.config.scenes import NEAR, NEIGHBOURS, SMALL, only, refusal, refused, related

RIGHT, BACK, LEFT, FRONT = 0.0, math.pi / 2, math.pi, -math.pi / 2


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
    assert (type(relation), relation.anchors, relation.reference_frame) == (Direction, ("cabinet",), "cabinet")
    assert (relation.heading(()), relation.half_angle) == pytest.approx((heading, math.pi / 2))
    assert (relation.low, relation.high, relation.by_bounds) == (0.0, math.inf, False)


@pytest.mark.parametrize(
    ("side", "axis", "degrees"),
    [("right", [1, 0], 0.0), ("back", [0, 1], 90.0), ("left", [-1, 0], 180.0), ("front", [0, -1], -90.0)],
)
def test_a_side_is_an_axis(side: str, axis: list[int], degrees: float):
    """The front is -y, the right x; generator and audit both take their directions from here."""
    words = [{f"{side}_of": "mug"}, {"direction": axis, "of": "mug"}, {"beside": "mug", "side": side}]
    for relation in map(only, words):
        assert math.degrees(relation.heading(())) == pytest.approx(degrees, abs=1e-12)


def test_options_of_a_direction_are_carried():
    """Angle, frame, distance and measure."""
    relation = only(
        {"left_of": "cabinet", "angle": 30, "frame": "mug", "distance": {"min": 0.2, "max": 1}, "measure": "bounds"}
    )
    assert relation.half_angle == pytest.approx(math.radians(30))
    assert relation.reference_frame == "mug"
    assert relation.references == [("left_of", "cabinet"), ("frame", "mug")]
    assert (relation.low, relation.high, relation.by_bounds) == (0.2, 1.0, True)
    assert only({"near": "post", "distance": {"max": 1}}).references == [("near", "post")]


@pytest.mark.parametrize("frame", ["anchor", "support", "world", "cabinet", "mug", "post", "goal"])
def test_a_frame_is_a_word_or_an_object(frame: str):
    """Every object, placed or not, and the anchor itself by its name."""
    assert only({"left_of": "cabinet", "frame": frame}).reference_frame == ("cabinet" if frame == "anchor" else frame)


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
    assert (type(relation), relation.anchors, relation.half_angle) == (Near, ("post",), math.pi)
    assert (relation.low, relation.high) == (0.1, 0.3)
    assert only({"near": "post", "distance": {"equal": 0.3}, "measure": "bounds"}).by_bounds


def test_between_has_two_to_eight_anchors():
    """And a width, by default the object's own."""
    relation = only({"between": ["cabinet", "mug"]})
    assert isinstance(relation, Between)
    assert (relation.anchors, relation.width, relation.has_own_width) == (("cabinet", "mug"), None, True)
    assert not only({"between": ["cabinet", "mug", "post"], "width": 0.1}).has_own_width


@pytest.mark.parametrize(("side", "heading"), [("left", LEFT), ("right", RIGHT), ("front", FRONT), ("back", BACK)])
def test_beside_has_a_side_and_a_gap(side: str, heading: float):
    """The gap is 1 cm by default; the frame turns the side."""
    relation = only({"beside": "cabinet", "side": side})
    assert isinstance(relation, Beside)
    assert (relation.anchors, relation.gap) == (("cabinet",), 0.01)
    assert relation.heading(()) == pytest.approx(heading)
    turned = only({"beside": "cabinet", "side": side, "gap": 0, "frame": "world"})
    assert isinstance(turned, Beside)
    assert (turned.gap, turned.reference_frame) == (0.0, "world")


@pytest.mark.parametrize("robots", [(), ("cabinet",)])
@pytest.mark.parametrize(
    ("side", "align", "end"),
    [
        *(("right", "back", 1), ("right", "front", -1), ("left", "back", -1), ("left", "front", 1)),
        *(("front", "right", 1), ("front", "left", -1), ("back", "left", 1), ("back", "right", -1)),
        *((side, "middle", 0) for side in ("left", "right", "front", "back")),
        ("right", None, None),
    ],
)
def test_beside_may_align_ends(side: str, align: str | None, end: int | None, robots: tuple[str, ...]):
    """Seen along the side; the left and the right of a robot are on other sides of its front."""
    relation = only({"beside": "cabinet", "side": side, "align": align})
    assert isinstance(relation, Beside)
    assert relation.aligned(robots) == (-end if end and robots else end)


def test_relations_made_in_python_are_judged_by_themselves():
    """Errors name the class where there is no file."""
    assert Direction(front_of="mug", angle=45.0).half_angle == pytest.approx(math.pi / 4)
    with pytest.raises(SceneKeyError, match=r"Direction: scene: .*should have exactly one of front_of"):
        Direction(front_of="mug", back_of="cup")
    with pytest.raises(
        SceneKeyError, match=r"Direction: near: 'cup' should be given only with 'near', not with 'front_of'"
    ):
        Direction(front_of="mug", near="cup")  # pyrefly: ignore[unexpected-keyword]


WRONG: dict[str, tuple] = {
    "no list": (NEAR, SceneKeyError, ["relations: {'near'", "should be a list"]),
    "no mapping": (["near"], SceneKeyError, ["relations.0: 'near'", "mapping of keys"]),
    "no word": ([{"angle": 3}], SceneKeyError, ["relations.0:", "exactly one of front_of", "has none"]),
    "two words": ([{"front_of": "mug", **NEAR}], SceneKeyError, ["relations.0:", "has front_of and near"]),
    "five relations": ([NEAR] * 5, SceneKeyError, ["relations:", "4 values at most"]),
    "an unknown word": ([{"frontof": "mug"}], SceneKeyError, ["relations.0.frontof", "mean 'front_of'"]),
    "an unknown option": ([{**NEAR, "distanc": 3}], SceneKeyError, ["relations.0.distanc", "mean 'distance'"]),
    "no name": ([{"front_of": 3}], SceneKeyError, ["relations.0.front_of: 3", "a name"]),
    "no frame": ([{"front_of": "mug", "frame": None}], SceneKeyError, ["relations.0.frame: None", "a name"]),
    "no direction": ([{"direction": [0, 0], "of": "mug"}], SceneKeyError, ["0.direction: [0, 0]", "not [0, 0]"]),
    "a direction in space": ([{"direction": [0, 0, 1], "of": "mug"}], SceneKeyError, ["0.direction", "2 values"]),
    "a direction without of": ([{"direction": [0, 1]}], SceneKeyError, ["relations.0:", "should have 'of'"]),
    "of without a direction": ([{"front_of": "mug", "of": "mug"}], SceneKeyError, ["'of' only with 'direction'"]),
    "an angle of 0": ([{"front_of": "mug", "angle": 0}], SceneKeyError, ["relations.0.angle: 0", "above 0"]),
    "an angle of 181": ([{"front_of": "mug", "angle": 181}], SceneKeyError, ["0.angle: 181", "at most 180"]),
    "an angle of near": (
        [{**NEAR, "angle": 9}],
        SceneKeyError,
        ["0.angle: 9 should be given only with 'front_of'", "not with 'near'"],
    ),
    "a frame of near": (
        [{**NEAR, "frame": "world"}],
        SceneKeyError,
        ["0.frame: 'world' should be given only with", "not with 'near'"],
    ),
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
    "nothing to measure": ([{"front_of": "mug", "measure": "bounds"}], SceneKeyError, ["a 'distance', because"]),
    "between one": ([{"between": ["mug"]}], SceneKeyError, ["relations.0.between", "at least 2 values"]),
    "between a name": ([{"between": "mug"}], SceneKeyError, ["relations.0.between: 'mug'", "a list"]),
    "between nine": ([{"between": [f"m{i}" for i in range(9)]}], SceneKeyError, ["0.between", "8 values at most"]),
    "between the same": (
        [{"between": ["mug", "mug"]}],
        SceneKeyError,
        ["0.between: ['mug', 'mug'] should name each object once"],
    ),
    "a distance of between": (
        [{"between": ["mug", "cabinet"], "distance": {"max": 1}}],
        SceneKeyError,
        ["0.distance: {'max': 1} should be given only with", "not with 'between'"],
    ),
    "no width": ([{"between": ["mug", "cabinet"], "width": 0}], SceneKeyError, ["0.width: 0", "above 0"]),
    "a width of near": (
        [{**NEAR, "width": 1}],
        SceneKeyError,
        ["0.width: 1 should be given only with 'between', not with 'near'"],
    ),
    "beside anywhere": (
        [{"beside": "mug"}],
        SceneKeyError,
        ["0.side: None should be 'left', 'right', 'front' or 'back'"],
    ),
    "an unknown side": ([{"beside": "mug", "side": "lft"}], SceneKeyError, ["0.side: 'lft'", "mean 'left'"]),
    "a side of near": (
        [{**NEAR, "side": "left"}],
        SceneKeyError,
        ["0.side: 'left' should be given only with 'beside', not with 'near'"],
    ),
    "an unknown end": (
        [{"beside": "mug", "side": "left", "align": "bakc"}],
        SceneKeyError,
        ["0.align: 'bakc' should be 'left', 'right', 'front', 'back' or 'middle'", "mean 'back'"],
    ),
    "an end along its side": (
        [{"beside": "mug", "side": "left", "align": "right"}],
        SceneKeyError,
        ["relations.0: ", "should have 'back', 'front' or 'middle' as 'align', because its side is 'left'"],
    ),
    "an end along its front": (
        [{"beside": "mug", "side": "front", "align": "back"}],
        SceneKeyError,
        ["relations.0: ", "should have 'left', 'right' or 'middle' as 'align', because its side is 'front'"],
    ),
    "an end of near": (
        [{**NEAR, "align": "back"}],
        SceneKeyError,
        ["0.align: 'back' should be given only with 'beside', not with 'near'"],
    ),
    "an end of sites": (
        [{"beside": {"of": "mug", "site": "end", "of_site": "end"}, "align": "back"}],
        SceneKeyError,
        ["0.align: 'back' should not be given if 'beside' names sites"],
    ),
    "a negative gap": ([{"beside": "mug", "side": "left", "gap": -1}], SceneKeyError, ["0.gap: -1", "at least 0"]),
    "no sites": ([{"beside": {"of": "mug", "site": "end"}}], SceneKeyError, ["0.beside.of_site: is missing"]),
    "a word of no connection": (
        [{"beside": {"of": "mug", "site": "end", "of_site": "end", "angel": 0}}],
        SceneKeyError,
        ["beside.angel: unknown key", "'angle'"],
    ),
    "beside a number": ([{"beside": 3}], SceneKeyError, ["relations.0.beside: 3 should be a name"]),
    "a side of sites": (
        [{"beside": {"of": "mug", "site": "end", "of_site": "end"}, "side": "left"}],
        SceneKeyError,
        ["0.side: 'left' should not be given if 'beside' names sites"],
    ),
    "joined to nothing": (
        [{"beside": {"of": "mgu", "site": "end", "of_site": "end"}}],
        UnknownNameError,
        ["0.beside.of", "mean 'mug'"],
    ),
    "a gap of near": (
        [{**NEAR, "gap": 0.1}],
        SceneKeyError,
        ["0.gap: 0.1 should be given only with 'beside', not with 'near'"],
    ),
}


@pytest.mark.parametrize(("relations", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_relation_is_refused(tmp_path: Path, relations: Any, error: type[ScenirisError], says: list[str]):
    """By its place in the list, with what would be right."""
    refused(tmp_path, NEIGHBOURS, {"objects.apple.relations": relations}, error, ["objects.apple.", *says])


@pytest.mark.parametrize(
    ("relations", "fits"),
    [
        ([{"left_of": "shelf"}, {"right_of": "shelf"}], False),
        ([{"front_of": "shelf", "angle": 30}, {"left_of": "shelf", "angle": 60}], False),
        ([{"front_of": "shelf"}, {"left_of": "shelf"}], True),
        ([{"left_of": "shelf", "frame": "world"}, {"right_of": "shelf"}], True),
    ],
)
def test_directions_that_leave_only_a_line_are_refused(relations: list[dict], fits: bool):
    """An object left and right of a thing at once would lie on its middle line; other frames may turn apart."""
    if fits:
        SceneConfig.load(SMALL, {"objects.apple.relations": relations})
    else:
        said = refusal(SMALL, {"objects.apple.relations": relations}, SceneKeyError)
        assert "have no area in common" in said


def test_what_is_joined_has_no_orientation_of_its_own_and_is_joined_once():
    """Two sites say where it is and how it is turned."""
    beside = {"of": "shelf", "site": "end", "of_site": "end"}
    changed = {"objects.apple.relations": [{"beside": beside}], "objects.apple.orientation": "fixed"}
    assert "should have no 'orientation'" in refusal(SMALL, changed, SceneKeyError)
    changed = {"objects.apple.relations": [{"beside": beside}, {"beside": {**beside, "site": "front"}}]}
    assert "should be joined to one other object at most" in refusal(SMALL, changed, SceneKeyError)


def test_joined_sites_are_as_far_apart_as_the_gap_that_is_given():
    """By default they coincide, while bounds are 1 cm apart."""
    beside = {"of": "post", "site": "end", "of_site": "end"}
    relation = only({"beside": beside})
    assert isinstance(relation, Joined)
    assert (relation.references, relation.gap) == ([("beside.of", "post")], None)
    assert only({"beside": beside, "gap": 0.2}) == relation.model_copy(update={"gap": 0.2})


def test_a_joined_object_is_copied_in_the_words_that_scene_files_have():
    """By overrides, also in a scene with a stack, which keeps its words as written; and as it was printed."""
    beside = {"of": "cabinet", "site": "end", "of_site": "tip", "angle": 90.0}
    tower = {"objects.pear": {"asset": "pear"}, "stacks": {"tower": {"of": ["mug", "pear"], "on": "cabinet"}}}
    config = related({"beside": beside}, **tower)
    for scene in (related({"beside": beside}), config):
        copied = SceneConfig.load(scene, {"objects.apple.clearance": 0.02})
        assert copied.objects["apple"].relations == scene.objects["apple"].relations
    printed = config.model_dump(by_alias=True, exclude_unset=True)
    assert SceneConfig.load(printed).canonical() == config.canonical()
    assert printed["objects"]["apple"]["relations"][0]["beside"] == beside


def test_a_gap_between_sites_is_part_of_the_hash_whatever_it_is():
    """One of 1 cm too, which is the default between bounds: sites that coincide make other layouts."""
    beside = {"of": "post", "site": "end", "of_site": "end"}
    words = [related({"beside": beside, **gap}).canonical() for gap in ({}, {"gap": 0.01}, {"gap": 0.02})]
    assert len(set(words)) == 3


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_of_relation_has_its_words_as_keys(kind: type):
    """Each is a class, with a line that says what it is."""
    assert kind.__doc__
    assert set(kind.one_of) <= set(kind.model_fields)


def test_keys_of_other_words_may_be_null():
    """As when a scene that is based on another one takes them back."""
    near = {"near": "mug", "distance": {"max": 1}}
    assert only({**near, "front_of": None, "angle": None}) == only(near)
    assert related({**near, "front_of": None}).canonical() == related(near).canonical()


def test_relations_are_said_in_a_line():
    """The word, its anchors, and its distance."""
    assert only({"between": ["mug", "post"]}).summary == "between mug and post"
    ring = {"right_of": "mug", "distance": {"min": 0.1, "max": 0.5}}
    assert only(ring).summary == "right_of mug, at least 0.1 m, at most 0.5 m"
    near = {"near": "mug", "measure": "bounds", "distance": {"max": 0.3}}
    assert only(near).summary == "near mug, at most 0.3 m between bounds"
    assert only({"beside": "post", "side": "front", "gap": 0.03}).summary == "beside post, front, gap 0.03 m"
    row = {"beside": "post", "side": "left", "align": "back"}
    assert only(row).summary == "beside post, left, gap 0.01 m, align back"
    assert only({"beside": {"of": "post", "site": "end", "of_site": "tip"}}).summary == "end at tip of post"
