"""Writing of assets by the scripts: meanwhile a reader finds the old file or the new one, never a part."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("manifold3d")
paths = importlib.import_module("sceniris_gym.assets.paths")
mjcf, shapes, textures = (
    importlib.import_module(f"sceniris_gym.assets.{name}") for name in ("mjcf", "shapes", "textures")
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder that the scripts write to."""
    (tmp_path / "meshes").mkdir()
    monkeypatch.setattr(paths, "FOLDER", tmp_path)
    return tmp_path


def test_assets_are_replaced_and_never_written_in_place(folder: Path):
    """Files that were opened before they were made again still hold what they held, and the new ones are whole."""
    files = [folder / "thing.xml", folder / "meshes" / "thing.obj", folder / "meshes" / "thing.png"]
    for file in files:
        file.write_bytes(b"old")
    opened = [file.open("rb") for file in files]
    mjcf.Document("thing").save()
    shapes.write_obj("thing", shapes.surface(shapes.hull(np.random.default_rng(0).normal(size=(20, 3)))))
    textures.write_png("thing", np.full((2, 3, 3), 200.0))
    assert [file.read() for file in opened] == [b"old"] * 3
    assert files[0].read_text().startswith("<mujoco")
    assert files[1].read_text().startswith("v ")
    assert Image.open(files[2]).size == (3, 2)
    assert sorted(path for path in folder.rglob("*") if path.is_file()) == sorted(files)


def test_a_mesh_that_is_refused_leaves_the_one_there_was(folder: Path):
    """A mesh with a hole is an error, and takes no file's place."""
    closed = shapes.surface(shapes.hull(np.random.default_rng(0).normal(size=(20, 3))))
    shapes.write_obj("thing", closed)
    before = (folder / "meshes" / "thing.obj").read_bytes()
    with pytest.raises(ValueError, match="should be a closed mesh"):
        shapes.write_obj("thing", shapes.Mesh(closed.vertices, closed.faces[1:]))
    assert (folder / "meshes" / "thing.obj").read_bytes() == before
