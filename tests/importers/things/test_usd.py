"""USD: meshes, primitives, transforms, instances and pictures, written with usd-core; point instancers are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.errors import NotSupportedError, SceneFileError

pxr = pytest.importorskip("pxr", reason="usd-core is not installed (extra 'import')")
from sceniris_gym.importers.things.usd import read_usd  # noqa: E402

HEAD = '#usda 1.0\n(\n  metersPerUnit = 0.01\n  upAxis = "Y"\n)\n'
PRISM = """
def Xform "thing"
{
  double3 xformOp:translate = (10, 0, 0)
  uniform token[] xformOpOrder = ["xformOp:translate"]
  def Mesh "top"
  {
    int[] faceVertexCounts = [4, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 4]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)]
    color3f[] primvars:displayColor = [(0.5, 0.25, 0)]
  }
  def Cylinder "bar"
  {
    double radius = 2
    double height = 6
    uniform token axis = "X"
  }
}
"""


def stage(path: Path, text: str) -> Path:
    """Write a stage."""
    path.write_text(HEAD + text)
    return path


def test_meshes_and_primitives_stand_where_the_stage_has_them(tmp_path: Path):
    """Polygons as triangles, colours, unit and up axis."""
    thing = read_usd(stage(tmp_path / "a.usda", PRISM))
    assert (thing.meters, thing.up) == (0.01, "y")
    mesh, bar = thing.links[0].surfaces
    assert sorted(mesh.faces.tolist()) == [[0, 1, 2], [0, 1, 4], [0, 2, 3]]
    assert mesh.rgba == (0.5, 0.25, 0.0, 1.0)
    np.testing.assert_allclose(mesh.vertices[4], [10, 0, 1])
    np.testing.assert_allclose(np.ptp(bar.vertices, axis=0), [6, 4, 4], atol=0.05)


def test_instances_of_a_prototype_are_read_as_often_as_they_stand_there(tmp_path: Path):
    """Two references, both instanceable."""
    stage(tmp_path / "part.usda", 'def Xform "part"\n{\n  def Cube "cube"\n  {\n    double size = 2\n  }\n}\n')
    text = ""
    for i in range(2):
        text += f'def Xform "i{i}" (\n  instanceable = true\n  references = @part.usda@</part>\n)\n{{\n'
        text += f"  double3 xformOp:translate = ({10 * i}, 0, 0)\n"
        text += '  uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    thing = read_usd(stage(tmp_path / "two.usda", text))
    assert len(thing.links[0].surfaces) == 2
    np.testing.assert_allclose(thing.extents(), [12, 2, 2])


def test_a_point_instancer_is_refused(tmp_path: Path):
    """It is named, with the remedy."""
    with pytest.raises(NotSupportedError, match=r"'/many' is a PointInstancer.*place the asset several times"):
        read_usd(stage(tmp_path / "many.usda", 'def PointInstancer "many"\n{\n}\n'))


def test_what_a_stage_lacks_is_told(tmp_path: Path):
    """A file that it refers to, and points that its faces have."""
    half = HEAD + 'def Cube "one" {}\ndef Xform "other" (references = @nowhere.usda@) {}\n'
    (tmp_path / "halves.usda").write_text(half)
    with pytest.raises(SceneFileError, match=r"halves.usda: the stage refers to a missing .*nowhere.usda"):
        read_usd(tmp_path / "halves.usda")
    values = "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\nint[] faceVertexCounts = [3]"
    mesh = f'def Mesh "mesh" {{\n{values}\nint[] faceVertexIndices = [0, 1, 7]\n}}\n'
    (tmp_path / "corner.usda").write_text(HEAD + mesh)
    with pytest.raises(SceneFileError, match=r"corner.usda: faces of '/mesh' refer to vertices that do not exist"):
        read_usd(tmp_path / "corner.usda")


def test_a_file_of_something_else_is_refused(tmp_path: Path):
    """With what usd-core says."""
    (tmp_path / "bad.usda").write_text("nothing")
    with pytest.raises(SceneFileError, match="usd-core cannot read it"):
        read_usd(tmp_path / "bad.usda")
