"""Feet: the part of an object's underside that carries it, seen from above."""

from __future__ import annotations

import numpy as np
from shapely.geometry import MultiPoint, Polygon

from sceniris_gym.config.limits import MAX_FOOT
from sceniris_gym.geometry.resting_poses import ROCKING

# Points this far [m] above the lowest one are on the same flat face.
_FLAT = 2.0e-4
# A foot whose flat part is smaller than this share of it is curved.
_SHARE = 0.5


def foot(points: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the foot of a shape on level ground, and whether it is curved, so that it rolls as it leans.

    The corners of a foot are the points that touch the ground as the shape leans by the angle that a stable pose may
    rock by, in all directions: those of a flat face, and those around the lowest point of a curved one.

    Args:
        points: Vertices of the shape [m], z up, shape (n, 3).

    Returns:
        Corners [m], counter-clockwise, `MAX_FOOT` of them at most, shape (m, 2); and True for a curved foot.
    """
    lean = np.radians(ROCKING)
    across = np.sin(lean) * around(MAX_FOOT)
    heights = points[:, 2:] * np.cos(lean) - points[:, :2] @ across.T
    touching = points[heights.argmin(axis=0), :2]
    kept = touching[(touching != np.roll(touching, 1, axis=0)).any(axis=1)]
    corners = kept if len(kept) else touching[:1]
    flat = MultiPoint(points[points[:, 2] < points[:, 2].min() + _FLAT, :2]).convex_hull
    return corners, bool(len(corners) < 3 or flat.area < _SHARE * Polygon(corners).convex_hull.area)


def around(number: int) -> np.ndarray:
    """Return so many directions all around, shape (number, 2), none of them along an axis."""
    angle = 2.0 * np.pi * (np.arange(number) + 0.47) / number
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
