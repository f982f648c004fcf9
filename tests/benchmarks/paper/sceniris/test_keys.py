"""Keys of the original package's configurations: how each is read, and which are told as left out."""

from __future__ import annotations

import copy
import math
import pickle
import re
import warnings
from typing import Any

import pytest

from benchmarks.paper.sceniris.keys import KeyReader, KeysLeftOutWarning, Notes, in_its_keys, origin
from benchmarks.paper.sceniris.reader import read_sceniris
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError, in_a_cycle
from tests.benchmarks.paper.sceniris.configurations import ONE, QUARTER_TURN, mug, read


def test_a_key_that_nothing_reads_is_left_out():
    """It is named once, and one without a value is not."""
    config, left_out = read(mug(colour="red", tag=None))
    assert left_out == ["objects.mug.colour"]
    assert list(config.objects) == ["mug", "drawer", "apple"]


def test_the_warning_can_be_made_an_error():
    """It names all keys of the configuration that are left out, on all levels, and then stops the reading."""
    cfg = mug(reachable=True) | {"env": {"num_envs": 4, "collision_checker_backend": "curobo"}, "other": 1}
    with pytest.warns(KeysLeftOutWarning, match=r"env\.num_envs, env\.collision_checker_backend, .*reachable, other"):
        read_sceniris(cfg)
    with warnings.catch_warnings():
        warnings.simplefilter("error", KeysLeftOutWarning)
        with pytest.raises(KeysLeftOutWarning, match="other"):
            read_sceniris(cfg)


WRONG: dict[str, tuple] = {
    "objects of another kind": ({"objects": 3}, SceneKeyError, "objects: 3 should be a list"),
    "an object of another kind": ({"objects": ["mug"]}, SceneKeyError, r"objects\.0: 'mug' should be a mapping"),
    "env of another kind": (mug() | {"env": 3}, SceneKeyError, "env: 3 should be a mapping"),
    "a text for a size": (mug() | {"env": {"env_size": "1"}}, SceneKeyError, r"env\.env_size: '1' should be a number"),
    "flat limits": (
        mug() | {"env": {"workspace_limits": [0, 0, 1, 1]}},
        SceneKeyError,
        r"env\.workspace_limits: .* should be \[\[min x, min y\]",
    ),
    "a frame that is no matrix": (
        mug(constraints=[{**ONE, "direction": "left", "relation_axis_transform": [1, 2]}]),
        SceneKeyError,
        "should be a matrix",
    ),
    "a ragged crop": (mug(position={"xy_limit": [[0, 1], [0]]}), SceneKeyError, r"position\.xy_limit: .* should be"),
    "robots of another kind": (
        mug() | {"env": {"robot_centric_axis_transforms": 3}},
        SceneKeyError,
        "robot_centric_axis_transforms: 3 should be a mapping",
    ),
}


