"""Tubes along a path in space."""

from __future__ import annotations

import numpy as np

from .shapes import Mesh, skin


def tube(path: np.ndarray, radius: float | np.ndarray, segments: int, flatten: float = 1.0) -> Mesh:
    """A tube with flat ends along ``path`` (n, 3) [m].

    ``radius`` [m] is one value, or one per station. ``flatten`` scales the section across the plane of the path. The
    section moves along the path without twist. The path may bend in space, but must not reverse its direction.
    """
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    middle = len(path) // 2
    normal = np.cross(path[-1] - path[0], path[middle] - path[0])
    radii = np.broadcast_to(radius, len(path))
    angle = 2.0 * np.pi * np.arange(segments) / segments
    rings = []
    for point, along, size in zip(path, tangent, radii, strict=True):
        normal = normal - along * (normal @ along)
        normal = normal / np.linalg.norm(normal)
        side = np.cross(normal, along)
        # Counter-clockwise as seen from the start of the path.
        rings.append(point + size * (np.outer(np.sin(angle), side) + flatten * np.outer(np.cos(angle), normal)))
    return skin(np.array(rings), path[0], path[-1], np.linspace(0.0, 1.0, len(path) + 2))
