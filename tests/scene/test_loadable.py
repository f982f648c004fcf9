"""Folders of which some files cannot be variants."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ModelWarning, SceneFileError, UnknownNameError
from sceniris_gym.scene.build import build_model

GEOM = '<geom type="box" size=".02 .02 .02" pos="0 0 .02"/>'
SOUND = f"<mujoco><worldbody><body>{GEOM}</body></worldbody></mujoco>"
BROKEN = {
    "cut": "<mujoco><worldbody>",
    "jointed": f"<mujoco><worldbody><body>{GEOM}<body><joint/>{GEOM}</body></body></worldbody></mujoco>",
    "without_mesh": '<mujoco><asset><mesh name="m" file="m.obj"/></asset><worldbody><body><geom type="mesh" mesh="m"/>'
    "</body></worldbody></mujoco>",
}


def scene(folder: Path, files: dict[str, str]) -> SceneConfig:
    """Return a scene with a thing whose variants are these files."""
    for name, text in files.items():
        (folder / f"{name}.xml").write_text(text)
    thing = {"asset": str(folder / "*"), "on": "floor", "holdout": 0.5}
    return SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"thing": thing}})


def test_files_that_cannot_be_variants_are_left_out_and_named(tmp_path: Path):
    """The scene is that of the others; an override is applied to the scene as it is written."""
    config = scene(tmp_path, {**BROKEN, "a": SOUND, "b": SOUND})
    with pytest.warns(ModelWarning, match=r"objects\.thing\.asset: 3 of 5 files") as told:
        found = build_model(config)
    message = str(told[0].message)
    assert all(f"objects.thing/{name}" in message for name in BROKEN)
    assert found.config.variants == {"thing": ("thing/a", "thing/b")}
    assert set(found.config.groups["thing"].splits) == {"thing/a", "thing/b"}
    assert found.mjm.body("thing/b").id > 0
    assert found.sim.mjm.nbody == found.mjm.nbody - 1
    assert SceneConfig.load(found.config, {"objects.thing.gap": 0.001}).variants == config.variants


def test_an_override_of_one_file_leaves_the_folder_a_folder(tmp_path: Path):
    """Files that are broken are still left out, and a share is held out of what is left."""
    overrides = {"objects.thing/a.gap": 0.002, "objects.thing/a.weight": 2, "objects.thing/cut.weight": 3}
    config = SceneConfig.load(scene(tmp_path, {**BROKEN, "a": SOUND, "b": SOUND}), overrides)
    with pytest.warns(ModelWarning, match="3 of 5 files"):
        found = build_model(config).config
    assert {name: part.gap for name, part in found.objects.items()} == {"thing/a": 0.002, "thing/b": 0.0005}
    assert set(found.groups["thing"].splits) == {"thing/a", "thing/b"}
    assert found.groups["thing"].weights == {"thing/a": 2.0}
    assert len(SceneConfig.load(found, {"objects.thing.holdout": 0.7}).variants["thing"]) == 5


def test_a_file_is_left_out_for_the_reason_that_a_variant_is_refused_for(tmp_path: Path):
    """A soft one is told to be soft, and one whose kind drops the joint of its motor to have that."""
    cloth = '<flexcomp type="grid" count="3 3 3" spacing=".02 .02 .02" name="f" dim="3" mass=".1"/>'
    motor = '<actuator><motor joint="j"/></actuator>'
    files = {
        "a": SOUND,
        "b": SOUND,
        "soft": f'<mujoco><worldbody><body name="soft">{cloth}</body></worldbody></mujoco>',
        "driven": f'<mujoco><worldbody><body><freejoint name="j"/>{GEOM}</body></worldbody>{motor}</mujoco>',
    }
    config = SceneConfig.load(scene(tmp_path, files), {"objects.thing.kind": "fixture"})
    with pytest.warns(ModelWarning, match="2 of 4 files") as told:
        found = build_model(config)
    assert found.config.variants == {"thing": ("thing/a", "thing/b")}
    assert "objects.thing/soft: is soft" in str(told[0].message)
    assert "have actuators of joints that are dropped" in str(told[0].message)


def test_files_of_each_folder_are_left_out(tmp_path: Path):
    """Of two folders that both have one: neither brings back that of the other."""
    objects = {}
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        for file, text in {"cut": BROKEN["cut"], "a": SOUND, "b": SOUND}.items():
            (tmp_path / name / f"{file}.xml").write_text(text)
        objects[name] = {"asset": str(tmp_path / name / "*"), "on": "floor"}
    with pytest.warns(ModelWarning, match="1 of 3 files"):
        found = build_model(SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects}))
    assert found.config.variants == {"first": ("first/a", "first/b"), "second": ("second/a", "second/b")}


def test_a_folder_without_a_sound_file_is_refused(tmp_path: Path):
    """With the first reason."""
    with pytest.raises(SceneFileError, match=r"no file of the folder can be a variant\. The first: .*thing/cut"):
        build_model(scene(tmp_path, BROKEN))


@pytest.mark.parametrize("broken", ["b5", "b9"])
def test_files_that_are_left_out_are_not_held_out(tmp_path: Path, broken: str):
    """A share of the others is, as without the broken file: the first by hash, and the last."""
    with pytest.warns(ModelWarning, match="1 of 3 files"):
        found = build_model(scene(tmp_path, {"a": SOUND, "b": SOUND, broken: BROKEN["cut"]})).config
    (tmp_path / f"{broken}.xml").unlink()
    assert found.groups["thing"].splits == scene(tmp_path, {}).groups["thing"].splits


def test_an_error_of_something_else_is_told(tmp_path: Path):
    """As it is, if all files of the folder are sound."""
    config = SceneConfig.load(
        scene(tmp_path, {"a": SOUND, "b": SOUND}), {"objects.other": {"asset": "none", "on": "floor"}}
    )
    with pytest.raises(UnknownNameError, match=r"objects\.other\.asset"):
        build_model(config)


def test_a_folder_without_a_star_is_told_to_need_one(tmp_path: Path):
    """An asset is a file; the pattern of all files of the folder is named."""
    config = SceneConfig.load(
        {"floor": {"size": [1, 1]}, "objects": {"thing": {"asset": str(tmp_path), "on": "floor"}}}
    )
    with pytest.raises(SceneFileError, match=rf"objects\.thing\.asset: .* is a folder .*'{tmp_path}/\*'"):
        build_model(config)
