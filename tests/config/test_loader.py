"""Scene files: how they are found, read, merged and changed, how much they may mean, and what is no path."""

from __future__ import annotations

import copy
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.loader import MOST_VALUES, expanded_size, merge, override, read_scene, shipped, user_path
from sceniris_gym.config.objects import JointConfig, SupportConfig
from sceniris_gym.config.orientation import DrawnOrientation
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentTypeError, SceneFileError, SceneKeyError, ScenirisError, UnknownNameError
from tests.config.scenes import NEIGHBOURS, SMALL, refusal, refused, write


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


def test_a_form_of_orientation_replaces_the_base_s():
    """A yaw of the base is no offset of the child's face_to."""
    base = SceneConfig.load(NEIGHBOURS, {"objects.apple.orientation": {"yaw": [-10, 10]}})
    child = SceneConfig.load(base, {"objects.apple.orientation": {"face_to": "mug"}})
    assert child.objects["apple"].drawn_orientation == DrawnOrientation("face_to", (0.0, 0.0), "mug")
    turned = SceneConfig.load(base, {"objects.apple.orientation": {"with": "mug"}})
    assert turned.objects["apple"].drawn_orientation == DrawnOrientation("with", (0.0, 0.0), "mug")
    assert (
        SceneConfig.load(child, {"objects.apple.orientation.stable": {}}).objects["apple"].drawn_orientation.kind
        == "stable"
    )


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


def test_an_override_may_give_a_new_object_as_a_whole_and_then_change_it():
    """A new object is given as one mapping; dotted keys that come after it reach into it."""
    pear = {"asset": "pear", "on": "floor"}
    changed = SceneConfig.load(SMALL, {"objects.pear": pear, "objects.pear.clearance": 0.01})
    assert list(changed.objects) == ["shelf", "apple", "goal", "pear"]
    assert (changed.objects["pear"].asset, changed.objects["pear"].clearance) == ("pear", 0.01)


