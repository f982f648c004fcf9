"""Feet: the part of an object's underside that carries it, seen from above."""

from __future__ import annotations

import numpy as np
from shapely.geometry import MultiPoint

from sceniris_gym.config.limits import MAX_FOOT
from sceniris_gym.geometry.resting_poses import ROCKING

# Points this far [m] above the lowest one are on the same level.
_FLAT = 2.0e-4
# A foot that shrinks to less than this share of its area as it leans by a fifth of the angle is curved.
_SHARE = 0.5


def foot(pieces: list[np.ndarray], height: float) -> tuple[list[np.ndarray], bool]:
    """Return the foot of convex pieces on level ground, and whether it is curved, so that it rolls as it leans.

    A piece has a foot if it reaches the ground, also as the whole leans by the angle that a stable pose may rock by.
    Its corners are the points that touch the ground as it leans by that in all directions. A curved foot is one part,
    and wider by the way that the centre of mass may be off as it leans.

    Args:
        pieces: Vertices of each piece [m], z up, shape (n, 3).
        height: Height of the centre of mass over the ground [m].

    Returns:
        For each piece with a foot its corners [m], counter-clockwise, `MAX_FOOT` at most, shape (m, 2); and True for a
        curved foot.
    """
    points = np.concatenate(pieces)
    owner = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
    bottom = points[:, 2].min() + _FLAT
    touching = _touching(points)
    level, whole = (MultiPoint(points[found, :2]).convex_hull.area for found in (_touching(points, 0.2), touching))
    carrying = {*owner[touching].tolist(), *owner[points[:, 2] < bottom].tolist()}
    if level > _SHARE * whole:
        return [_corners(pieces[i]) for i in sorted(carrying)], False
    return [points[touching, :2] + height * np.sin(np.radians(ROCKING)) * around(MAX_FOOT)], True


def _touching(points: np.ndarray, share: float = 1.0) -> np.ndarray:
    """Return the numbers of the points that are lowest as they lean by a share of the angle in all directions."""
    lean = np.radians(share * ROCKING)
    return (points[:, 2:] * np.cos(lean) - points[:, :2] @ (np.sin(lean) * around(MAX_FOOT)).T).argmin(axis=0)


def _corners(points: np.ndarray) -> np.ndarray:
    """Return the corners of the foot of one piece."""
    found = points[_touching(points), :2]
    kept = found[(found != np.roll(found, 1, axis=0)).any(axis=1)]
    return kept if len(kept) else found[:1]


def around(number: int) -> np.ndarray:
    """Return so many directions all around, shape (number, 2), none of them along an axis."""
    angle = 2.0 * np.pi * (np.arange(number) + 0.47) / number
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
