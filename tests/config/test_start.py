"""Kinds of starts in scene files: the words of each, and what is refused."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from tests.layout.starting import HELD, LIFTED, SCENE, STANDING


def test_kinds_are_read_in_their_order():
    """Their place in the list is their number."""
    kinds = SceneConfig.load(SCENE).start
    assert [kind.robot for kind in kinds] == ["home", "pregrasp", *["grasp"] * 3, "home", "grasp"]
    assert [kind.is_held for kind in kinds] == [i in (LIFTED, HELD) for i in range(len(kinds))]
    assert kinds[STANDING].targets({}) == ("block",)
    assert kinds[0].weight == 3.0


def test_the_word_counts_in_the_hash_only_where_it_is_written():
    """So that scenes without it keep theirs."""
    without = {key: value for key, value in SCENE.items() if key != "start"}
    assert "start" not in SceneConfig.load(without).canonical()
    assert "start" in SceneConfig.load(SCENE).canonical()


def test_a_target_with_variants_stands_for_all_of_them():
    """One of which is there in every world."""
    target = {"variants": {"block": {"asset": "block"}, "can": {"asset": "can"}}, "on": "floor", "reachable": "clear"}
    scene = {"floor": {"size": [1, 1]}, "robot": {"asset": "panda"}, "objects": {"target": target}}
    config = SceneConfig.load({**scene, "start": [{"robot": "grasp", "of": "target", "lift": [0.0, 0.1]}]})
    assert config.start[0].targets(config.groups) == ("target/block", "target/can")
    with pytest.raises(SceneKeyError, match="may be absent, as one of a group or of variants"):
        SceneConfig.load({**scene, "start": [{"robot": "grasp", "of": "target/can"}]})
    for word in ({"place": {"target": "goal"}}, {"joints": {"target/lid": {"noise": 0.1}}}):
        with pytest.raises(SceneKeyError, match=r"start\.0\.\w+: 'target' has variants"):
            SceneConfig.load({**scene, "start": [word]})


GRASP = {"robot": "grasp", "of": "block"}
WRONG: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
    "an unknown pose": ({"robot": "graps", "of": "block"}, SceneKeyError, "start.0.robot"),
    "nothing to grasp": ({"robot": "grasp"}, SceneKeyError, "should name an object as 'of'"),
    "home of something": ({"of": "block"}, SceneKeyError, "should name an object as 'of'"),
    "a weight of 0": ({"weight": 0}, SceneKeyError, "start.0.weight"),
    "a lift upside down": (GRASP | {"lift": [0.2, 0.1]}, SceneKeyError, "low <= high"),
    "a lift by nothing": (GRASP | {"lift": [0, 0]}, SceneKeyError, "high above 0"),
    "a lift without a grasp": ({"robot": "pregrasp", "of": "block", "lift": [0, 0.1]}, SceneKeyError, "only where"),
    "a lift and joints": (GRASP | {"lift": [0, 0.1], "robot_joints": {"*": {"noise": 0.1}}}, SceneKeyError, "not both"),
    "a choice": (GRASP | {"robot_joints": {"*": {"choice": [0.1]}}}, SceneKeyError, "should draw joints by"),
    "an unknown object": (GRASP | {"of": "blok"}, UnknownNameError, "start.0.of"),
    "one that is out of reach": (GRASP | {"of": "apple"}, SceneKeyError, "'apple' should be 'reachable'"),
    "a lifted fixture": (GRASP | {"of": "cabinet", "lift": [0, 0.1]}, SceneKeyError, "'cabinet' is no free object"),
    "no marker": ({"place": {"apple": "block"}}, UnknownNameError, "Valid: goal"),
    "another support": ({"place": {"cabinet": "goal"}}, SceneKeyError, ""),
    "no joint": ({"joints": {"cabinet": {"noise": 0.1}}}, SceneKeyError, "'object/joint'"),
    "a joint of nothing": ({"joints": {"cabinets/upper": {"noise": 0.1}}}, UnknownNameError, "start.0.joints"),
}


@pytest.mark.parametrize(("kind", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_kind_is_refused_with_its_number_and_advice(kind: dict, error: type[ScenirisError], says: str):
    """By the path of its key."""
    scene: dict[str, Any] = deepcopy(SCENE) | {"start": [kind]}
    scene["objects"]["goal"]["on"] = "cabinet/upper_drawer" if "cabinet" in kind.get("place", {}) else "floor"
    with pytest.raises(error) as caught:
        SceneConfig.load(scene)
    assert says in str(caught.value)
    assert "start.0" in str(caught.value)


def test_a_thing_that_carries_another_one_cannot_be_lifted():
    """It would leave the other one in the air."""
    scene: dict[str, Any] = deepcopy(SCENE) | {"start": [GRASP | {"lift": [0.0, 0.1]}]}
    scene["objects"]["apple"] = {"asset": "apple", "on": "block"}
    with pytest.raises(SceneKeyError, match="'apple' stands on 'block'"):
        SceneConfig.load(scene)
