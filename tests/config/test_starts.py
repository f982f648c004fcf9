"""Starts of objects that may be absent, have variants or stand on several supports: accepted, or refused by name."""

from __future__ import annotations

from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.scene.build import build_model

BOX = {"box": [[-0.2, -0.2], [0.2, 0.2]]}
SCENE: dict[str, Any] = {
    "floor": {"size": [1, 1]},
    "robot": {"asset": "panda"},
    "objects": {
        "shelf": {"asset": "table", "kind": "fixture", "on": "floor"},
        "thing": {"variants": {"can": {"asset": "can"}, "lemon": {"asset": "lemon"}}, "on": ["floor", "shelf"]},
        "apple": {"asset": "apple", "on": "floor", "reachable": "map"},
        "goal": {"kind": "marker", "on": "floor", "region": BOX},
        "spot": {"kind": "marker", "on": "shelf"},
        "sign": {"asset": "plate", "kind": "marker", "on": ["floor", "shelf"]},
    },
}


def load(start: dict[str, Any], **changes: Any) -> SceneConfig:
    """Return the scene with one kind of start, and other values at these keys."""
    return SceneConfig.load(SCENE, {"start": [start], **{key.replace("__", "."): v for key, v in changes.items()}})


def test_members_on_the_support_of_the_marker_are_placed():
    """Of each variant the one on this support; those on other supports stay there."""
    config = load({"place": {"thing": "spot", "apple": "goal"}})
    assert config.markers(config.start[0]) == {
        "thing/can@shelf": "spot",
        "thing/lemon@shelf": "spot",
        "apple": "goal",
    }
    assert config.needs("thing/can@shelf") == ("shelf", "spot")
    assert config.needs("thing/can@floor") == ()


SOMETIMES = {"of": ["apple"], "count": [0, 1]}
GRASP, PLACE = {"robot": "grasp", "of": "apple"}, {"place": {"apple": "goal"}}


@pytest.mark.parametrize("start", [GRASP, GRASP | {"lift": [0.0, 0.1]}, PLACE], ids=["grasp", "lift", "place"])
def test_what_may_be_absent_is_refused_unless_its_group_drops_references(start: dict[str, Any]):
    """As for relations: `missing: drop` accepts it, also for an object with variants."""
    with pytest.raises(SceneKeyError, match=r"start\.0\.\w+: 'apple' may be absent\..*'missing: drop' in its group"):
        load(start, groups={"sometimes": SOMETIMES})
    assert load(start, groups={"sometimes": SOMETIMES | {"missing": "drop"}}).start
    with pytest.raises(SceneKeyError, match=r"start\.0\.\w+: 'apple' may be absent\. Name another object\.$"):
        load(start, objects__apple__if="thing/can")
    dropped = {"sometimes": {"of": ["thing"], "count": [0, 1], "missing": "drop"}}
    assert load({"place": {"thing": "goal"}}, groups=dropped).start


def test_a_marker_is_there_whenever_its_object_is():
    """By the words of the scene; else it is refused, or its group drops the start's reference to it."""
    drop = {"missing": "drop"}
    with pytest.raises(SceneKeyError, match=r"'goal' may be absent\..*write 'if: goal' to place 'apple' only"):
        load(PLACE, objects__goal__unless="thing/can")
    with pytest.raises(SceneKeyError, match="'goal' may be absent"):
        load(PLACE, groups={"signs": {"of": ["goal"], "count": [0, 1]}})
    assert load(PLACE, groups={"signs": {"of": ["goal"], "count": [0, 1]} | drop}).start
    implied = {"objects__goal__unless": "thing/can", "objects__apple__if": "goal"}
    assert load(PLACE, groups={"sometimes": SOMETIMES | drop}, **implied).start


def test_a_marker_may_be_on_a_body_of_any_object():
    """The bodies are known once the model is built: then the object on the marker's body is placed there."""
    cabinet = {"asset": "cabinet", "kind": "fixture", "on": "floor"}
    changes = {"objects__shelf": cabinet, "objects__apple__on": {"any": "shelf"}}
    config = load(PLACE, **changes, objects__goal={"kind": "marker", "on": "shelf/upper_drawer"})
    built = build_model(config).config
    assert built.markers(built.start[0]) == {"apple/@shelf:upper_drawer": "goal"}
    handle = load(PLACE, **changes, objects__goal={"kind": "marker", "on": "shelf/no_drawer"})
    with pytest.raises(ScenirisError, match=r"'apple' and its marker 'goal' should have the same support"):
        build_model(handle)


WRONG = {
    "a single variant": ({"place": {"thing/can": "goal"}}, UnknownNameError, "Did you mean 'thing'"),
    "an unknown object": ({"place": {"thign": "goal"}}, UnknownNameError, "Did you mean 'thing'"),
    "no marker": ({"place": {"thing": "shelf"}}, UnknownNameError, "marker 'shelf'"),
    "a marker of several places": (
        {"place": {"apple": "sign"}}, SceneKeyError, "marker 'sign' should have one support and no variants",
    ),
    "no shared support": ({"place": {"apple": "spot"}}, SceneKeyError, "'apple' and its marker 'spot' should have the"),
    "joints of variants": ({"joints": {"thing/lid": {"noise": 0.1}}}, SceneKeyError, "'thing' has variants, whose"),
}  # fmt: skip


@pytest.mark.parametrize(("start", "error", "says"), WRONG.values(), ids=WRONG)
def test_other_names_are_refused(start: dict[str, Any], error: type[Exception], says: str):
    """With the number of the kind."""
    with pytest.raises(error, match=says) as caught:
        load(start)
    assert "start.0." in str(caught.value)
