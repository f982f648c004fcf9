"""Poses that an object's orientation is drawn from: as authored, or its stable poses with their probabilities."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh

from sceniris_gym.scene.device import PieceType
from sceniris_gym.scene.pieces import Piece

# Stable poses that are rarer than the most frequent one by this factor are left out, and no more than so many are kept:
# each of the many narrow faces of something round is rare, and together they are what it lies on.
_RARE = 1.0e-3
_MOST_POSES = 256
# An x axis whose shadow is shorter than this points straight up or down, but for rounding.
_UPRIGHT = 1.0e-3


@dataclass(frozen=True)
class Variant:
    """One pose of an object, turned about the vertical so that its heading is 0.

    Attributes:
        quat: Orientation of its root, wxyz.
        pivot: Bottom centre of its bounds in its root's frame [m].
        bounds: Bounds in xy around the pivot [m]: low x, low y, high x, high y.
        probability: How often it is drawn.
    """

    quat: np.ndarray
    pivot: np.ndarray
    bounds: np.ndarray
    probability: float = 1.0

    @property
    def short_edge(self) -> float:
        """The shorter edge of the bounds [m]."""
        return float((self.bounds[2:] - self.bounds[:2]).min())


class HomeShape:
    """The pieces of an object in its home state, seen from its root."""

    def __init__(self, home: mujoco.MjData, root: int, pieces: list[Piece]) -> None:
        self._pieces = pieces
        back = home.xmat[root].reshape(3, 3).T
        self._mats = [back @ home.xmat[p.body].reshape(3, 3) for p in pieces]
        self._at = [back @ (home.xpos[p.body] - home.xpos[root]) for p in pieces]
        self.center_of_mass = back @ (home.subtree_com[root] - home.xpos[root])

    def variant(self, quat: np.ndarray, probability: float = 1.0) -> Variant:
        """The pose with the root's orientation `quat` (of heading 0)."""
        turn = matrix(quat)
        if not self._pieces:
            return Variant(quat, np.zeros(3), np.zeros(4), probability)
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for p, mat, at in zip(self._pieces, self._mats, self._at, strict=True):
            low, high = p.extents(turn @ mat)
            lower, upper = np.minimum(lower, low + turn @ at), np.maximum(upper, high + turn @ at)
        bottom = np.array([*0.5 * (lower + upper)[:2], lower[2]])
        half = 0.5 * (upper - lower)[:2]
        return Variant(quat, turn.T @ bottom, np.concatenate([-half, half]), probability)

    def inner_radius(self) -> float:
        """Radius [m] of a ball inside of the hull: seen from any side, the bounds are at least twice as wide."""
        if not self._pieces:
            return 0.0
        hull = trimesh.convex.convex_hull(self._points())
        to_faces = hull.triangles[:, 0] - hull.center_mass
        return max(float((to_faces * hull.face_normals).sum(axis=1).min()), 0.0)

    def hull(self, body: int) -> Piece:
        """All pieces as one convex piece of the root body `body`: the convex footprint in any orientation."""
        vertices = trimesh.convex.convex_hull(self._points()).vertices
        middle = vertices.mean(axis=0)
        unit = np.array([1.0, 0.0, 0.0, 0.0])
        return Piece(-1, body, PieceType.HULL, middle, unit, np.zeros(3), vertices - middle, None, 0, 0)

    def _points(self) -> np.ndarray:
        """Vertices of all pieces in the root's frame [m], shape (n, 3)."""
        points = [
            at + (p.mesh.vertices if p.mesh is not None else np.zeros((0, 3))) @ mat.T
            for p, mat, at in zip(self._pieces, self._mats, self._at, strict=True)
        ]
        return np.concatenate(points)

    def stable(self) -> list[Variant]:
        """Stable poses on a plane by the quasi-static estimate of K. Goldberg et al., "Part pose statistics", 1999."""
        hull = trimesh.convex.convex_hull(self._points())
        transforms, probability = trimesh.poses.compute_stable_poses(
            hull, center_mass=self.center_of_mass, sigma=0.0, n_samples=1, threshold=0.0
        )
        kept = np.argsort(-probability, kind="stable")[:_MOST_POSES]
        kept = kept[probability[kept] > _RARE * probability[kept[0]]]
        share = probability[kept] / probability[kept].sum()
        return [
            self.variant(of_heading_zero(transforms[i][:3, :3]), float(p)) for i, p in zip(kept, share, strict=True)
        ]


def heading_of(mat: np.ndarray) -> float:
    """Where the x axis of a body with orientation `mat`, shape (3, 3), points, seen from above [rad].

    Where it points straight up or down, where the y axis points, less a right angle.
    """
    if np.abs(mat[:2, 0]).sum() < _UPRIGHT:
        return float(np.arctan2(-mat[0, 1], mat[1, 1]))
    return float(np.arctan2(mat[1, 0], mat[0, 0]))


def of_heading_zero(mat: np.ndarray) -> np.ndarray:
    """The orientation `mat`, shape (3, 3), turned about the vertical so that its heading is 0, as wxyz."""
    back = -heading_of(mat)
    turn = np.array([[np.cos(back), -np.sin(back), 0.0], [np.sin(back), np.cos(back), 0.0], [0.0, 0.0, 1.0]])
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, (turn @ mat).ravel())
    return quat


def matrix(quat: np.ndarray) -> np.ndarray:
    """The rotation matrix (3, 3) of a wxyz quaternion."""
    mat = np.empty(9)
    mujoco.mju_quat2Mat(mat, np.asarray(quat, float))
    return mat.reshape(3, 3)
