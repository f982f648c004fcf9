"""How near two geoms are at home, and which way out of each other is the shortest where they overlap there."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.geometry.pieces import Piece, PieceType

# Room [m] that geoms are given beyond their overlap, so that a distance says in which direction they are nearest.
_ROOM = 1.0e-3
# Overlaps end in under ten steps, and from most starts in two.
_STEPS = 30
_PRECISION = 1.0e-9  # m
_FAR = 1.0e3  # m
# Directions all around that are looked at, and how many of the best are followed, no two of which are as close as that
# cosine: of 4,200 overlaps of random shapes all ended within 1 um of the least one.
_SPREAD, _STARTS, _CLOSE = 400, 16, 0.95


@dataclass(frozen=True)
class Touch:
    """How near two geoms are.

    Attributes:
        distance: Their distance [m]; negative: how far one must move to leave the other.
        way: The direction, a unit vector of the world, shape (3,), in which the second is away from the first.
    """

    distance: float
    way: np.ndarray


class HomeTouch:
    """Measures distances between the geoms of a model at home.

    Overlaps are those along a direction, by the exact extents of both geoms: never less than what they are, and the
    least of what was found. MuJoCo's own depths stop early for some round shapes, and it takes some capsules that are
    in a box to be outside of it.

    Args:
        mjm: The model.
        home: Its poses at home, or any others.
    """

    def __init__(self, mjm: mujoco.MjModel, home: mujoco.MjData) -> None:
        self._mjm, self._home, self._moved = mjm, home, mujoco.MjData(mjm)
        self._moved.geom_xmat[:] = home.geom_xmat
        turn = 2.399963 * np.arange(_SPREAD)  # the golden angle spreads directions evenly over a sphere
        height = 1.0 - (2.0 * np.arange(_SPREAD) + 1.0) / _SPREAD
        ring = np.sqrt(1.0 - height**2)
        self._spread = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)

    def between(self, a: Piece, b: Piece, near: float) -> Touch | None:
        """Return how near two pieces of bodies are, a plane as the second; None from a distance `near` [m] on."""
        if b.type == PieceType.PLANE:
            way = -self._home.geom_xmat[b.geom].reshape(3, 3)[:, 2]
            top = way @ self._home.geom_xpos[b.geom]
            over = Touch(float(top - self._greatest(a, way[None])[0]), way)
            return over if over.distance < near else None
        apart = np.linalg.norm(self._home.geom_xpos[a.geom] - self._home.geom_xpos[b.geom])
        if apart - self._mjm.geom_rbound[[a.geom, b.geom]].sum() >= near:
            return None
        starts = np.concatenate([self._directions(a, b), self._spread])
        overlaps = self._overlaps(a, b, starts)
        if overlaps.min() <= -near:
            return None
        best = Touch(-np.inf, starts[0])
        followed = np.zeros((0, 3))
        for start in starts[np.argsort(overlaps, kind="stable")]:
            if len(followed) < _STARTS and (followed @ start < _CLOSE).all():
                followed = np.vstack([followed, start])
                found = self._shortest(a, b, start)
                best = found if found.distance > best.distance else best
        return best if best.distance < near else None

    def _directions(self, a: Piece, b: Piece) -> np.ndarray:
        """Directions that may be the shortest: MuJoCo's, from centre to centre, axes of both geoms and across them."""
        home, fromto = self._home, np.zeros(6)
        mujoco.mj_geomDistance(self._mjm, home, a.geom, b.geom, _FAR, fromto)
        away, apart = fromto[3:] - fromto[:3], home.geom_xpos[b.geom] - home.geom_xpos[a.geom]
        first, second = (home.geom_xmat[p.geom].reshape(3, 3).T for p in (a, b))
        across = np.cross(first[:, None], second[None]).reshape(-1, 3)
        axes = np.concatenate([first, second, across])
        found = np.concatenate([[away, -away, apart], axes, -axes])
        length = np.linalg.norm(found, axis=1)
        return found[length > 0.0] / length[length > 0.0, None]

    def _shortest(self, a: Piece, b: Piece, way: np.ndarray) -> Touch:
        """Follow a direction to a shorter way out.

        With b moved out along `way` and a little further, the direction of their distance is a better one, or the same:
        nowhere else are they further apart.
        """
        overlap = float(self._overlaps(a, b, way[None])[0])
        fromto = np.zeros(6)
        for _ in range(_STEPS):
            self._moved.geom_xpos[a.geom] = self._home.geom_xpos[a.geom]
            self._moved.geom_xpos[b.geom] = self._home.geom_xpos[b.geom] + (overlap + _ROOM) * way
            mujoco.mj_geomDistance(self._mjm, self._moved, a.geom, b.geom, _FAR, fromto)
            away = fromto[3:] - fromto[:3]
            if not np.linalg.norm(away) > 0.0:
                break
            other = away / np.linalg.norm(away)
            less = float(self._overlaps(a, b, other[None])[0])
            if not less < overlap - _PRECISION:
                break
            way, overlap = other, less
        return Touch(-overlap, way)

    def _overlaps(self, a: Piece, b: Piece, ways: np.ndarray) -> np.ndarray:
        """How far b must move [m] along each of some directions, shape (n, 3), until a plane separates it from a."""
        return self._greatest(a, ways) + self._greatest(b, -ways)

    def _greatest(self, piece: Piece, ways: np.ndarray) -> np.ndarray:
        """Greatest extent [m] of a piece along directions of the world, shape (n, 3)."""
        turned = self._home.xmat[piece.body].reshape(3, 3)
        return piece.extents(ways @ turned)[1] + ways @ self._home.xpos[piece.body]