@pytest.mark.parametrize(("cfg", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_value_of_another_kind_is_refused_by_its_key(cfg: dict, error: type[ScenirisError], says: str):
    """Mappings, lists, numbers and arrays, each with what it should be."""
    with pytest.raises(error, match=says):
        read_sceniris(cfg)


@pytest.mark.parametrize(
    "keys",
    [
        {"parent_id": "mugg"},
        {"rotation": {"type": "face_to", "face_to_object_id": "mugg"}},
        {"constraints": [{"anchor_object_ids": ["mugg"], "direction": "left"}]},
        {"constraints": [{"anchor_object_ids": ["drawer"], "direction": "left", "relation_axis_transform": "mugg"}]},
    ],
    ids=str,
)
def test_an_object_is_not_advised_to_refer_to_itself(keys: dict):
    """All other names are valid."""
    with pytest.raises(UnknownNameError) as caught:
        read_sceniris(mug(**keys))
    assert {"drawer", "apple"} <= set(caught.value.valid)
    assert "mug" not in caught.value.valid


def test_what_is_not_taken_is_left_out_by_its_path():
    """Taken and ignored keys are not, nor those without a value; a key of a mapping inside has its whole path."""
    notes = Notes()
    keys = KeyReader({"a": 1, "b": 2, "c": None, "d": {"e": 3, "f": 4}, "g": 5}, "objects.mug", notes)
    assert keys.take("a") == 1
    assert keys.take("c", "default") == "default"
    assert keys.value("b") == 2
    keys.ignore("g", "h")
    inside = keys.section("d")
    inside.take("e")
    inside.finish()
    keys.finish()
    assert notes.left_out == ["objects.mug.d.f", "objects.mug.b"]
    keys.finish()
    assert len(notes.left_out) == 2


def test_the_whole_configuration_has_no_path_of_its_own():
    """Its keys are at their names, and it is called `cfg` where it is wrong as a whole."""
    assert KeyReader({}, "", Notes()).at("env") == "env"
    with pytest.raises(SceneKeyError, match=r"original configuration: cfg: 3 should be a mapping"):
        KeyReader(3, "", Notes())


def test_entries_of_a_list_are_named_by_their_numbers():
    """Each is a mapping of its own; no list at all is an empty one."""
    keys = KeyReader({"parts": ({"a": 1}, {"a": 2})}, "cfg", Notes())
    parts = keys.sections("parts")
    assert [(part.path, part.take("a")) for part in parts] == [("cfg.parts.0", 1), ("cfg.parts.1", 2)]
    assert keys.sections("parts") == []
    with pytest.raises(SceneKeyError, match=r"cfg\.parts\.1: 'b' should be a mapping"):
        KeyReader({"parts": [{}, "b"]}, "cfg", Notes()).sections("parts")


@pytest.mark.parametrize("value", [True, "1", [1.0], math.nan, math.inf, 1 + 2j, {"x": 1}], ids=repr)
def test_a_number_is_one_finite_real_number(value: Any):
    """Neither a truth value nor a text, a list or what is not finite."""
    assert KeyReader({"size": 2}, "env", Notes()).number("size", 1.0) == 2.0
    assert KeyReader({}, "env", Notes()).number("size", 1.0) == 1.0
    with pytest.raises(SceneKeyError, match=r"env\.size: .* should be a number"):
        KeyReader({"size": value}, "env", Notes()).number("size", 1.0)


def test_a_rotation_is_the_upper_left_of_a_transform():
    """Of 4 x 4 numbers or 3 x 3, the same three columns."""
    keys = KeyReader({}, "env", Notes())
    transform = QUARTER_TURN.copy()
    transform[:3, 3] = [7.0, 8.0, 9.0]
    for value in (transform, transform.tolist(), transform[:3, :3]):
        assert (keys.rotation("turn", value) @ [1.0, 0.0, 0.0] == [0.0, 1.0, 0.0]).all()
    with pytest.raises(SceneKeyError, match=r"env\.turn: .* 4 x 4 or 3 x 3"):
        keys.rotation("turn", transform[:3].tolist())


def test_advice_is_given_once():
    """In the order in which it was first given."""
    notes = Notes()
    for sentence in ("Give a robot.", "Give assets.", "Give a robot."):
        notes.advise(sentence)
    assert notes.advice == ["Give a robot.", "Give assets."]


REFUSED: dict[str, tuple] = {
    "a negative distance": (
        mug(constraints=[{**ONE, "distance": -1.0, "distance_type": "less"}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.0\.distance: -1.0 should be at least 0",
    ),
    "a relaxation that is none": (
        mug(constraints=[{"anchor_object_ids": []}, {**ONE, "distance": 1.0, "distance_relax": 0.0}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.1\.distance_relax: 0.0 should be at least 0.0001 m",
    ),
    "an angle that is too wide": (
        mug(constraints=[{**ONE, "direction": "left", "direction_tolerance_angle": 200}]),
        SceneKeyError,
        r"objects\.mug\.constraints\.0\.direction_tolerance_angle: 200.0 should be at most 180",
    ),
    "an anchor that is the object itself": (
        mug(constraints=[{"anchor_object_ids": ["mug"], "direction": "left"}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.0\.anchor_object_ids: 'mug' should be a different object",
    ),
    "too many constraints": (
        mug(constraints=[{**ONE, "direction": "left"}] * 5),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints: .* 4 values at most",
    ),
    "joints the wrong way round": (
        mug(asset_path="cabinet", joint_states=[{"joint_ids": ["upper"], "min": 0.9, "max": 0.1}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.joint_states\.0: .* low <= high",
    ),
    "a floor without end": (mug() | {"env": {"env_size": 1e6}}, SceneKeyError, r"configuration: env\.env_size: 1"),
    "objects on each other": (
        {"objects": [{"id": a, "asset_path": "mug", "parent_id": b} for a, b in ("ab", "ba")]},
        SceneKeyError,
        "original configuration: objects are placed relative to each other: a -> b -> a",
    ),
}


@pytest.mark.parametrize(("cfg", "error", "says"), REFUSED.values(), ids=REFUSED.keys())
def test_an_error_of_the_scene_names_the_key_of_the_configuration(cfg: dict, error: type[ScenirisError], says: str):
    """Keys that the scene refuses, its words' limits, and circles."""
    with pytest.raises(error, match=says):
        read_sceniris(cfg)


ORIGINS = {"objects.mug": "objects.0", "objects.mug.region": "objects.0.position", "floor.size": "env.env_size"}


@pytest.mark.parametrize(
    ("path", "key"),
    [
        ("floor.size", "env.env_size"),
        ("floor.size.1", "env.env_size"),
        ("objects.mug.region.fraction.0.1", "objects.0.position"),
        ("objects.mug.regional", "objects.0"),
        ("objects.mugs", "objects.mugs"),
        ("floor", "floor"),
        ("attempts", "attempts"),
    ],
)
def test_a_path_leads_to_the_key_of_the_smallest_part_that_holds_it(path: str, key: str):
    """Whole words of the path count, and a part that nothing is known of keeps its path."""
    assert origin(path, ORIGINS) == key


def test_every_line_of_an_error_is_told_by_its_own_key():
    """The kind of the error and what is said after the place stay."""
    error = SceneKeyError("scene: floor.size.0: is too large.\nscene: objects.mug.region: scene: is wrong.")
    told = in_its_keys(error, ORIGINS)
    assert type(told) is SceneKeyError
    assert str(told).splitlines() == [
        "original configuration: env.env_size: is too large.",
        "original configuration: objects.0.position: scene: is wrong.",
    ]


def test_the_parts_of_an_error_are_carried_over():
    """Names and circles can still be asked for."""
    unknown = in_its_keys(UnknownNameError("object", "mgu", "scene: objects.mug.region", ["mug", "can"]), ORIGINS)
    assert isinstance(unknown, UnknownNameError)
    assert (unknown.kind, unknown.name, unknown.valid) == ("object", "mgu", ["can", "mug"])
    assert unknown.where == "original configuration: objects.0.position"
    circle = in_its_keys(in_a_cycle("scene", ["a", "b"], "objects are placed relative to each other"), ORIGINS)
    assert str(circle).startswith("original configuration: objects are placed relative to each other: a -> b -> a.")


def test_a_warning_says_only_what_there_is_to_say():
    """Keys that are left out, keys that have changed, and advice, each with its names."""
    left_out, changed = str(KeysLeftOutWarning(["a.b", "c"])), str(KeysLeftOutWarning([], {"d": "half of it here"}))
    assert re.search(r"not carried over .*: a\.b, c\.$", left_out)
    assert re.search(r"different meaning or value: d \(half of it here\)\.$", changed)
    assert "not carried over" not in changed
    assert str(KeysLeftOutWarning(["a"], advice=["Give a robot."])).endswith("a. Give a robot.")


def test_a_warning_is_the_same_after_pickling_and_copying():
    """As between processes: its message, and all that can be asked of it."""
    warning = KeysLeftOutWarning(["env.num_envs"], {"objects.can.distance": "cut off here"}, ["Give a robot."])
    for other in (pickle.loads(pickle.dumps(warning)), copy.deepcopy(warning)):
        assert type(other) is KeysLeftOutWarning
        assert (str(other), vars(other)) == (str(warning), vars(warning))
