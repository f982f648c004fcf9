"""Feet: the part of an object's underside that carries it, seen from above."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from shapely.geometry import MultiPoint

from sceniris_gym.config.bounds import MAX_FOOT
from sceniris_gym.geometry.resting_poses import ROCKING

# Points this far [m] above the lowest one are on the same level.
_FLAT = 2.0e-4
# A foot is what touches before a lean has moved any point by this [m]: a chair on its back rocks by up to 3 cm.
_MOVE = 3.0e-3
# Number of directions in which a curved foot is measured, the angles [rad] up to which the narrowest one is searched,
# each around the one before, and the foot's least reach [m].
_SIDES, _TURNS, _POINT = 360, np.radians([180.0, 1.0, 0.01, 1.0e-4, 1.0e-6]), 1.0e-7
# A foot that shrinks to less than this share of its area as it leans by a fifth of the angle is curved.
_SHARE = 0.5


def flat_foot(pieces: list[np.ndarray]) -> list[np.ndarray]:
    """Return the foot of convex pieces on level ground; nothing if it is curved, so that it rolls as it leans.

    A piece has a foot if it reaches the ground, also as the whole leans by the angle that a stable pose may rock by, or
    by less if that moves it by 3 mm. Its corners are the points that touch the ground as it leans by that in all
    directions.

    Args:
        pieces: Vertices of each piece [m], z up, shape (n, 3).

    Returns:
        For each piece with a foot its corners [m], counter-clockwise, `MAX_FOOT` at most, shape (m, 2).
    """
    points = np.concatenate(pieces)
    owner = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
    bottom = points[:, 2].min() + _FLAT
    size = np.linalg.norm(points - [*points[:, :2].mean(axis=0), bottom], axis=1).max()
    lean = min(np.radians(ROCKING), _MOVE / size)
    level, touching = (_touching(points, share * lean) for share in (0.2, 1.0))
    narrow, whole = (MultiPoint(points[found, :2]).convex_hull.area for found in (level, touching))
    carrying = {*owner[touching].tolist(), *owner[points[:, 2] < bottom].tolist()}
    if narrow > _SHARE * whole:
        return [_corners(pieces[i], lean) for i in sorted(carrying)]
    return []


def curved_foot(lowest: Callable[[np.ndarray], np.ndarray], angle: float) -> np.ndarray:
    """Return the corners [m] of a curved foot, shape (n, 2).

    A centre of mass has risen as the whole leans by the angle in any direction if it is inside of the corners by more
    than its height times the tangent of half the angle.

    Args:
        lowest: Height of the lowest point [m], shape (n,), along upward directions, shape (n, 3); around a point of the
            ground below.
        angle: The angle [rad].
    """

    def reach(angles: np.ndarray) -> np.ndarray:
        upward = np.full(len(angles), np.cos(angle))
        level = -np.sin(angle) * np.stack([np.cos(angles), np.sin(angles)])
        return -lowest(np.column_stack([*level, upward])) / np.sin(angle)

    narrow = 0.0  # the direction in which it is the narrowest, exactly: a roller rolls along it
    for turn in _TURNS:
        tries = narrow + turn * np.linspace(-1.0, 1.0, _SIDES + 1)
        narrow = tries[(reach(tries) + reach(tries + np.pi)).argmin()]
    angles = narrow + 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    sides, far = np.column_stack([np.cos(angles), np.sin(angles)]), reach(angles)
    middle = 2.0 * (far[:, None] * sides).mean(axis=0)
    far = np.maximum(far - sides @ middle, _POINT)
    # a corner of what is as far away as this in each direction is an edge of the hull of the inverse distances
    dual = shapely.get_coordinates(MultiPoint(sides / far[:, None]).convex_hull)
    edges = np.stack([dual[:-1], dual[1:]], axis=1)
    return middle + np.linalg.solve(edges, np.ones((len(edges), 2, 1)))[..., 0]


def _touching(points: np.ndarray, lean: float) -> np.ndarray:
    """Return the numbers of the points that are lowest as they lean by an angle [rad] in all directions."""
    return (points[:, 2:] * np.cos(lean) - points[:, :2] @ (np.sin(lean) * around(MAX_FOOT)).T).argmin(axis=0)


def _corners(points: np.ndarray, lean: float) -> np.ndarray:
    """Return the corners of the foot of one piece."""
    found = points[_touching(points, lean), :2]
    kept = found[(found != np.roll(found, 1, axis=0)).any(axis=1)]
    return kept if len(kept) else found[:1]


def around(number: int) -> np.ndarray:
    """Return so many directions all around, shape (number, 2), none of them along an axis."""
    angle = 2.0 * np.pi * (np.arange(number) + 0.47) / number
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
