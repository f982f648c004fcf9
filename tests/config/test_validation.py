"""Names in a scene: that they are there, can be referred to, and can be placed one after the other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from tests.config.scenes import CLUTTER, NEAR, NEIGHBOURS, SMALL, TABLE, grouped, refusal, refused, related

WRONG: dict[str, tuple] = {
    "no asset": (SMALL, {"objects.pear": {"on": "floor"}}, SceneKeyError, ["objects.pear.asset", "missing"]),
    "reachable without a robot": (
        SMALL,
        {"objects.apple.reachable": "map"},
        SceneKeyError,
        ["objects.apple.reachable", "the scene has no robot"],
    ),
    "unknown parent": (
        SMALL,
        {"objects.apple.on": "shelff/top"},
        UnknownNameError,
        ["objects.apple.on", "mean 'shelf'"],
    ),
    "no floor": (SMALL, {"floor": None}, UnknownNameError, ["objects.shelf.on", "no floor"]),
    "marker as parent": (
        SMALL,
        {"objects.apple.on": "goal"},
        SceneKeyError,
        ["objects.apple.on", "'goal' is a marker"],
    ),
    "cycle": (SMALL, {"objects.shelf.on": "apple/leaf"}, SceneKeyError, ["shelf -> apple -> shelf"]),
    "itself": (SMALL, {"objects.apple.on": "apple"}, SceneKeyError, ["apple -> apple"]),
    "an unknown target": (
        NEIGHBOURS,
        {"objects.apple.orientation": {"face_to": "cabine"}},
        UnknownNameError,
        ["objects.apple.orientation.face_to", "mean 'cabinet'"],
    ),
    "an unknown heading": (
        NEIGHBOURS,
        {"objects.apple.orientation": {"with": "cabine"}},
        UnknownNameError,
        ["objects.apple.orientation.with", "mean 'cabinet'"],
    ),
    "its own heading": (
        NEIGHBOURS,
        {"objects.apple.orientation": {"with": "apple"}},
        SceneKeyError,
        ["objects.apple.orientation.with: 'apple'", "a different object"],
    ),
    **{
        f"the heading of {lying} objects": (
            NEIGHBOURS,
            {"objects.apple.orientation": {"with": "mug"}, "objects.mug.orientation": lying},
            SceneKeyError,
            ["objects.apple.orientation.with: 'mug' may lie on its side", "name another object"],
        )
        for lying in ("any", "stable")
    },
    "the heading of a variant that lies": (
        NEIGHBOURS,
        {
            "objects.mug.variants": {"mug": {"asset": "mug"}, "can": {"asset": "can", "orientation": "stable"}},
            "objects.mug.asset": None,
            "objects.apple.orientation": {"with": "mug"},
        },
        SceneKeyError,
        ["objects.apple.orientation.with: 'mug' may lie on its side"],
    ),
    "itself as target": (
        NEIGHBOURS,
        {"objects.apple.orientation": {"face_to": "apple"}},
        SceneKeyError,
        ["objects.apple.orientation.face_to: 'apple'", "a different object"],
    ),
    "an unknown member": (
        TABLE,
        {"groups.clutter": {"of": ["can", "bowel"], "count": 1}},
        UnknownNameError,
        ["groups.clutter.of", "mean 'bowl'"],
    ),
    "the robot": (
        TABLE,
        {"groups.clutter": {"of": ["robot"], "count": 1}},
        UnknownNameError,
        ["unknown object 'robot'"],
    ),
    "a static member": (
        TABLE,
        {"groups.clutter": {"of": ["post"], "count": 1}},
        SceneKeyError,
        ["groups.clutter.of: 'post'", "cannot be absent"],
    ),
    "a member of two groups": (
        TABLE,
        {"groups": {"clutter": CLUTTER, "cups": {"of": ["mug"], "count": 1}}},
        SceneKeyError,
        ["groups.cups.of: 'mug'", "also in the group 'clutter'"],
    ),
}


@pytest.mark.parametrize(("scene", "overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_name_that_cannot_be_referred_to_is_refused(
    tmp_path: Path, scene: dict, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Supports, targets, members of groups, and what an object would need that has no asset or no robot."""
    refused(tmp_path, scene, overrides, error, says)


