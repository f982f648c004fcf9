"""Feet: the part of an object's underside that carries it, seen from above."""

from collections.abc import Callable

import numpy as np
import shapely
from shapely.geometry import MultiPoint

from sceniris_gym.config.bounds import MAX_FOOT
from sceniris_gym.geometry.resting_poses import ROCKING

# Points up to this height [m] above the lowest point are on the same level.
_FLAT = 2.0e-4
# The lean that measures a foot moves a point by at most this [m]. A lean by the rocking angle would move a chair on its
# back by up to 3 cm.
_MOVE = 3.0e-3
# Number of directions of a curved foot, angles [rad] of the successively finer searches for its narrowest direction,
# and the foot's least reach [m].
_SIDES, _SPANS, _POINT = 360, np.radians([180.0, 1.0, 0.01, 1.0e-4, 1.0e-6]), 1.0e-7
# A foot is curved if its area at a fifth of the lean is less than this fraction of its area at the whole lean.
_SHARE = 0.5


def flat_foot(pieces: list[np.ndarray]) -> list[np.ndarray]:
    """Return the foot of convex pieces on level ground, empty if it is curved and therefore rolls as it leans.

    The object leans in all directions by the rocking angle of stable poses, or by less if a point would move by 3 mm. A
    piece has a foot if it touches the ground upright or during such a lean. The corners of the foot are the points that
    touch the ground as the piece leans by this angle.

    Args:
        pieces: Vertices of each piece [m], z up, shape (n, 3).

    Returns:
        The corners [m] of each piece with a foot, counter-clockwise, at most `MAX_FOOT`, shape (m, 2).
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

    A lean by the angle in any direction raises a centre of mass that is inside the corners by more than its height
    times the tangent of half the angle.

    Args:
        lowest: Function of upward directions, shape (n, 3), that returns the height of the lowest point along each [m],
            shape (n,), relative to a point of the ground below.
        angle: The angle [rad].
    """

    def reach(angles: np.ndarray) -> np.ndarray:
        upward = np.full(len(angles), np.cos(angle))
        level = -np.sin(angle) * np.stack([np.cos(angles), np.sin(angles)])
        return -lowest(np.column_stack([*level, upward])) / np.sin(angle)

    narrow = 0.0  # the narrowest direction, which has to be exact because a roller rolls along it
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
    """Return the index of the lowest of `points` (n, 3) after a lean [rad] in each direction, shape (MAX_FOOT,)."""
    return (points[:, 2:] * np.cos(lean) - points[:, :2] @ (np.sin(lean) * around(MAX_FOOT)).T).argmin(axis=0)


def _corners(points: np.ndarray, lean: float) -> np.ndarray:
    """Return the corners of the foot of a piece, shape (n, 2): its points (n, 3) that are lowest after a lean [rad]."""
    found = points[_touching(points, lean), :2]
    kept = found[(found != np.roll(found, 1, axis=0)).any(axis=1)]
    return kept if len(kept) else found[:1]


def around(number: int) -> np.ndarray:
    """Return evenly spaced directions all around, shape (number, 2). An offset keeps them off the axes."""
    angle = 2.0 * np.pi * (np.arange(number) + 0.47) / number
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
