"""Scene files: what they mean, and what is said of wrong ones."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.objects import JointConfig, ObjectConfig, SupportConfig
from sceniris_gym.config.scene import Floor, SceneConfig
from sceniris_gym.errors import (
    CycleError,
    NoSupportError,
    SceneFileError,
    SceneKeyError,
    ScenirisError,
    UnknownNameError,
)

SMALL = {
    "floor": {"size": [1.0, 2.0]},
    "objects": {
        "shelf": {"asset": "cabinet", "kind": "fixture", "on": "floor"},
        "apple": {"asset": "apple", "on": "shelf"},
        "goal": {"kind": "marker", "region": {"box": [[0, 0, 0], [1, 1, 1]]}},
    },
}


def write(folder: Path, name: str, text: str) -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_the_shipped_scene_mid_says_what_its_file_says():
    """Support, kind, joints and defaults of the scene `mid`."""
    mid = SceneConfig.load("mid")
    assert mid.name == "mid"
    assert mid.floor == Floor(size=(1.0, 1.0))
    assert list(mid.objects) == ["cabinet", "apple", "banana"]
    assert mid.objects["cabinet"].kind == "fixture"
    assert mid.objects["cabinet"].joints["upper"] == JointConfig(fraction=(0.7, 1.0))
    assert mid.objects["banana"].support == SupportConfig("on", "cabinet/upper_drawer")
    assert (mid.objects["apple"].kind, mid.objects["apple"].clearance, mid.objects["apple"].gap) == ("free", 1e-3, 5e-4)
    assert (mid.geometry, mid.attempts, mid.restarts) == ("physics", 10, 8)


def test_a_base_is_merged_key_by_key_and_the_child_wins():
    """`mid_16k` changes the geometry and two assets of `mid`, and keeps the rest."""
    base, child = SceneConfig.load("mid"), SceneConfig.load("mid_16k")
    assert child.name == "mid_16k"
    assert child.geometry == "visual"
    assert child.objects["apple"].asset == "apple_16k"
    assert child.objects["apple"].support == base.objects["apple"].support
    assert child.objects["cabinet"] == base.objects["cabinet"]


def test_a_word_of_the_child_replaces_the_base_s_word_of_the_same_group(tmp_path: Path):
    """`in` replaces `on`, a polygon a box, a value a fraction; nothing is given twice."""
    write(
        tmp_path,
        "base.yaml",
        "floor: {size: [1, 1]}\n"
        "objects: {apple: {asset: apple, on: floor, region: {box: [[0, 0], [1, 1]]}, "
        "joints: {stem: {fraction: [0, 1]}}}}\n",
    )
    child = write(
        tmp_path,
        "child.yaml",
        "base: base.yaml\nobjects: {apple: {in: floor, region: {polygon: [[0, 0], [1, 0], [0, 1]]}, "
        "joints: {stem: {value: 0.5}}}}\n",
    )
    apple = SceneConfig.load(child).objects["apple"]
    assert apple.support == SupportConfig("in", "floor")
    assert apple.region is not None
    assert apple.region.box is None
    assert apple.region.polygon == ((0, 0), (1, 0), (0, 1))
    assert apple.joints["stem"] == JointConfig(value=0.5)


def test_paths_are_relative_to_the_file_they_stand_in(tmp_path: Path):
    """A base in another folder finds its own assets there."""
    write(tmp_path, "base/base.yaml", "objects: {can: {asset: ./can.xml, kind: static}}")
    child = write(tmp_path, "child.yaml", "base: base/base.yaml\nobjects: {mug: {asset: parts/mug.xml, kind: static}}")
    config = SceneConfig.load(child)
    assert Path(str(config.objects["can"].asset)) == tmp_path / "base" / "can.xml"
    assert Path(str(config.objects["mug"].asset)) == tmp_path / "parts" / "mug.xml"


def test_a_file_is_read_as_yaml_1_2(tmp_path: Path):
    """`on` is a word and 1e-3 a number."""
    path = write(tmp_path, "a.yaml", "floor: {size: [1, 1]}\nobjects: {a: {asset: apple, on: floor, clearance: 1e-3}}")
    apple = SceneConfig.load(path).objects["a"]
    assert (apple.on, apple.clearance) == ("floor", 1e-3)


def test_overrides_replace_parts_by_dotted_keys():
    """Overrides work on names, dicts and configs, and leave the original alone."""
    changed = SceneConfig.load(SMALL, {"objects.apple.clearance": 0.01, "objects.apple.in": "floor", "attempts": 3})
    assert (changed.objects["apple"].clearance, changed.attempts) == (0.01, 3)
    assert changed.objects["apple"].support == SupportConfig("in", "floor")
    again = SceneConfig.load(changed, {"objects.apple.gap": 0.002})
    assert (again.objects["apple"].clearance, again.objects["apple"].gap) == (0.01, 0.002)
    assert changed.objects["apple"].gap == 0.0005
    assert SMALL["objects"]["apple"] == {"asset": "apple", "on": "shelf"}


def test_an_override_may_give_a_new_object_as_a_whole_and_then_change_it():
    """What is not there yet is one mapping; dotted keys that come after it reach into it."""
    pear = {"asset": "pear", "on": "floor"}
    changed = SceneConfig.load(SMALL, {"objects.pear": pear, "objects.pear.clearance": 0.01})
    assert list(changed.objects) == ["shelf", "apple", "goal", "pear"]
    assert (changed.objects["pear"].asset, changed.objects["pear"].clearance) == ("pear", 0.01)


@pytest.mark.parametrize(
    ("orientation", "yaw"),
    [(None, (-math.pi, math.pi)), ("fixed", (0, 0)), ({"yaw": [-90, 45]}, (-math.pi / 2, math.pi / 4))],
)
def test_yaw_is_an_interval_in_radians(orientation: Any, yaw: tuple[float, float]):
    """Degrees in files, radians in the API; any yaw by default."""
    config = SceneConfig.load(SMALL, {"objects.apple.orientation": orientation})
    assert config.objects["apple"].yaw == pytest.approx(yaw)


def test_a_scene_made_in_python_equals_one_read_from_a_dict():
    """Parts, arrays and plain values give the same scene, and the same canonical form."""
    made = SceneConfig(
        floor=Floor(size=np.array([1.0, 2.0])),  # type: ignore[arg-type]
        objects={
            "shelf": ObjectConfig(asset="cabinet", kind="fixture", on="floor"),
            "apple": ObjectConfig(asset="apple", on="shelf"),
            "goal": ObjectConfig.model_validate({"kind": "marker", "region": {"box": np.eye(2, 3) * 0 + [[0], [1]]}}),
        },
    )
    assert (made.floor, made.objects) == (SceneConfig.load(SMALL).floor, SceneConfig.load(SMALL).objects)
    assert made.canonical() == SceneConfig.load(SMALL).canonical()


def test_the_canonical_form_changes_with_what_shapes_layouts_only():
    """A knob changes it; the scene's name and the names of files do not."""
    canonical = SceneConfig.load(SMALL).canonical()
    assert SceneConfig.load(SMALL, {"objects.apple.gap": 0.001}).canonical() != canonical
    assert SceneConfig.load(SMALL, {"restarts": 0}).canonical() != canonical
    assert SceneConfig.load(SMALL, {"name": "other", "objects.apple.asset": "x/y.xml"}).canonical() == canonical
    assert json.loads(canonical)["objects"]["apple"]["on"] == "shelf"


