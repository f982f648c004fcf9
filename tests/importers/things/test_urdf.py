"""URDF: links, joints, shapes and inertias, judged by MuJoCo's own reader; missing meshes are named."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import NotSupportedError, SceneFileError, UnknownNameError
from sceniris_gym.importers.things.importer import import_thing
from sceniris_gym.importers.things.urdf import read_urdf
from sceniris_gym.scene.model_files import file_of
from tests.importers.things.shapes import box, write

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
        SceneFileError, match=r"1 files that do not exist, or are none: package://cupboard/meshes/door\.stl"
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
    with pytest.raises(SceneFileError, match=r"it has no links\. It should have a <link> with a mesh"):
        read_urdf(tmp_path / "a.urdf")
    (tmp_path / "a.urdf").write_text('<robot name="a"><link name="b"/><link name="c"/></robot>')
    with pytest.raises(SceneFileError, match=r"on one root by joints, and it has 2 roots: b, c\. Add joints"):
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
    with pytest.raises(SceneFileError, match=r"words: it should be a file of meshes, .* ends in \.obj, .*\.dae"):
        read_urdf(path)