WRONG_RELATIONS: dict[str, tuple] = {
    "an unknown anchor": ([NEAR, {"front_of": "cabinat"}], UnknownNameError, ["relations.1.front_of", "'cabinet'"]),
    "an unknown one of two": ([{"between": ["mug", "mugg"]}], UnknownNameError, ["relations.0.between", "'mug'"]),
    "an unknown of": ([{"direction": [1, 0], "of": "pot"}], UnknownNameError, ["relations.0.of", "Valid: cabinet"]),
    "the floor": ([{"front_of": "floor"}], UnknownNameError, ["relations.0.front_of", "unknown object 'floor'"]),
    "a part": ([{"front_of": "cabinet/upper_drawer"}], UnknownNameError, ["relations.0.front_of"]),
    "itself": ([{"front_of": "apple"}], SceneKeyError, ["relations.0.front_of: 'apple'", "a different object"]),
    "its own frame": ([{"front_of": "mug", "frame": "apple"}], SceneKeyError, ["relations.0.frame: 'apple'"]),
    "an unknown frame": ([{"front_of": "mug", "frame": "ancor"}], UnknownNameError, ["relations.0.frame", "'anchor'"]),
}


@pytest.mark.parametrize(("relations", "error", "says"), WRONG_RELATIONS.values(), ids=WRONG_RELATIONS.keys())
def test_a_relation_to_what_is_not_there_is_refused(
    tmp_path: Path, relations: Any, error: type[ScenirisError], says: list[str]
):
    """By its place in the list, with what would be right."""
    refused(tmp_path, NEIGHBOURS, {"objects.apple.relations": relations}, error, ["objects.apple.", *says])


@pytest.mark.parametrize("floor", [{"floor": {"size": [1, 1]}}, {}], ids=["floor", "no floor"])
def test_an_object_is_not_advised_to_stand_on_itself(floor: dict):
    """Nor on a marker, which has no surface."""
    objects = {"flo": {"asset": "apple", "on": "flor"}, "goal": {"kind": "marker", "region": {"box": [[0] * 3] * 2}}}
    with pytest.raises(UnknownNameError) as caught:
        SceneConfig.load({**floor, "objects": {**objects, "desk": {"asset": "table", "kind": "static"}}})
    assert caught.value.valid == sorted(["desk", *floor])


def test_the_robot_may_be_an_anchor_and_a_frame():
    """By the name 'robot', where there is one."""
    robot = {"robot": {"asset": "panda"}}
    apple = related({"front_of": "robot", "frame": "robot"}, **robot).objects["apple"]
    assert apple.needs == ("robot",)
    with pytest.raises(UnknownNameError, match="unknown object 'robot'"):
        related({"front_of": "robot"})


def test_markers_may_be_related():
    """A point may be placed by every word; the strip between others needs a width."""
    goal = SceneConfig.load(
        NEIGHBOURS,
        {"objects.goal.relations": [NEAR, {"between": ["cabinet", "mug"], "width": 0.1}, {"left_of": "post"}]},
    ).objects["goal"]
    assert [relation.word for relation in goal.relations] == ["near", "between", "left_of"]


def test_a_circle_of_references_is_an_error_that_names_it():
    """Parents, anchors, frames and targets are all edges."""
    with pytest.raises(SceneKeyError, match="placed relative to each other: cabinet -> mug -> cabinet"):
        SceneConfig.load(NEIGHBOURS, {"objects.cabinet.relations": [{"front_of": "mug"}]})
    with pytest.raises(SceneKeyError, match="apple -> goal -> apple"):
        related({"front_of": "cabinet", "frame": "goal"}, **{"objects.goal.relations": [{"left_of": "apple"}]})
    with pytest.raises(SceneKeyError, match="cabinet -> apple -> mug -> cabinet"):
        related(
            {"between": ["post", "mug"]},
            **{"objects.cabinet.orientation": {"face_to": "apple"}},
        )
    with pytest.raises(SceneKeyError, match="cabinet -> mug -> cabinet"):
        SceneConfig.load(NEIGHBOURS, {"objects.cabinet.orientation": {"with": "mug"}})


REFERENCES = {
    "relations.0.front_of": {"objects.apple.relations": [{"front_of": "can"}]},
    "relations.0.frame": {"objects.apple.relations": [{"front_of": "table", "frame": "can"}]},
    "relations.0.between": {"objects.apple.relations": [{"between": ["table", "can"]}]},
    "orientation.face_to": {"objects.apple.orientation": {"face_to": "can"}},
    "orientation.with": {"objects.apple.orientation": {"with": "can"}},
}


