"""Computes feet. The foot of an object is the part of its underside on which it stands, seen from above."""

from collections.abc import Callable

import numpy as np
import shapely
from shapely.geometry import MultiPoint

from sceniris_gym.config.bounds import MAX_FOOT
from sceniris_gym.geometry.resting_poses import ROCKING

# Points up to this height [m] above the lowest point are on its level.
_FLAT = 2.0e-4
# To measure a foot, the object leans. A point moves by at most this distance [m]. If a chair on its back leaned by the
# rocking angle, a point would move by up to 3 cm.
_MOVE = 3.0e-3
# For a curved foot: number of directions, half ranges [rad] of the successively finer searches for its narrowest
# direction, and least distance [m] from the middle of the foot to its edge.
_SIDES, _SPANS, _POINT = 360, np.radians([180.0, 1.0, 0.01, 1.0e-4, 1.0e-6]), 1.0e-7
# A foot is curved if its area at a fifth of the lean is less than this fraction of its area at the whole lean.
_SHARE = 0.5


def flat_foot(pieces: list[np.ndarray]) -> list[np.ndarray]:
    """Return the foot of each convex piece of an object on level ground.

    To find the foot, the object leans in `MAX_FOOT` directions. The angle is `ROCKING`, or less if a point of the
    object would move by more than 3 mm. A piece has a foot if it touches the ground when the object is upright or
    leans. For each direction, the lowest point of the piece is a corner of this foot.

    Args:
        pieces: Vertices of each piece [m], z up, shape (n, 3).

    Returns:
        For each piece that has a foot, the corners of the foot [m], counter-clockwise, at most `MAX_FOOT`, shape
        (m, 2). The list is empty if the underside is curved, because the object would roll.
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
    """Return the corners [m] of the foot of an object with a curved underside, shape (n, 2).

    The foot tells whether the object rolls back after a lean by `angle` in any direction. The object does so if its
    centre of mass, at the height h, is above the foot and farther than h * tan(angle / 2) from the foot's edges.

    Args:
        lowest: Function of n upward directions, shape (n, 3). For each direction, it returns the height [m] of the
            object's lowest point along this direction, relative to a fixed point on the ground below the object,
            shape (n,).
        angle: Angle of the lean [rad].
    """

    def reach(angles: np.ndarray) -> np.ndarray:
        upward = np.full(len(angles), np.cos(angle))
        level = -np.sin(angle) * np.stack([np.cos(angles), np.sin(angles)])
        return -lowest(np.column_stack([*level, upward])) / np.sin(angle)

    narrow = 0.0  # direction in which the foot is narrowest, which has to be exact because a roller rolls along it
    for span in _SPANS:
        tries = narrow + span * np.linspace(-1.0, 1.0, _SIDES + 1)
        narrow = tries[(reach(tries) + reach(tries + np.pi)).argmin()]
    angles = narrow + 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    sides, far = np.column_stack([np.cos(angles), np.sin(angles)]), reach(angles)
    middle = 2.0 * (far[:, None] * sides).mean(axis=0)
    far = np.maximum(far - sides @ middle, _POINT)
    # polar duality: corners of the foot correspond to edges of the hull of the inverse distances
    dual = shapely.get_coordinates(MultiPoint(sides / far[:, None]).convex_hull)
    edges = np.stack([dual[:-1], dual[1:]], axis=1)
    return middle + np.linalg.solve(edges, np.ones((len(edges), 2, 1)))[..., 0]


def _touching(points: np.ndarray, lean: float) -> np.ndarray:
    """For each of MAX_FOOT directions, return the index of the lowest of `points` (n, 3) after a lean [rad]."""
    return (points[:, 2:] * np.cos(lean) - points[:, :2] @ (np.sin(lean) * around(MAX_FOOT)).T).argmin(axis=0)


def _corners(points: np.ndarray, lean: float) -> np.ndarray:
    """Return the corners of a piece's foot, shape (n, 2): the point of `points` (m, 3) that is lowest in each lean."""
    found = points[_touching(points, lean), :2]
    kept = found[(found != np.roll(found, 1, axis=0)).any(axis=1)]
    return kept if len(kept) else found[:1]


def around(number: int) -> np.ndarray:
    """Return evenly spaced unit vectors on a circle, shape (number, 2). No vector is parallel to an axis."""
    angle = 2.0 * np.pi * (np.arange(number) + 0.47) / number
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
