"""Whole scenes: what shipped ones say, how they are read, changed and compared."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.config.objects import JointConfig, ObjectConfig, SupportConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import Floor
from sceniris_gym.errors import SceneKeyError, ScenirisError
from sceniris_gym.scene.build import build_model
from tests.config.scenes import CLUTTER, NEIGHBOURS, SMALL, TABLE, grouped, refused, related


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


def test_overrides_replace_parts_by_dotted_keys():
    """Overrides work on names, dicts and configs, and leave the original alone."""
    changed = SceneConfig.load(SMALL, {"objects.apple.clearance": 0.01, "objects.apple.in": "floor", "attempts": 3})
    assert (changed.objects["apple"].clearance, changed.attempts) == (0.01, 3)
    assert changed.objects["apple"].support == SupportConfig("in", "floor")
    again = SceneConfig.load(changed, {"objects.apple.gap": 0.002})
    assert (again.objects["apple"].clearance, again.objects["apple"].gap) == (0.01, 0.002)
    assert changed.objects["apple"].gap == 0.0005
    assert SMALL["objects"]["apple"] == {"asset": "apple", "on": "shelf"}


def test_a_scene_made_in_python_equals_one_read_from_a_dict():
    """Parts, arrays and plain values give the same scene, and the same canonical form."""
    made = SceneConfig(
        floor=Floor(size=np.array([1.0, 2.0])),
        objects={
            "shelf": ObjectConfig(asset="cabinet", kind="fixture", on="floor"),
            "apple": ObjectConfig(asset="apple", on="shelf"),
            "goal": ObjectConfig.model_validate({"kind": "marker", "region": {"box": np.eye(2, 3) * 0 + [[0], [1]]}}),
        },
    )
    assert (made.floor, made.objects) == (SceneConfig.load(SMALL).floor, SceneConfig.load(SMALL).objects)
    assert made.canonical() == SceneConfig.load(SMALL).canonical()


def test_the_canonical_form_changes_with_what_shapes_layouts_only():
    """A param changes it; the scene's name and the names of files do not."""
    canonical = SceneConfig.load(SMALL).canonical()
    assert SceneConfig.load(SMALL, {"objects.apple.gap": 0.001}).canonical() != canonical
    assert SceneConfig.load(SMALL, {"restarts": 0}).canonical() != canonical
    assert SceneConfig.load(SMALL, {"name": "other", "objects.apple.asset": "x/y.xml"}).canonical() == canonical
    assert json.loads(canonical)["objects"]["apple"]["on"] == "shelf"


def test_relations_and_orientations_are_in_the_canonical_form():
    """They shape layouts, so they are in the hash; a scene read again from its parts is the same."""
    plain = SceneConfig.load(NEIGHBOURS)
    near = related({"near": "mug", "distance": {"max": 0.3}})
    texts = {
        plain.canonical(),
        near.canonical(),
        related({"near": "mug", "distance": {"max": 0.4}}).canonical(),
        *(SceneConfig.load(NEIGHBOURS, {"objects.apple.orientation": word}).canonical() for word in ("any", "stable")),
        SceneConfig.load(NEIGHBOURS, {"objects.apple.orientation": {"face_to": "mug"}}).canonical(),
    }
    assert len(texts) == 6
    assert SceneConfig.load(near, {"attempts": 10}).canonical() == near.canonical()
    assert build_model(near).hash != build_model(plain).hash


def test_groups_are_in_the_canonical_form():
    """They shape layouts, so they are in the hash; a scene read again from its parts is the same."""
    config = grouped(CLUTTER)
    texts = {
        SceneConfig.load(TABLE).canonical(),
        config.canonical(),
        grouped(CLUTTER | {"count": 2}).canonical(),
        grouped(CLUTTER | {"missing": "drop"}).canonical(),
    }
    assert len(texts) == 4
    assert SceneConfig.load(config, {"attempts": 10}).canonical() == config.canonical()


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


def test_a_bank_of_another_size_is_in_the_canonical_form():
    """The default is left out, written or not: hashes of scenes from before the word are as they were."""
    plain = SceneConfig.load(SMALL)
    assert plain.bank == 64
    assert SceneConfig.load(SMALL, {"bank": 64}).canonical() == plain.canonical()
    assert "bank" not in plain.canonical()
    assert json.loads(SceneConfig.load(SMALL, {"bank": 65}).canonical())["bank"] == 65


def test_attempts_may_be_found():
    """`auto` is what is hashed, and survives overrides."""
    config = SceneConfig.load(SMALL, {"attempts": "auto"})
    assert config.attempts == "auto"
    assert json.loads(config.canonical())["attempts"] == "auto"
    assert SceneConfig.load(config, {"restarts": 3}).attempts == "auto"


WRONG: dict[str, tuple] = {
    "fractional attempts": ({"attempts": 2.5}, SceneKeyError, ["attempts: 2.5", "whole number"]),
    "no attempts": ({"attempts": 0}, SceneKeyError, ["attempts: 0", "at least 1"]),
    "attempts of another word": ({"attempts": "aut"}, SceneKeyError, ["attempts: 'aut'", "'auto'", "Did you mean"]),
    "attempts as a truth": ({"attempts": True}, SceneKeyError, ["attempts: True", "whole number or 'auto'"]),
    "an empty bank": ({"bank": 0}, SceneKeyError, ["bank: 0", "at least 1"]),
    "unknown geometry": ({"geometry": "visuel"}, SceneKeyError, ["geometry", "Did you mean 'visual'"]),
    "robot without asset": ({"robot.yaw": 3}, SceneKeyError, ["robot: ", "exactly one of asset, in_model"]),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_setting_of_a_scene_is_refused(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Counts, geometry and the robot."""
    refused(tmp_path, SMALL, overrides, error, says)


@pytest.mark.parametrize("word", ["attempts", "restarts", "bank"])
def test_counts_that_would_never_end_are_refused(word: str):
    """A thousand times more than any scene needs, and within what the device counts with."""
    with pytest.raises(SceneKeyError, match=f"{word}: 3000000000 should be"):
        SceneConfig.load({word: 3_000_000_000})
