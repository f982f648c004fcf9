"""Repair: welding, holes, orientation, and what is beyond it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from sceniris_gym.errors import MeshError
from sceniris_gym.importers.things.repair import MOST_FACES, check_faces, repair
from sceniris_gym.importers.things.thing import Surface
from tests.importers.things.shapes import box, cup, surface


def test_loose_triangles_of_a_closed_mesh_are_welded():
    """As an STL has them: a cup of known volume."""
    mesh = cup()
    loose = Surface(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))
    found = repair([loose], "cup")
    assert found.closed
    assert found.mesh.is_watertight
    assert found.mesh.volume == pytest.approx(mesh.volume)
    assert found.report == ()


def test_small_holes_are_closed_and_told():
    """A sphere without three triangles has its volume again, and the patches can be seen."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    whole = ball.volume
    ball.update_faces(np.arange(len(ball.faces)) > 2)
    found = repair([surface(ball)], "ball")
    assert found.mesh.is_watertight
    assert found.mesh.volume == pytest.approx(whole, rel=1e-3)
    assert "closed" in found.report[-1]
    assert len(found.patches) == 1


def test_a_mesh_that_is_inside_out_is_turned():
    """Its volume is positive."""
    mesh = box()
    mesh.invert()
    assert repair([surface(mesh)], "box").mesh.volume == pytest.approx(0.04 * 0.06 * 0.1)


def test_a_box_without_a_side_is_beyond_repair_but_may_be_a_shell():
    """Nobody knows whether it is solid."""
    mesh = box()
    mesh.update_faces(mesh.face_normals[:, 2] < 0.5)
    with pytest.raises(MeshError, match=r"box: it is open along 4 edges\..*--shell") as refused:
        repair([surface(mesh)], "box")
    assert refused.value.reason == "open"
    assert not repair([surface(mesh)], "box", shell=True).closed


@pytest.mark.parametrize(
    ("edge", "height", "solid"), [(0.04, 0.0015, True), (0.04, 0.01, False), (0.0015, 0.0015, True)]
)
def test_what_is_as_near_to_its_hull_as_parts_have_to_be_is_its_hull(edge: float, height: float, solid: bool):
    """Lids of boxes: whether one is hollow from below cannot be told within 2 mm, and of a deeper one it can."""
    mesh = box((edge, edge, height))
    mesh.update_faces(mesh.face_normals[:, 2] > -0.5)
    if not solid:
        with pytest.raises(MeshError, match="it is open"):
            repair([surface(mesh)], "lid")
        return
    found = repair([surface(mesh)], "lid")
    assert found.closed
    assert found.mesh.volume == pytest.approx(edge * edge * height)
    assert "replaced by its convex hull" in found.report[-1]


def test_what_is_flat_is_refused():
    """A sheet, and a sheet with two sides."""
    square = Surface(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    for faces in (square.faces, np.concatenate([square.faces, square.faces[:, ::-1]])):
        with pytest.raises(MeshError, match="flat") as refused:
            repair([Surface(square.vertices, faces)], "square")
        assert refused.value.reason == "flat"


def test_meshes_without_faces_with_too_many_or_with_nan_are_refused():
    """Before any work."""
    refused: dict[str, tuple[list[Surface], str]] = {
        "empty": ([], "no faces"),
        "large": ([Surface(np.zeros((3, 3)), np.zeros((1_000_000, 3), int))], "1,000,000 faces"),
        "not finite": ([Surface(np.full((3, 3), np.nan), np.array([[0, 1, 2]]))], "non-finite"),
    }
    for reason, (surfaces, words) in refused.items():
        with pytest.raises(MeshError, match=words) as told:
            check_faces(surfaces, "it")
        assert told.value.reason == reason
    assert MOST_FACES < 1_000_000
