"""Convex collision pieces inside the visual meshes, so that objects with disjoint visual meshes never touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from .shapes import DECIMALS, Mesh, hull, surface

# Largest depth of a visual mesh's face inside a piece [m].
TOLERANCE = 5e-6
# Sample points on a face (barycentric): corners, sides and interior.
SAMPLES = np.array([[i, j, 15 - i - j] for i in range(16) for j in range(16 - i)]) / 15.0

# Samples whose depths fit into a processor's cache.
CHUNK = 2048


def press_in(points: np.ndarray, meshes: Sequence[Mesh], ground: float = -np.inf) -> Mesh:
    """Return the convex hull of ``points`` (n, 3) [m], pressed in where it sticks out of one of the ``meshes``.

    A hull bridges the inside of a bend, so it contains faces of the mesh. The normal of such a face exits the hull
    through one of the hull's sides, and this side is moved inward to the face. The deepest face comes first. An
    underside at the height ``ground`` [m] stays at this height.
    """
    low, high = points.min(axis=0) - TOLERANCE, points.max(axis=0) + TOLERANCE
    samples, normals = (
        np.concatenate(part) for part in zip(*(face_samples(m, low, high) for m in meshes), strict=True)
    )
    grounded = (normals[:, 2] < -0.999) & (samples[:, 2] < ground + TOLERANCE)
    within = ((samples > low) & (samples < high)).all(axis=1) & ~grounded
    samples, normals = samples[within], normals[within]
    vertices = np.asarray(points, dtype=float)
    while True:
        vertices = vertices[ConvexHull(vertices).vertices]
        sides = ConvexHull(vertices)
        movable = (sides.equations[:, 2] > -0.999) | (vertices[sides.simplices, 2].min(axis=1) > ground + TOLERANCE)
        planes, corners = sides.equations[movable], sides.simplices[movable]
        depth = np.ones(len(samples))
        for i in range(0, len(samples), CHUNK):
            depths = planes[:, :3] @ -samples[i : i + CHUNK].T - planes[:, 3:]
            depth[i : i + CHUNK] = depths.min(axis=0, initial=1.0)
        if len(depth) == 0 or depth.max() < TOLERANCE:
            return surface(hull(vertices.round(DECIMALS)))
        # The piece only shrinks, so faces that are outside now stay outside.
        inside = depth > 0.0
        samples, normals, depth = samples[inside], normals[inside], depth[inside]
        deepest = depth.argmax()
        depths, slope = -planes[:, :3] @ samples[deepest] - planes[:, 3], planes[:, :3] @ normals[deepest]
        side = np.where(slope > 0.01, depths / np.maximum(slope, 0.01), np.inf).argmin()
        on_ground = vertices[corners[side], 2] < ground + TOLERANCE
        inward = planes[side, :3] * np.stack([np.ones(3), np.ones(3), ~on_ground], axis=1)
        vertices[corners[side]] -= depths[side] * inward / (inward**2).sum(axis=1, keepdims=True)


def face_samples(mesh: Mesh, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points on the faces of a mesh that reach into a box [m], and the normals of the faces, both (n, 3)."""
    corners = mesh.vertices[mesh.faces]
    corners = corners[((corners.max(axis=1) > low) & (corners.min(axis=1) < high)).all(axis=1)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    corners, normals = corners[area > 1e-12], normals[area > 1e-12] / area[area > 1e-12, None]
    return (SAMPLES @ corners).reshape(-1, 3), np.repeat(normals, len(SAMPLES), axis=0)


def few_corners(points: np.ndarray, count: int) -> np.ndarray:
    """Select up to ``count`` of ``points`` (n, 3) [m]: repeatedly the point farthest outside the selection's hull."""
    points = points[ConvexHull(points).vertices]
    ends = np.concatenate([np.eye(3), -np.eye(3), [[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]]])
    chosen = np.unique(((points - points.mean(axis=0)) @ ends.T).argmax(axis=0)).tolist()
    while len(chosen) < min(count, len(points)):
        planes = ConvexHull(points[chosen]).equations
        chosen.append(int((points @ planes[:, :3].T + planes[:, 3]).max(axis=1).argmax()))
    return points[chosen]
