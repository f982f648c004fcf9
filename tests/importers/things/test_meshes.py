"""Meshes: every format gives the same box, textures and colours are kept, and bad files are told."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from sceniris_gym.errors import MeshError, SceneFileError
from sceniris_gym.importers.things.meshes import read_mesh
from tests.importers.things.shapes import box, write


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".ply", ".off", ".glb"])
def test_every_format_gives_the_same_box(suffix: str, tmp_path: Path):
    """Its extents; glTF alone says metres and y up."""
    thing = read_mesh(write(box(), tmp_path / f"box{suffix}"))
    np.testing.assert_allclose(thing.extents(), [0.04, 0.06, 0.1], atol=1e-6)
    assert (thing.meters, thing.up) == ((1.0, "y") if suffix == ".glb" else (None, None))


def test_a_texture_and_its_coordinates_are_kept(tmp_path: Path):
    """A GLB with a picture."""
    mesh = box()
    uv = np.random.default_rng(0).random((len(mesh.vertices), 2))
    picture = Image.new("RGB", (4, 4), (200, 10, 10))
    mesh.visual = TextureVisuals(uv, material=PBRMaterial(baseColorTexture=picture))
    (surface,) = read_mesh(write(mesh, tmp_path / "box.glb")).links[0].surfaces
    assert surface.texture is not None
    assert surface.texture.getpixel((1, 1)) == (200, 10, 10)
    assert surface.uv is not None
    np.testing.assert_allclose(surface.uv, uv, atol=1e-6)


def test_the_colour_of_a_material_is_kept(tmp_path: Path):
    """An OBJ with a file of materials."""
    (tmp_path / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n")
    lines = ["mtllib paint.mtl", "usemtl red", *("v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1")]
    lines += ["f 1 3 2", "f 1 2 4", "f 2 3 4", "f 3 1 4"]
    (tmp_path / "thing.obj").write_text("\n".join(lines))
    thing = read_mesh(tmp_path / "thing.obj")
    assert thing.links[0].surfaces[0].rgba == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".ply", ".off"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.filterwarnings("error")
def test_vertices_that_are_not_finite_are_no_holes(suffix: str, value: float, tmp_path: Path):
    """As reading them would leave them: without the faces around them, and without a word."""
    vertices = np.array(box().vertices)
    vertices[0, 1] = value
    bad = trimesh.Trimesh(vertices, box().faces, process=False)
    with np.errstate(invalid="ignore"):
        path = write(bad, tmp_path / f"bad{suffix}")
    with pytest.raises(MeshError, match=r"it has vertices that are not finite\. Export it again") as refused:
        read_mesh(path)
    assert refused.value.reason == "not finite"


def test_a_file_of_something_else_is_refused(tmp_path: Path):
    """With its name and kind."""
    (tmp_path / "bad.glb").write_bytes(b"no mesh at all")
    with pytest.raises(SceneFileError, match=r"bad\.glb: it cannot be read as GLB: .*\. Export it again"):
        read_mesh(tmp_path / "bad.glb")


def test_pipes_that_a_mesh_refers_to_are_not_waited_for(tmp_path: Path):
    """Materials are left out, as if they were missing; a buffer is an error."""
    os.mkfifo(tmp_path / "pipe")
    file = write(box(), tmp_path / "box.obj")
    file.write_text("mtllib pipe\n" + file.read_text())
    np.testing.assert_allclose(read_mesh(file).extents(), [0.04, 0.06, 0.1], atol=1e-6)
    buffer = '{"asset": {"version": "2.0"}, "buffers": [{"uri": "pipe", "byteLength": 36}], "scenes": [{"nodes": []}]}'
    (tmp_path / "box.gltf").write_text(buffer)
    with pytest.raises(SceneFileError, match=r"box\.gltf: it cannot be read as GLTF: .*a pipe or a device"):
        read_mesh(tmp_path / "box.gltf")