def test_a_config_is_frozen():
    """A scene cannot change after it was validated."""
    with pytest.raises(ValueError, match="frozen"):
        SceneConfig.load("mid").attempts = 3


WRONG = {
    "unknown key": (
        {"objects.apple.clearence": 1},
        SceneKeyError,
        ["objects.apple.clearence", "mean 'clearance'"],
    ),
    "unknown key on top": ({"flor.size": [1, 1]}, SceneKeyError, ["flor:", "Did you mean 'floor'"]),
    "misplaced base": ({"objects.apple.base": "mid"}, SceneKeyError, ["objects.apple.base", "unknown key"]),
    "negative": ({"objects.apple.clearance": -1}, SceneKeyError, ["objects.apple.clearance: -1", "at least 0"]),
    "bool for number": ({"objects.apple.gap": True}, SceneKeyError, ["objects.apple.gap: True", "a number"]),
    "text for number": ({"objects.apple.gap": "1"}, SceneKeyError, ["objects.apple.gap: '1'", "a number"]),
    "not finite": ({"objects.apple.gap": math.inf}, SceneKeyError, ["objects.apple.gap", "finite"]),
    "fractional attempts": ({"attempts": 2.5}, SceneKeyError, ["attempts: 2.5", "whole number"]),
    "no attempts": ({"attempts": 0}, SceneKeyError, ["attempts: 0", "at least 1"]),
    "bool for word": ({"objects.apple.on": True}, SceneKeyError, ["objects.apple.on: True", "a name"]),
    "unknown kind": ({"objects.apple.kind": "fre"}, SceneKeyError, ["objects.apple.kind", "Did you mean 'free'"]),
    "unknown geometry": ({"geometry": "visuel"}, SceneKeyError, ["geometry", "Did you mean 'visual'"]),
    "no mapping": ({"objects.apple": 3}, SceneKeyError, ["objects.apple: 3", "a mapping"]),
    "wrong orientation": ({"objects.apple.orientation": "fixd"}, SceneKeyError, ["orientation: 'fixd'", "'fixed'"]),
    "yaw upside down": ({"objects.apple.orientation.yaw": [9, -9]}, SceneKeyError, ["orientation.yaw", "low <= high"]),
    "two supports": (
        {"objects.apple": {"asset": "apple", "on": "floor", "in": "shelf"}},
        SceneKeyError,
        ["objects.apple:", "has on and in"],
    ),
    "static on something": ({"objects.apple.kind": "static"}, SceneKeyError, ["objects.apple:", "stays where"]),
    "two forms of region": (
        {"objects.apple.region": {"box": [[0, 0], [1, 1]], "fraction": [[0, 0], [1, 1]]}},
        SceneKeyError,
        ["objects.apple.region", "exactly one of box, fraction, polygon"],
    ),
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
    "3D box on a support": (
        {"objects.apple.region.box": [[0, 0, 0], [1, 1, 1]]},
        SceneKeyError,
        ["objects.apple:", "two dimensions"],
    ),
    "2D box without support": (
        {"objects.goal.region.box": [[0, 0], [1, 1]]},
        SceneKeyError,
        ["objects.goal:", "name its support"],
    ),
    "3D box too far away": (
        {"objects.goal.region.box": [[0, 0, 0], [1, 101, 1]]},
        SceneKeyError,
        ["objects.goal.region:", "within 100 m of the world's origin"],
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
    "short floor": ({"floor.size": [1]}, SceneKeyError, ["floor.size.1", "missing"]),
    "long floor": ({"floor.size": [1, 1, 1]}, SceneKeyError, ["floor.size", "2 values"]),
    "empty floor": ({"floor.size": [0, 1]}, SceneKeyError, ["floor.size.0: 0", "above 0"]),
    "endless floor": ({"floor.size": [1, 201]}, SceneKeyError, ["floor.size.1: 201", "at most 200"]),
    "bad name": ({"objects.an apple": {"asset": "apple"}}, SceneKeyError, ["an apple", "letters, digits"]),
    "taken name": ({"objects.floor": {"asset": "apple"}}, SceneKeyError, ["objects.floor", "taken by the scene"]),
    "no asset": ({"objects.pear": {"on": "floor"}}, SceneKeyError, ["objects.pear.asset", "missing"]),
    "robot without asset": ({"robot.yaw": 3}, SceneKeyError, ["robot.asset", "missing"]),
    "empty dotted key": ({"objects..apple": 3}, SceneKeyError, ["overrides", "dotted key"]),
    "part of an unknown object": (
        {"objects.aple.clearance": 0.1},
        UnknownNameError,
        ["overrides: objects.aple.clearance", "unknown object 'aple'", "mean 'apple'"],
    ),
    "part of an unknown group": ({"groups.fruit.present": 1}, UnknownNameError, ["unknown group 'fruit'", "none"]),
    "between": ({"objects.apple.between": ["goal"]}, SceneKeyError, ["objects.apple.between", "in 'relations'"]),
    "front_of": ({"objects.apple.front_of": "shelf"}, SceneKeyError, ["objects.apple.front_of", "in 'relations'"]),
    "reachable without a robot": (
        {"objects.apple.reachable": "map"},
        SceneKeyError,
        ["objects.apple.reachable", "there is no robot"],
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
    "reachable static": (
        {"objects.post": {"asset": "cabinet", "kind": "static", "reachable": True}},
        SceneKeyError,
        ["objects.post", "should be placed"],
    ),
    "by without reachable": ({"objects.apple.by": "robot"}, SceneKeyError, ["objects.apple", "what is 'reachable'"]),
    "by another": (
        {"objects.apple.reachable": True, "objects.apple.by": "shelf"},
        SceneKeyError,
        ["objects.apple.by", "should be 'robot'"],
    ),
    "unknown parent": (
        {"objects.apple.on": "shelff/top"},
        UnknownNameError,
        ["objects.apple.on", "mean 'shelf'"],
    ),
    "no floor": ({"floor": None}, UnknownNameError, ["objects.shelf.on", "no floor"]),
    "marker as parent": ({"objects.apple.on": "goal"}, NoSupportError, ["objects.apple.on", "'goal' is a marker"]),
    "cycle": ({"objects.shelf.on": "apple/leaf"}, CycleError, ["shelf -> apple -> shelf"]),
    "itself": ({"objects.apple.on": "apple"}, CycleError, ["apple -> apple"]),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_scene_is_refused_by_file_path_and_advice(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Every wrong key or value names the file, the key's path, and what would be right."""
    path = write(tmp_path, "wrong.yaml", json.dumps(SMALL))
    with pytest.raises(error) as caught:
        SceneConfig.load(path, overrides)
    if says[0] != "overrides":
        says = [str(path), *says]
    for text in says:
        assert text in str(caught.value)
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__ or caught.value.__context__ is None


def test_all_wrong_keys_are_told_at_once():
    """One message lists every problem of a scene, a line for each."""
    with pytest.raises(SceneKeyError) as caught:
        SceneConfig.load(SMALL, {"attempts": 0, "objects.apple.gap": -1, "objects.goal.knd": 1})
    assert len(str(caught.value).splitlines()) == 3


def test_the_word_on_read_as_true_by_another_loader_is_recognised():
    """A loader of YAML 1.1 turns the key `on` into true; the error says so."""
    with pytest.raises(SceneKeyError, match=r"objects\.a\.True.*YAML 1\.1"):
        SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"a": {"asset": "apple", True: "floor"}}})


def test_python_construction_is_judged_like_a_file():
    """Parts and scenes made in Python raise the same errors, without pydantic's."""
    with pytest.raises(SceneKeyError, match=r"ObjectConfig: clearance: -1 should be at least 0"):
        ObjectConfig(asset="apple", clearance=-1)
    with pytest.raises(SceneKeyError, match=r"ObjectConfig: onn: unknown key\. Did you mean 'on'"):
        ObjectConfig(asset="apple", onn="floor")  # type: ignore[call-arg]
    with pytest.raises(SceneKeyError, match=r"JointConfig: scene: .*exactly one of .*, and has value and noise"):
        JointConfig(value=1.0, noise=1.0)
    with pytest.raises(SceneKeyError, match=r"SceneConfig: objects\.a\.gap: 'x' should be a number"):
        SceneConfig(objects={"a": {"asset": "apple", "gap": "x"}})  # type: ignore[dict-item]
    with pytest.raises(UnknownNameError, match="unknown support 'floor'"):
        SceneConfig(objects={"a": ObjectConfig(asset="apple", on="floor")})


@pytest.mark.parametrize("floor", [{"floor": {"size": [1, 1]}}, {}], ids=["floor", "no floor"])
def test_an_object_is_not_advised_to_stand_on_itself(floor: dict):
    """Nor on a marker, which has no surface."""
    objects = {"flo": {"asset": "apple", "on": "flor"}, "goal": {"kind": "marker", "region": {"box": [[0] * 3] * 2}}}
    with pytest.raises(UnknownNameError) as caught:
        SceneConfig.load({**floor, "objects": {**objects, "desk": {"asset": "table", "kind": "static"}}})
    assert caught.value.valid == sorted(["desk", *floor])


BAD_FILES = {
    "duplicate key": (
        "floor: {size: [1, 1]}\nattempts: 3\nattempts: 4\n",
        r"scene\.yaml:3: .*duplicate key .attempts",
    ),
    "no YAML": ("floor: [1, 1\n", r"scene\.yaml:\d+: this is not YAML"),
    "two documents": ("floor: null\n---\nfloor: null\n", r"scene\.yaml:\d+: this is not YAML"),
    "a control character": ("floor: \x07\n", r"scene\.yaml: this is not YAML"),
    "an unknown tag": ("floor: !!python/object:os.system {}\n", r"scene\.yaml:1: this is not YAML"),
    "nested without end": ("floor: " + 20_000 * "[" + 20_000 * "]", r"scene\.yaml: .*nested too deeply"),
    "empty": ("", r"a mapping of keys.*found nothing"),
    "a list": ("- 1\n", r"a mapping of keys.*found a list"),
}


@pytest.mark.parametrize(("text", "says"), BAD_FILES.values(), ids=BAD_FILES.keys())
def test_a_file_that_is_no_scene_is_refused_by_its_line(tmp_path: Path, text: str, says: str):
    """Files that are not YAML, or not a mapping, or give a key twice."""
    with pytest.raises(SceneFileError, match=says):
        SceneConfig.load(write(tmp_path, "scene.yaml", text))


def test_a_missing_file_or_name_is_refused_with_what_there_is(tmp_path: Path):
    """A missing path lists the shipped scenes; a wrong name gets the nearest one."""
    with pytest.raises(SceneFileError, match=r"no scene file '.*nowhere\.yaml'.*mid, mid_16k"):
        SceneConfig.load(tmp_path / "nowhere.yaml")
    with pytest.raises(SceneFileError, match="no scene file"):
        SceneConfig.load(tmp_path)
    with pytest.raises(UnknownNameError, match=r"unknown shipped scene 'midd'\. Did you mean 'mid'"):
        SceneConfig.load("midd")
    with pytest.raises(UnknownNameError, match=r"child\.yaml: base: unknown shipped scene 'mdi'"):
        SceneConfig.load(write(tmp_path, "child.yaml", "base: mdi"))
    with pytest.raises(SceneKeyError, match=r"base: 3 should be the name"):
        SceneConfig.load({"base": 3})


def test_bases_in_a_circle_are_an_error_that_names_it(tmp_path: Path):
    """Files that are the base of each other."""
    write(tmp_path, "a.yaml", "base: ./b.yaml")
    write(tmp_path, "b.yaml", "base: ./a.yaml")
    with pytest.raises(CycleError, match=r"a\.yaml -> .*b\.yaml -> .*a\.yaml"):
        SceneConfig.load(tmp_path / "a.yaml")


@pytest.mark.parametrize("word", ["attempts", "restarts"])
def test_counts_that_would_never_end_are_refused(word: str):
    """A thousand times more than any scene needs, and within what the device counts with."""
    with pytest.raises(SceneKeyError, match=f"{word}: 3000000000 should be"):
        SceneConfig.load({word: 3_000_000_000})


def test_reachable_is_false_true_or_a_tier():
    """Every tier is read, survives overrides and counts for the scene's hash; false is the same as nothing."""
    robot = {"robot": {"asset": "panda"}}
    plain = SceneConfig.load(SMALL, robot)
    assert plain.objects["apple"].reachable is False
    assert "reachable" not in plain.canonical()
    seen = {plain.canonical()}
    for tier in (True, "map", "map_strict", "ik", "clear"):
        config = SceneConfig.load(SMALL, {**robot, "objects.apple.reachable": tier, "objects.apple.by": "robot"})
        again = SceneConfig.load(config, {"objects.apple.clearance": 0.002})
        assert again.objects["apple"].reachable == tier
        seen.add(config.canonical())
    assert len(seen) == 6
    assert SceneConfig.load(SMALL, {**robot, "objects.apple.reachable": False}).canonical() == plain.canonical()