@pytest.mark.parametrize(("path", "overrides"), REFERENCES.items(), ids=REFERENCES.keys())
def test_a_reference_to_what_may_be_absent_is_refused_unless_it_may_be_dropped(path: str, overrides: dict):
    """Anchors, frames and targets; one that is always present may be referred to."""
    with pytest.raises(SceneKeyError, match=rf"objects\.apple\.{path}: 'can' may be absent.*'missing: drop'"):
        grouped(CLUTTER, **overrides)
    assert grouped(CLUTTER | {"missing": "drop"}, **overrides).groups["clutter"].missing == "drop"
    assert grouped(CLUTTER | {"count": 3}, **overrides).groups["clutter"].always_whole


@pytest.mark.parametrize("word", ["on", "inside", "in"])
@pytest.mark.parametrize("missing", ["refuse", "drop"])
def test_what_stands_on_what_may_be_absent_may_be_absent_too(word: str, missing: str):
    """Whatever becomes of relations; on what is always present it is always present."""
    place = {f"objects.apple.{word}": "bowl"}
    assert "apple" in grouped(CLUTTER | {"missing": missing}, **place).absent
    assert "apple" not in grouped(CLUTTER | {"missing": missing, "count": 3}, **place).absent


def test_members_of_a_group_may_refer_to_what_is_outside_of_it():
    """A member stands and looks as any other object does."""
    config = grouped(CLUTTER, **{"objects.can.relations": [{"front_of": "apple"}]})
    assert config.objects["can"].needs == ("table", "apple")


def test_an_object_without_an_asset_is_a_body_of_the_scene_s_model(tmp_path: Path):
    """With a model of its own a scene may leave out assets; a marker needs none in any scene."""
    objects = {"mug": {"kind": "static"}, "goal": {"kind": "marker", "region": {"box": [[0] * 3] * 2}}}
    model = tmp_path / "room.xml"
    assert list(SceneConfig.load({"model": str(model), "objects": objects}).objects) == ["mug", "goal"]
    assert "objects.mug.asset: is missing" in refusal({"objects": objects}, {}, SceneKeyError)


def test_a_variant_without_an_asset_is_told_by_the_key_that_the_file_has():
    """Of the object, which may have the asset of all; there is no body that could take its place."""
    objects: dict[str, Any] = {"cup": {"variants": {"wide": {}, "tall": {"asset": "can"}}, "on": "floor"}}
    scene = {"floor": {"size": [1, 1]}, "objects": objects}
    said = refusal(scene, {}, SceneKeyError)
    assert "objects.cup.variants: 'wide' has no asset. Give this variant an 'asset', or give" in said
    assert "body" not in said
    objects["cup"]["asset"] = "tin"
    SceneConfig.load(scene)


def test_many_objects_that_refer_to_each_other_are_checked_in_no_time():
    """Each chain is followed once: with every object related to four before it there are 4^28 chains."""
    objects: dict[str, dict] = {f"o{i}": {"asset": "mug", "on": "floor"} for i in range(32)}
    for i in range(4, 32):
        objects[f"o{i}"]["relations"] = [{"left_of": f"o{i - k}"} for k in range(1, 5)]
    config = SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects})
    assert config.objects["o31"].needs == ("o30", "o29", "o28", "o27")
    assert "o0 -> o31" in refusal(
        config, {"objects.o0.relations": [{"near": "o31", "distance": {"max": 1}}]}, SceneKeyError
    )


def test_a_chain_may_be_longer_than_python_can_call_itself():
    """1,200 objects, each near the next; a cycle at its end is found by its names."""
    objects = {
        f"o{i}": {"asset": "apple", "on": "floor", "relations": [{"near": f"o{i + 1}", "distance": {"max": 1}}]}
        for i in range(1200)
    }
    scene: dict = {"floor": {"size": [50, 50]}, "objects": {**objects, "o1200": {"asset": "apple", "on": "floor"}}}
    assert len(SceneConfig.load(scene).objects) == 1201
    scene["objects"]["o1200"]["relations"] = [{"near": "o1199", "distance": {"max": 1}}]
    with pytest.raises(SceneKeyError, match="o1199 -> o1200 -> o1199"):
        SceneConfig.load(scene)
