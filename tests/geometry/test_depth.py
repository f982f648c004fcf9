"""Bound on the depth of points inside a mesh: it is never below the truth, and not far above it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
import warp as wp

from sceniris_gym.geometry.depth import most_depth

CELLS = 24


def _turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.1, 0.2, 0.3]))
    return mesh


def _two() -> trimesh.Trimesh:
    small, large = trimesh.creation.box((0.1, 0.1, 0.1)), trimesh.creation.box((0.3, 0.4, 0.5))
    vertices = np.concatenate([large.vertices, small.vertices + [1.0, 0.0, 0.0]])
    return trimesh.Trimesh(vertices, np.concatenate([large.faces, small.faces + len(large.vertices)]))


MESHES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "box": lambda: trimesh.creation.box((0.4, 0.3, 0.2)),
    "turned box": lambda: _turned(trimesh.creation.box((0.4, 0.3, 0.2))),
    "sheet": lambda: trimesh.creation.box((0.5, 0.5, 0.001)),
    "turned sheet": lambda: _turned(trimesh.creation.box((0.5, 0.5, 0.001))),
    "needle": lambda: _turned(trimesh.creation.cylinder(0.002, 0.6)),
    "ball": lambda: trimesh.creation.icosphere(3, 0.05),
    "pipe": lambda: trimesh.creation.annulus(0.08, 0.1, 0.3),
    "ring": lambda: trimesh.creation.torus(0.3, 0.1),
    "two": _two,
    "grain": lambda: trimesh.creation.box((1e-5, 1e-5, 1e-5)),
}


def _depth(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Distance [m] of points from the surface, by trimesh; negative outside, by the sum of all solid angles.

    A. van Oosterom, J. Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomedical Engineering 30(2), 1983.
    """
    _, distance, _ = trimesh.proximity.closest_point_naive(mesh, points)
    a, b, c = (mesh.triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=2)
    cosine = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    inside = np.arctan2(volume, cosine).sum(axis=1) > np.pi
    return np.where(inside, distance, -distance)


def _greatest_depth(mesh: trimesh.Trimesh) -> float:
    """The depth [m] of the deepest of many points, and of many more around the deepest ones found before."""
    rng = np.random.default_rng(0)
    inward = np.linspace(0.0, mesh.extents.min(), 6)[1:, None, None] * -mesh.face_normals[:20]
    points = np.concatenate(
        [rng.uniform(mesh.bounds[0], mesh.bounds[1], (1000, 3)), (mesh.triangles_center[:20] + inward).reshape(-1, 3)]
    )
    spread, deepest = 0.1 * mesh.scale, 0.0
    for _ in range(16):
        depth = _depth(mesh, points)
        deepest = max(deepest, float(depth.max()))
        best = points[np.argsort(depth)[-5:]]
        spread *= 0.6
        points = np.concatenate([best, (best[:, None] + rng.normal(0.0, spread, (5, 40, 3))).reshape(-1, 3)])
    return deepest


@pytest.mark.parametrize("name", MESHES)
def test_no_point_inside_is_deeper_than_the_bound(name: str):
    """By trimesh's distances of points all over the solid; and the bound is too large by half a cell's diagonal."""
    mesh = MESHES[name]()
    assert mesh.is_watertight
    points = wp.array(mesh.vertices, dtype=wp.vec3, device="cpu")
    indices = wp.array(mesh.faces.ravel(), dtype=int, device="cpu")
    solid = wp.Mesh(points, indices, support_winding_number=True)
    bound = most_depth(solid, mesh.bounds[0], mesh.bounds[1], "cpu")
    truth = _greatest_depth(mesh)
    cell = max(float(mesh.extents.max()) / CELLS, 1e-6)
    assert truth > 0.0
    assert bound >= truth
    assert bound <= truth + 0.5 * np.sqrt(3.0) * cell + 1e-6
