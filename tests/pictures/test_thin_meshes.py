"""Meshes with fewer faces: near the surface of the whole mesh, with its area and its orientation."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from sceniris_gym.pictures.thin_meshes import thin

WHOLE = {
    "ball": trimesh.creation.icosphere(subdivisions=4),
    "ring": trimesh.creation.torus(1.0, 0.2, major_sections=64, minor_sections=32),
    "rod": trimesh.creation.cylinder(0.02, 1.0, sections=600),
}


@pytest.mark.parametrize("name", ["ball", "ring"])
def test_a_mesh_has_fewer_faces_and_nearly_the_same_surface(name: str):
    """Its vertices are within a cell of the whole mesh, its volume is nearly the same, and its faces look outwards."""
    whole = WHOLE[name]
    found = thin(np.array(whole.vertices), np.array(whole.faces))
    assert found is not None
    vertices, faces = found
    assert len(faces) < 0.5 * len(whole.faces)
    _, distance, _ = trimesh.proximity.closest_point_naive(whole, vertices)
    assert distance.max() < np.ptp(whole.vertices, axis=0).max() / 8.0
    volume = trimesh.Trimesh(vertices, faces, process=False).volume
    assert volume == pytest.approx(whole.volume, rel=0.15)


def test_what_would_lose_its_shape_is_left_alone():
    """A thin rod would become a line; and a box has too few faces."""
    for mesh in (WHOLE["rod"], trimesh.creation.box()):
        assert thin(np.array(mesh.vertices), np.array(mesh.faces)) is None
