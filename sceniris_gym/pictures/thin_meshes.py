"""Meshes with fewer faces, for small pictures: vertices in a cell of a grid become one (Rossignac and Borrel 1993)."""

from __future__ import annotations

import numpy as np

LEAST_FACES = 100
"""Meshes with fewer faces are left alone."""
_GRIDS = (8, 12, 16, 24, 32)  # cells along the longest edge, coarse ones first
_SAME = 0.1  # share of area and of volume that may be lost or won, else thin parts have vanished
_SMALLER = 0.6  # share of the faces that a thinner mesh may have at most


def thin(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return a mesh of nearly the same shape with fewer faces, on the coarsest grid that keeps its area and volume.

    Args:
        vertices: Vertices [m], shape (n, 3).
        faces: Indices of vertices, shape (m, 3).

    Returns:
        Its vertices and faces; None if the mesh has few faces, or no grid keeps its shape.
    """
    if len(faces) < LEAST_FACES:
        return None
    measures = _area_and_volume(vertices, faces)
    for cells in _GRIDS:
        fewer_vertices, fewer_faces = _clustered(vertices, faces, cells)
        changed = np.abs(_area_and_volume(fewer_vertices, fewer_faces) - measures)
        if (changed < _SAME * np.abs(measures)).all() and len(fewer_faces) < _SMALLER * len(faces):
            return fewer_vertices, fewer_faces
    return None


def _clustered(vertices: np.ndarray, faces: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mesh with the vertices of each cell in their mean, without faces that have become lines."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max() / cells
    _, cluster = np.unique(((vertices - low) / size + 1e-6).astype(int), axis=0, return_inverse=True)
    cluster = cluster.ravel()
    means = np.stack([np.bincount(cluster, axis) for axis in vertices.T], axis=1) / np.bincount(cluster)[:, None]
    left = cluster[faces]
    left = left[(left != np.roll(left, 1, axis=1)).all(axis=1)]
    _, first = np.unique(np.sort(left, axis=1), axis=0, return_index=True)
    return means, left[np.sort(first)]


def _area_and_volume(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the area [m^2] of a surface and the volume [m^3] that it encloses, shape (2,)."""
    a, b, c = vertices[faces.T]
    across = np.cross(b - a, c - a) / 2.0
    return np.array([np.linalg.norm(across, axis=1).sum(), (a * across).sum() / 3.0])
