"""Tags that choose among the files of a folder."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ModelWarning, ScenirisError
from tests.config.scenes import TABLE


def loaded(words: dict[str, Any]) -> SceneConfig:
    """Return a scene with an object of these words."""
    return SceneConfig.load(TABLE, {"objects.target": words})


def folder_of(tmp_path: Path, **tags: list[str]) -> str:
    """Write things with these tags in their manifests, and return the pattern that matches all of them."""
    for name, own in tags.items():
        (tmp_path / name).mkdir()
        (tmp_path / f"{name}.xml").write_text("<mujoco/>")
        (tmp_path / name / "manifest.json").write_text(json.dumps({"tags": own}))
    return str(tmp_path / "*")


def test_tags_choose_among_the_files_of_a_folder(tmp_path: Path):
    """Those whose manifests have all of them; a file without a manifest has none."""
    pattern = folder_of(tmp_path, a=["graspable", "red"], b=["graspable"], c=["red"])
    (tmp_path / "d.xml").write_text("<mujoco/>")
    for tags, left in ((["graspable"], "ab"), ("red", "ac"), (["red", "graspable"], "a")):
        config = loaded({"asset": pattern, "tags": tags, "on": "table"})
        assert config.variants["target"] == tuple(f"target/{name}" for name in left)


def test_files_of_any_name_are_variants(tmp_path: Path):
    """A digit at the beginning, blanks, a dot, a name that bodies cannot have; one that is no text is left out."""
    for name in ("003_box", "my can", "c.d", "world", "a\nb"):
        (tmp_path / f"{name}.xml").write_text("<mujoco/>")
    with pytest.warns(ModelWarning, match=r"are left out: 'a\\nb\.xml'"):
        config = loaded({"asset": str(tmp_path / "*"), "on": "table"})
    assert config.variants["target"] == tuple(f"target/{name}" for name in ("003_box", "c_d", "my can", "world_"))
    assert (
        loaded({"asset": [str(tmp_path / "003_box.xml"), "can"], "on": "table"}).variants["target"][0]
        == "target/003_box"
    )


def test_a_pattern_may_name_folders(tmp_path: Path):
    """Variants have the names of their files. Files of the same name, as in RoboCasa, have their folders' names."""
    for name in ("apple_0", "apple_1", "pear/green"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "model.xml").write_text("<mujoco/>")
    assert loaded({"asset": str(tmp_path / "*/*"), "on": "table"}).variants["target"] == (
        "target/apple_0",
        "target/apple_1",
    )
    (tmp_path / "pear" / "pear.xml").write_text("<mujoco/>")
    assert loaded({"asset": str(tmp_path / "p*/*"), "on": "table"}).variants["target"] == ("target/pear",)
    found = loaded({"asset": str(tmp_path / "**/*"), "on": "table"}).variants["target"]
    assert found == ("target/apple_0", "target/apple_1", "target/green", "target/pear")
    for name in ("apple_0/apple_0", "apple_0/handle", "apple_1/handle"):
        (tmp_path / f"{name}.xml").write_text("<mujoco/>")
    found = loaded({"asset": str(tmp_path / "a*/*"), "on": "table"}).variants["target"]
    assert found == tuple(
        f"target/{name}" for name in ("apple_0", "apple_0_handle", "apple_0_model", "apple_1_handle", "apple_1_model")
    )
    with pytest.raises(ScenirisError, match="should match at least one MJCF file"):
        loaded({"asset": str(tmp_path / "z*/*"), "on": "table"})


def test_tags_that_choose_nothing_are_refused(tmp_path: Path):
    """With the tags that there are; and a manifest that is none with its file."""
    pattern = folder_of(tmp_path, a=["red"], b=["graspable"])
    for tags, message in (
        (["graspible"], r"objects\.target\.tags: .*: graspable, red. Did you mean 'graspable'"),
        (["red", "graspable"], "occur together in at least one of the folder's assets"),
        ([], "a list of tags"),
        (3, "a list of tags"),
    ):
        with pytest.raises(ScenirisError, match=message):
            loaded({"asset": pattern, "tags": tags, "on": "table"})
    with pytest.raises(ScenirisError, match=r"tags: .* only with an 'asset' .* a '\*'"):
        loaded({"asset": ["can", "mug"], "tags": ["red"], "on": "table"})
    for wrong in ("[", "[" * 100_000, '{"tags": "red"}'):
        (tmp_path / "b" / "manifest.json").write_text(wrong)
        with pytest.raises(ScenirisError, match=r"b/manifest\.json cannot be read: "):
            loaded({"asset": pattern, "tags": ["red"], "on": "table"})
    (tmp_path / "b" / "manifest.json").unlink()
    os.mkfifo(tmp_path / "b" / "manifest.json")
    with pytest.raises(ScenirisError, match="a pipe or a device, not a file"):
        loaded({"asset": pattern, "tags": ["red"], "on": "table"})
