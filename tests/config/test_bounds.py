"""The table of bounds: what is inside of them, and that no number of a scene file is without one."""

from __future__ import annotations

import math
from typing import Any

import pytest
import shapely

from sceniris_gym.config.bounds import BOUNDS, MAX_ANCHORS, MAX_CORNERS, MAX_PIECES, MAX_RELATIONS, Bound
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.scene.build import build_model
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


POSTS = [f"post{i}" for i in range(MAX_ANCHORS + 1)]
SCENE = {
    "floor": {"size": [6.0, 6.0]},
    "objects": {
        **{name: {"asset": "mug", "on": "floor"} for name in POSTS},
        "apple": {"asset": "apple", "on": "floor"},
    },
}


def upload(*relations: dict, **words: Any) -> None:
    """Make the device program of the scene in which the apple has the relations, and the words besides."""
    changes = {
        "objects.apple.relations": relations,
        **{f"objects.apple.{word}": value for word, value in words.items()},
    }
    upload_scene(build_model(SceneConfig.load(SCENE, changes)), "cpu")


def test_an_object_has_as_many_relations_as_there_is_room_for():
    """One more is refused by the name of the object."""
    relations = [{"left_of": name} for name in POSTS[: MAX_RELATIONS + 1]]
    upload(*relations[:-1])
    said = refusal(SCENE, {"objects.apple.relations": relations}, SceneKeyError)
    assert said.startswith("scene: objects.apple.relations: ")
    assert said.endswith(f"should have {MAX_RELATIONS} values at most.")


def test_an_object_is_between_as_many_others_as_there_is_room_for():
    """One more is refused by the place of the relation."""
    upload({"between": POSTS[:-1]})
    said = refusal(SCENE, {"objects.apple.relations": [{"between": POSTS}]}, SceneKeyError)
    assert said.startswith("scene: objects.apple.relations.0.between: ")
    assert said.endswith(f"should have {MAX_ANCHORS} values at most.")


def test_relations_may_cut_pieces_of_as_many_corners_as_there_is_room_for():
    """Three relations and the hull of eight anchors still fit, three such hulls do not."""
    hull = {"between": POSTS[:-1]}
    upload(hull, *({"left_of": name} for name in POSTS[: MAX_RELATIONS - 1]))
    with pytest.raises(SceneKeyError, match=rf"objects\.apple\.relations: .*at most {MAX_CORNERS}\. Use fewer"):
        upload(hull, hull, hull)


@pytest.mark.parametrize("edges", [[3, *[4] * MAX_RELATIONS], [3, *[4] * (MAX_RELATIONS - 1), MAX_ANCHORS]], ids=str)
def test_the_most_corners_of_a_piece_fit(edges: list[int]):
    """A triangle, four-sided relations and a hull that touch one circle all around: every edge is one of the piece."""
    piece = shapely.box(-9.0, -9.0, 9.0, 9.0)
    for turn, sides in enumerate(edges):
        angles = [0.1 * turn + math.tau * i / sides for i in range(sides)]
        radius = 1.0 / math.cos(math.pi / sides)
        piece &= shapely.Polygon([(radius * math.cos(a), radius * math.sin(a)) for a in angles])
    corners = shapely.get_num_coordinates(piece) - 1
    assert corners == sum(edges)
    assert corners <= MAX_CORNERS


def test_relations_may_cut_a_region_into_as_many_pieces_as_there_is_room_for():
    """Two rings as thin as they get, 256 slices each: they fit into a triangle, but not into the two of a square."""
    rings = [{"near": name, "distance": {"equal": 2.0, "tolerance": 1e-4}} for name in POSTS[:2]]
    upload(*rings, region={"polygon": [[-1, -1], [1, -1], [0, 1]]})
    says = rf"objects\.apple\.relations: .*into {2 * MAX_PIECES} pieces, .* at most {MAX_PIECES}\. Use fewer"
    with pytest.raises(SceneKeyError, match=says):
        upload(*rings, region={"polygon": [[-1, -1], [1, -1], [1, 1], [-1, 1]]})