WRONG: dict[str, tuple] = {
    "part of an unknown object": (
        {"objects.aple.clearance": 0.1},
        UnknownNameError,
        ["overrides: objects.aple.clearance", "unknown object 'aple'", "mean 'apple'"],
    ),
    "part of an unknown group": ({"groups.fruit.present": 1}, UnknownNameError, ["unknown group 'fruit'", "none"]),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_an_override_of_what_is_not_there_is_refused(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """By the dotted key, with the nearest name that there is."""
    refused(tmp_path, SMALL, overrides, error, says)


@pytest.mark.parametrize("dotted", ["objects..apple", "", ".objects", 3], ids=repr)
def test_an_override_without_a_dotted_key_is_refused(dotted: Any):
    """Words with dots between them; nothing is to be guessed."""
    said = refusal(SMALL, {dotted: 3}, SceneKeyError)
    assert said == f"overrides: {dotted!r} should be a dotted key such as 'objects.apple.clearance'."


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
    "empty": ("", r"a mapping with keys.*found nothing"),
    "a list": ("- 1\n", r"a mapping with keys.*found a list"),
    "a problem file": ("(define (problem P)\n  (:domain robosuite))\n", r"found a str.*`sceniris-gym init`"),
}


@pytest.mark.parametrize(("text", "says"), BAD_FILES.values(), ids=BAD_FILES.keys())
def test_a_file_that_is_no_scene_is_refused_by_its_line(tmp_path: Path, text: str, says: str):
    """Files that are not YAML, or not a mapping, or give a key twice."""
    with pytest.raises(SceneFileError, match=says):
        SceneConfig.load(write(tmp_path, "scene.yaml", text))


def test_a_missing_file_or_name_is_refused_with_what_there_is(tmp_path: Path):
    """A missing path lists the shipped scenes; a wrong name gets the nearest one."""
    with pytest.raises(SceneFileError, match=r"nowhere\.yaml': there is no such scene file.*mid, mid_16k"):
        SceneConfig.load(tmp_path / "nowhere.yaml")
    with pytest.raises(SceneFileError, match="it is a folder, a pipe or a device, not a file"):
        SceneConfig.load(tmp_path)
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(SceneFileError, match="it is a folder, a pipe or a device, not a file"):
        SceneConfig.load(tmp_path / "pipe.yaml")
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
    with pytest.raises(SceneKeyError, match=r"a\.yaml -> .*b\.yaml -> .*a\.yaml"):
        SceneConfig.load(tmp_path / "a.yaml")


def test_merging_leaves_both_scenes_as_they_are():
    """The base of many children is read once and may be merged many times."""
    base = {"floor": {"size": [1, 1]}, "objects": {"a": {"asset": "mug", "on": "floor"}}}
    child = {"objects": {"a": {"in": "floor"}, "b": {"asset": "can"}}, "floor": None}
    before = copy.deepcopy((base, child))
    merged = {"floor": None, "objects": {"a": {"asset": "mug", "in": "floor"}, "b": {"asset": "can"}}}
    assert merge(base, child) == merged
    assert (base, child) == before
    assert override(base, {"objects.a.in": "floor"}, "scene")["objects"] == {"a": merged["objects"]["a"]}
    assert base == before[0]


def test_words_of_a_group_replace_each_other_at_their_place_alone():
    """A joint's `fraction` replaces its `value`, and leaves the `box` of a region, whose form it could be too."""
    base = {
        "objects": {"a": {"region": {"box": 1}, "joints": {"j": {"value": 2}}}},
        "robot": {"joints": {"j": {"noise": 3}}},
    }
    child = {"objects": {"a": {"joints": {"j": {"fraction": 4}}}}, "robot": {"joints": {"j": {"choice": 5}}}}
    merged = merge(base, child)
    assert merged["objects"]["a"] == {"region": {"box": 1}, "joints": {"j": {"fraction": 4}}}
    assert merged["robot"] == {"joints": {"j": {"choice": 5}}}


@pytest.mark.parametrize("path", [("robot",), ("robots", "left"), ("objects", "a")])
def test_the_words_for_where_a_base_is_drawn_replace_each_other_as_those_of_objects_do(path: tuple[str, ...]):
    """The forms of a region and of an orientation: a scene may have points where its base has a box."""
    base: dict = {"region": {"box": 1}, "orientation": {"yaw": 2}}
    child: dict = {"region": {"points": 3}, "orientation": {"face_to": 4}}
    for key in reversed(path):  # pyrefly: ignore[non-convergent-recursion]
        base, child = {key: base}, {key: child}  # pyrefly: ignore[non-convergent-recursion]
    assert merge(base, child) == child


def test_overrides_are_laid_over_one_after_the_other():
    """A later one of the same key wins, and one of a mapping keeps what it does not name."""
    changed = override(SMALL, {"floor.size": [3, 3], "floor": {"size": [4, 4]}, "objects.apple.gap": 0.1}, "scene")
    assert changed["floor"] == {"size": [4, 4]}
    assert changed["objects"]["apple"] == {"asset": "apple", "on": "shelf", "gap": 0.1}
    assert list(changed["objects"]) == list(SMALL["objects"])


def test_a_scene_is_read_from_a_mapping_as_from_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The same data under another name; paths in a mapping are relative to the working directory."""
    monkeypatch.chdir(tmp_path)
    data = {"model": "room.xml", "objects": {"a": {"asset": "./mug.xml"}, "b": {"asset": "mug"}}}
    file, mapping = read_scene(write(tmp_path, "room.yaml", json.dumps(data))), read_scene(data)
    assert file.data == mapping.data
    assert (file.name, mapping.name) == ("room", "scene")
    assert (file.where, mapping.where) == (str(tmp_path / "room.yaml"), "scene")
    assert Path(mapping.data["model"]) == tmp_path / "room.xml"
    assert Path(mapping.data["objects"]["a"]["asset"]) == tmp_path / "mug.xml"
    assert mapping.data["objects"]["b"]["asset"] == "mug"
    assert data["model"] == "room.xml"


def test_messages_name_the_base_that_a_key_may_stand_in(tmp_path: Path):
    """The wrong key may be in either file, so both are told."""
    base = write(tmp_path, "base.yaml", "attempts: 0")
    child = write(tmp_path, "child.yaml", "base: ./base.yaml")
    said = refusal(child, {}, SceneKeyError)
    assert said.startswith(f"{child} (base: {base}): attempts: 0")


def test_shipped_files_are_found_by_their_stems():
    """Those of the package that have this ending, and no others."""
    found = shipped("envs", ".yaml")
    assert found.keys() == {path.stem for path in (Path(__file__).parents[2] / "envs").glob("*.yaml")}
    assert all(path.is_file() and path.name == f"{name}.yaml" for name, path in found.items())


@pytest.mark.parametrize("scene", [None, 5, [1], b"mid"])
def test_what_is_no_scene_is_refused_by_its_type(scene: Any):
    """With what would be one."""
    with pytest.raises(ArgumentTypeError, match=r"scene should be the name of a shipped scene, .* or a mapping"):
        SceneConfig.load(scene)


@pytest.mark.parametrize("overrides", [[1], "objects.apple.gap=1", 5, np.zeros(2)])
def test_overrides_are_a_mapping(overrides: Any):
    """Nothing else has keys."""
    with pytest.raises(ArgumentTypeError, match="overrides should be a mapping"):
        SceneConfig.load(SMALL, overrides)


@pytest.mark.parametrize("text", ["attempts: " + "9" * 5000, "attempts: 2001-99-99", "a: " + "[" * 5000])
def test_values_that_python_cannot_make_are_refused(tmp_path: Path, text: str):
    """Numbers of 5,000 digits, days that no month has, lists in lists."""
    with pytest.raises(SceneFileError, match=r"wrong\.yaml"):
        SceneConfig.load(write(tmp_path, "wrong.yaml", text))


def test_a_number_of_many_digits_is_not_written_out():
    """Python does not write it, so a message cannot."""
    assert "attempts: a int should be at most" in refusal(SMALL, {"attempts": 10**5000}, SceneKeyError)


def test_a_dotted_key_has_an_end():
    """Merging goes as deep as the key."""
    assert "16 keys at most, has 3000" in refusal(SMALL, {".".join("a" * 3000): 1}, SceneKeyError)


def test_a_file_without_anchors_is_not_expanded():
    """Each value is there once."""
    assert expanded_size("a: [1, 2]\nb: 3\n") == 0


def test_aliases_count_as_often_as_they_stand():
    """A mapping of one key with a list of two numbers, and the list once more."""
    assert expanded_size("a: &x [1, 2]\nb: *x\n") == 1 + 2 + 2 * 3


@pytest.mark.parametrize("form", ["<<: [{}]", "k: [{}]"], ids=["merges", "lists"])
def test_a_bomb_is_refused_before_it_is_built(tmp_path: Path, form: str):
    """Nine to the power of twelve values in twelve lines, as merges and as plain lists."""
    lines = ["a0: &a0 {x: 1, y: 2}"]
    lines += [f"a{i}: &a{i} {{{form.format(', '.join([f'*a{i - 1}'] * 9))}}}" for i in range(1, 13)]
    assert expanded_size("\n".join(lines)) == MOST_VALUES + 1
    with pytest.raises(
        SceneFileError, match=r"bomb\.yaml: has more than 1000000 values after its aliases and merges are expanded"
    ):
        SceneConfig.load(write(tmp_path, "bomb.yaml", "\n".join(lines)))


def test_a_value_that_holds_itself_is_refused(tmp_path: Path):
    """Written out it has no end."""
    with pytest.raises(SceneFileError, match="more than 1000000 values"):
        SceneConfig.load(write(tmp_path, "loop.yaml", "objects: &x {a: *x}"))


def test_a_path_is_below_its_folder_unless_it_is_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """And `~` is the home folder."""
    monkeypatch.setenv("HOME", "/home/somebody")
    assert user_path("a/b.xml", tmp_path, "scene") == tmp_path / "a/b.xml"
    assert user_path("/a/b.xml", tmp_path, "scene") == Path("/a/b.xml")
    assert user_path("~/b.xml", tmp_path, "scene") == Path("/home/somebody/b.xml")


@pytest.mark.parametrize(
    ("text", "says"), [("~nosuchuser/a.xml", "there is no such user"), ("a/" * 3000 + "a.xml", "name too long")]
)
def test_what_is_no_path_is_refused_by_its_key(text: str, says: str):
    """As the scene itself, as a model, and as an asset; a long one is not shown whole."""
    apple = {"asset": text, "on": "floor"}
    for scene, key in (
        (text, "scene"),
        ({**SMALL, "model": text}, "scene: model"),
        ({**SMALL, "objects": {"apple": apple}}, "scene: asset"),
    ):
        with pytest.raises(SceneFileError, match=f"{key}: .*{says}") as found:
            SceneConfig.load(scene)
        assert len(str(found.value)) < 300
