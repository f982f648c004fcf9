"""The scene's file: read, read again when it is saved, and what is said where it is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from sceniris_gym.errors import InfeasibleSceneError, SceneFileError, SceneKeyError, ScenirisError
from sceniris_gym.viewer.scene_file import SceneFile

GOOD = "floor: {size: [1.0, 1.0]}\nobjects: {apple: {asset: apple, on: floor}}\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A scene in a file."""
    path = tmp_path / "scene.yaml"
    path.write_text(GOOD)
    return path


def test_saving_is_seen_and_nothing_else_is(path: Path):
    """Of the file itself and of its base; once it was loaded again it is not new any more."""
    above = path.with_name("above.yaml")
    above.write_text("base: scene.yaml\nobjects: {pear: {asset: pear, on: floor}}\n")
    file = SceneFile(str(above), {})
    loaded = file.load()
    assert loaded.error is None
    assert loaded.compiled is not None
    assert loaded.compiled.object_names == ("apple", "pear")
    assert not file.changed()
    path.write_text(GOOD.replace("1.0, 1.0", "2.0, 2.0"))
    assert file.changed()
    again = file.load().compiled
    assert again is not None
    assert again.config.floor is not None
    assert again.config.floor.size == (2.0, 2.0)
    assert not file.changed()


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        (GOOD.replace("on: floor", "on: flour"), Exception, "flour"),
        (GOOD.replace("on:", "onn:"), SceneKeyError, "onn"),
        ("floor: [", SceneFileError, "not YAML"),
        (GOOD.replace("asset: apple", "asset: kumquat"), ScenirisError, "unknown asset 'kumquat'"),
        (GOOD.replace("asset: apple", "asset: ./kumquat.xml"), ScenirisError, "there is no such file"),
    ],
)
def test_a_mistake_is_said_in_the_words_of_the_file(path: Path, text: str, error: type[Exception], words: str):
    """There is no scene then, and mending it is seen."""
    file = SceneFile(str(path), {})
    path.write_text(text)
    loaded = file.load()
    assert loaded.compiled is None
    assert not isinstance(loaded.error, InfeasibleSceneError)
    assert isinstance(loaded.error, error)
    assert words in str(loaded.error)
    path.write_text(GOOD)
    assert file.changed()
    assert file.load().error is None


def test_a_scene_that_cannot_be_made_is_there_with_its_error(path: Path):
    """An apple that has no room: the error names it, and what was tried can be looked at."""
    path.write_text(GOOD.replace("{apple", "{chest: {asset: chest, on: floor, clearance: 2.0}, apple"))
    loaded = SceneFile(str(path), {}).load()
    assert isinstance(loaded.error, InfeasibleSceneError)
    assert loaded.compiled is not None


def test_changes_and_missing_files(path: Path, tmp_path: Path):
    """Changes lie over the file; a file that is not there is an error like others."""
    loaded = SceneFile(str(path), {"floor.size": [3.0, 3.0]}).load().compiled
    assert loaded is not None
    assert loaded.config.floor is not None
    assert loaded.config.floor.size == (3.0, 3.0)
    device = SceneFile(str(path), {}, "abacus").load().error
    assert "unknown device 'abacus'" in str(device)
    missing = SceneFile(str(tmp_path / "none.yaml"), {})
    assert isinstance(missing.load().error, SceneFileError)
    assert not missing.changed()


def test_a_file_that_was_gone_is_seen_again(path: Path):
    """As when an editor, or git, removes it and writes it anew a moment later."""
    file = SceneFile(str(path), {})
    assert file.load().error is None
    path.unlink()
    assert file.changed()
    assert isinstance(file.load().error, SceneFileError)
    assert not file.changed()
    path.write_text(GOOD)
    assert file.changed()
    assert file.load().error is None


def test_what_an_asset_refers_to_is_seen(path: Path):
    """A mesh in its folder for meshes, or in a file that it includes; one that was missing is seen when it is there."""
    meshes = path.with_name("meshes")
    meshes.mkdir()
    mesh = meshes / "thing.obj"
    (path.with_name("parts")).mkdir()
    (path.with_name("parts") / "inner.xml").write_text(
        '<mujoco><asset><mesh name="m" file="thing.obj"/></asset></mujoco>'
    )
    (path.with_name("thing.xml")).write_text(
        '<mujoco><compiler meshdir="meshes"/><include file="parts/inner.xml"/><worldbody>'
        '<body name="thing"><freejoint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    path.write_text(GOOD.replace("asset: apple", "asset: ./thing.xml"))
    file = SceneFile(str(path), {})
    assert "thing.obj" in str(file.load().error)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(mesh)
    assert file.changed()
    assert file.load().error is None
    assert not file.changed()
    trimesh.creation.icosphere(2, 0.05).export(mesh)
    assert file.changed()


def test_what_an_attached_model_refers_to_is_seen(path: Path):
    """Its own file, and its mesh; a file that cannot be read as XML is seen as well."""
    inner, mesh = path.with_name("inner.xml"), path.with_name("thing.stl")
    trimesh.creation.box((0.1, 0.1, 0.1)).export(mesh)
    words = (
        '<mujoco model="inner"><asset><mesh name="m" file="thing.stl"/></asset>'
        '<worldbody><body name="part"><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    inner.write_text(words)
    path.with_name("thing.xml").write_text(
        '<mujoco><asset><model name="inner" file="inner.xml"/></asset><worldbody><body name="thing"><freejoint/>'
        '<attach model="inner" body="part" prefix="inner_"/></body></worldbody></mujoco>'
    )
    path.write_text(GOOD.replace("asset: apple", "asset: ./thing.xml"))
    file = SceneFile(str(path), {})
    assert file.load().error is None
    assert not file.changed()
    trimesh.creation.box((0.2, 0.1, 0.1)).export(mesh)
    assert file.changed()
    inner.write_text(words[:-3])
    assert "inner.xml" in str(file.load().error)
    assert not file.changed()
    inner.write_text(words)
    assert file.changed()
    assert file.load().error is None
