"""Meshes: every format gives the same box, bad files are told. URDF, judged by MuJoCo: missing meshes are named."""

from __future__ import annotations

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from sceniris_gym.errors import MeshError, NotSupportedError, SceneFileError, UnknownNameError
from sceniris_gym.importers.things.importer import import_thing
from sceniris_gym.importers.things.meshes import read_mesh, read_urdf
from sceniris_gym.scene.model_files import file_of
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
    with pytest.raises(MeshError, match=r"it has non-finite vertices\. Export it again") as refused:
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


DOOR = """<robot name="cupboard">
  <material name="wood"><color rgba="0.6 0.4 0.2 1"/></material>
  <link name="frame">
    <inertial><origin xyz="0 0 0.2"/><mass value="3"/>
      <inertia ixx="1" iyy="2" izz="2.5" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.2" rpy="0.3 0.2 0.1"/><geometry><box size="0.4 0.3 0.4"/></geometry>
      <material name="wood"/></visual>
    <collision><origin xyz="0 0 0.2" rpy="0.3 0.2 0.1"/><geometry><box size="0.4 0.3 0.4"/></geometry></collision>
  </link>
  <link name="door"><visual><geometry><mesh filename="package://cupboard/meshes/door.stl" scale="2 2 2"/></geometry>
    </visual></link>
  <joint name="hinge" type="revolute"><parent link="frame"/><child link="door"/>
    <origin xyz="0.2 -0.2 0.2" rpy="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="0" upper="1.5" effort="1" velocity="1"/>
  </joint>
</robot>"""


@pytest.fixture
def door(tmp_path: Path) -> Path:
    """Return the URDF of a cupboard whose mesh lies in a folder of its package."""
    folder = tmp_path / "cupboard"
    (folder / "meshes").mkdir(parents=True)
    (folder / "urdf").mkdir()
    write(box(), folder / "meshes" / "door.stl")
    (folder / "urdf" / "cupboard.urdf").write_text(DOOR)
    return folder / "urdf" / "cupboard.urdf"


def test_links_and_joints_are_those_of_the_file(door: Path):
    """A tree in metres with z up; the box is where MuJoCo has it."""
    thing = read_urdf(door)
    assert [(link.name, link.parent) for link in thing.links] == [("frame", None), ("door", "frame")]
    frame, leaf = thing.links
    assert frame.surfaces[0].rgba == (0.6, 0.4, 0.2, 1.0)
    assert frame.inertia is not None
    assert frame.inertia.mass == 3.0
    assert leaf.joint is not None
    assert (leaf.joint.type, leaf.joint.range) == ("hinge", (0.0, 1.5))
    np.testing.assert_allclose(np.ptp(leaf.surfaces[0].vertices, axis=0), [0.08, 0.12, 0.2], atol=1e-6)
    plain = DOOR.replace('<mesh filename="package://cupboard/meshes/door.stl" scale="2 2 2"/>', '<box size="1 1 1"/>')
    plain = plain.replace('type="revolute"', 'type="fixed"')
    compiler = '<compiler fusestatic="false"/>'
    mjm = mujoco.MjModel.from_xml_string(plain.replace("</robot>", f"<mujoco>{compiler}</mujoco></robot>"))
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = data.geom_xpos[0] + (signs * mjm.geom_size[0]) @ data.geom_xmat[0].reshape(3, 3).T
    seen = frame.surfaces[0].vertices
    assert max(np.linalg.norm(seen - corner, axis=1).min() for corner in corners) < 1e-9
    np.testing.assert_allclose(leaf.quat, mjm.body("door").quat, atol=1e-9)


def test_missing_meshes_are_all_named(door: Path):
    """So that they can be put in place at once."""
    (door.parents[1] / "meshes" / "door.stl").unlink()
    with pytest.raises(
        SceneFileError, match=r"1 mesh paths do not exist or are not files: package://cupboard/meshes/door\.stl"
    ):
        read_urdf(door)
    assert file_of("file:///nowhere.stl", door.parent) is None


@pytest.mark.parametrize(
    ("old", "new", "kind", "said"),
    [
        ('type="revolute"', 'type="floating"', NotSupportedError, "'floating'"),
        ('<child link="door"/>', '<child link="dor"/>', UnknownNameError, "unknown link 'dor'. Did you mean 'door'"),
        ('<robot name="cupboard">', "<sdf>", SceneFileError, "cannot be read as XML"),
        ('<box size="0.4 0.3 0.4"/>', "<cone/>", NotSupportedError, "<cone>"),
    ],
)
def test_what_is_no_urdf_of_a_thing_is_refused(door: Path, old: str, new: str, kind: type[Exception], said: str):
    """Each with what would be right."""
    door.write_text(DOOR.replace(old, new))
    with pytest.raises(kind, match=said):
        read_urdf(door)


def test_links_that_are_none_or_hang_on_none_are_told(tmp_path: Path):
    """Each with what is missing."""
    (tmp_path / "a.urdf").write_text('<robot name="a"></robot>')
    with pytest.raises(SceneFileError, match=r"it has no links\. Add a <link> with a mesh"):
        read_urdf(tmp_path / "a.urdf")
    (tmp_path / "a.urdf").write_text('<robot name="a"><link name="b"/><link name="c"/></robot>')
    with pytest.raises(SceneFileError, match=r"to one root, got 2 roots: b, c\. Correct the joints"):
        read_urdf(tmp_path / "a.urdf")


@pytest.mark.parametrize("moments", ["1 1 0", "1 1 3", "1e-15 1e-15 1e-15"])
def test_moments_that_no_body_has_are_those_of_its_density(tmp_path: Path, moments: str):
    """Zero, more than the two others together, or too small for MuJoCo, which reads what is written."""
    given = " ".join(f'{name}="{value}"' for name, value in zip(("ixx", "iyy", "izz"), moments.split(), strict=True))
    text = f'<inertial><mass value="3"/><inertia {given}/></inertial><visual><geometry><box size="1 1 1"/></geometry>'
    (tmp_path / "a.urdf").write_text(f'<robot name="a"><link name="a">{text}</visual></link></robot>')
    assert import_thing(tmp_path / "a.urdf", tmp_path / "a.xml")["mass_kg"] == pytest.approx(500.0)
    mjm = mujoco.MjModel.from_xml_path(str(tmp_path / "a.xml"))
    np.testing.assert_allclose(mjm.body("a").inertia, 500.0 / 6.0, rtol=1e-3)


def test_a_mesh_that_is_no_file_of_meshes_is_told_with_those_that_are(tmp_path: Path):
    """A file without a suffix cannot be read 'as' anything."""
    (tmp_path / "words").write_text("no mesh at all")
    path = tmp_path / "thing.urdf"
    shape = '<visual><geometry><mesh filename="words"/></geometry></visual>'
    path.write_text(f'<robot name="thing"><link name="base">{shape}</link></robot>')
    with pytest.raises(SceneFileError, match=r"words: it should be a mesh file .* ends in \.obj, .*\.dae"):
        read_urdf(path)
