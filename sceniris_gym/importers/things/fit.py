"""Distance between convex parts and the surface that they replace, measured both ways.

The error is the larger of two distances: that of the surface from the parts, and that of the parts' outside from the
surface. Their outside is what a ball whose diameter is the tolerance can touch. A gap between parts that this ball
cannot enter is no error: to close it, parts would have to grow by half the tolerance at most. Points of the surface
within such a gap count like any others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import fcl
import numpy as np
import trimesh
from scipy.spatial import KDTree

LEAST_TOLERANCE, SHARE = 0.002, 0.02
"""Parts should stay within 2 mm of the mesh, or 2% of its longest edge if that is more."""
_SAMPLES = 10_000  # points on either side
_LEAST = 200  # points on each part
# Rounds in which more points are drawn near those that may be farthest, the number around each of them, and how many of
# them there are; each round halves the spacing. Without them the errors of a kettle and an arm's link came out a
# seventh smaller.
_FINER, _AROUND, _DOUBTFUL = 3, 4, 100
_BALL = 0.8  # of the tolerance, so that no small place is missed that the ball of the definition just enters
_NEAR = 60_000  # points on the surface that bound distances from above
_BESIDE = 1e-5  # of the size: parts that are nearer to each other leave no gap
_NEEDLE = 1e-6  # sine of the least angle between edges of a face whose distances FCL computes correctly


@dataclass(frozen=True)
class Fit:
    """The distances between parts and a mesh [m].

    Attributes:
        bare: The farthest that the mesh reaches out of the parts.
        beyond: The farthest that the parts' outside is from the surface of the mesh: they fill a hollow, or stick out.
    """

    bare: float
    beyond: float

    @property
    def error(self) -> float:
        """The larger of both."""
        return max(self.bare, self.beyond)


def tolerance_of(mesh: trimesh.Trimesh) -> float:
    """Return the default tolerance of convex parts of a mesh [m]."""
    return max(LEAST_TOLERANCE, SHARE * float(mesh.extents.max()))


class Measure:
    """Measures parts against one mesh, at points drawn with a fixed seed.

    Args:
        mesh: The mesh, which may be open.
        tolerance: The largest distance of parts from it [m], and the diameter of the ball that touches them.
        samples: Number of points that are drawn on either side.
    """

    def __init__(self, mesh: trimesh.Trimesh, tolerance: float, samples: int = _SAMPLES) -> None:
        self._size, self._area, self._radius = float(mesh.extents.max()), float(mesh.area), 0.5 * _BALL * tolerance
        self.samples, self._surface = samples, Distances(mesh.vertices, mesh.faces)
        self._points = np.concatenate(
            [points_on(mesh.triangles, samples), mesh.vertices[:: max(len(mesh.vertices) // samples, 1)]]
        )

    def fit(self, parts: list[trimesh.Trimesh]) -> Fit:
        """Return the distances between the mesh and its parts, which are closed and convex."""
        beside = _BESIDE * self._size
        out = np.min([height_over(part, self._points) for part in parts], axis=0)
        bare = 0.0
        if len(far := self._points[out > beside]):
            union = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
            bare = Distances(*union).farthest(far)[1]
        beyond = max(self.beyond(part, [*parts[:i], *parts[i + 1 :]]) for i, part in enumerate(parts))
        return Fit(bare, beyond)

    def beyond(self, part: trimesh.Trimesh, others: list[trimesh.Trimesh]) -> float:
        """Return the largest distance of the outside of a part among others from the surface of the mesh [m]."""
        share = max(int(self.samples * min(float(part.area) / self._area, 1.0)), _LEAST)
        apart = np.sqrt(float(part.area) / share)
        points, normals = points_with_normals(part.triangles, share)
        points = np.concatenate([points, part.triangles.reshape(-1, 3)])
        normals = np.concatenate([normals, np.repeat(part.face_normals, 3, axis=0)])
        near = [other for other in others if are_near(part, other, 2.0 * self._radius)]
        most, rng = 0.0, np.random.default_rng(1)
        for finer in range(_FINER + 1):
            away, found, kept = self._touched(points, normals, near)
            most = max(most, found)
            if finer == _FINER or most < apart:
                break
            first = np.argsort(-away)[:_DOUBTFUL]
            doubtful = np.repeat(kept[first[away[first] > most - apart]], _AROUND)  # a point beside may be farther away
            shift = apart * rng.uniform(-1.0, 1.0, (len(doubtful), 3))
            shift -= (shift * normals[doubtful]).sum(axis=1, keepdims=True) * normals[doubtful]
            points, normals = points[doubtful] + shift, normals[doubtful]
            on = height_over(part, points) <= _BESIDE * self._size
            points, normals, apart = points[on], normals[on], 0.5 * apart
        return most

    def _touched(
        self, points: np.ndarray, normals: np.ndarray, near: list[trimesh.Trimesh]
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Find the points of a part that no other part covers, and the farthest of them that the ball touches.

        Returns:
            An upper bound of the distance of each of these points from the surface [m], shape (m,); the distance of the
            farthest that the ball touches [m]; and the indices of these points, shape (m,).
        """
        beside = _BESIDE * self._size
        middles, bare = points + self._radius * normals, np.ones(len(points), bool)
        for other in near:
            bare[bare] = height_over(other, middles[bare]) > -beside
        middles, least = middles[bare], self._radius - beside

        def fits(i: int) -> bool:
            return all(_distance_over(other, middles[i], least) >= least for other in near)

        away, most, _ = self._surface.farthest(points[bare], fits)
        return away, most, np.flatnonzero(bare)


def are_near(one: trimesh.Trimesh, other: trimesh.Trimesh, distance: float) -> bool:
    """Return whether the bounds of two parts are at most a distance [m] apart."""
    low, high = one.bounds
    return bool((low <= other.bounds[1] + distance).all() and (other.bounds[0] <= high + distance).all())


def height_over(part: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Return the height of points (n, 3) above the planes of a convex part's faces: negative inside of it."""
    normals = part.face_normals
    return (points @ normals.T - (normals * part.triangles[:, 0]).sum(axis=1)).max(axis=1)


def _distance_over(part: trimesh.Trimesh, point: np.ndarray, enough: float) -> float:
    """Return the distance of a point (3,) outside of a convex part from it [m]; a lower bound where that is enough."""
    if (height := float(height_over(part, point[None])[0])) >= enough:
        return height
    nearest = trimesh.triangles.closest_point(part.triangles, np.broadcast_to(point, (len(part.faces), 3)))
    return float(np.linalg.norm(nearest - point, axis=1).min())


class Distances:
    """Distances from triangles, by FCL where those from samples leave a doubt.

    Args:
        vertices: Their corners [m], shape (n, 3).
        faces: Indices of the corners of each, shape (m, 3).
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        # FCL returns 0 for faces without area, wherever they are. Their edges belong to other faces, too.
        a, b = (vertices[faces[:, i]] - vertices[faces[:, 0]] for i in (1, 2))
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        faces = faces[np.linalg.norm(np.cross(a, b), axis=1) > _NEEDLE * lengths]
        model = fcl.BVHModel()
        model.beginModel(len(faces), len(vertices))
        model.addSubModel(np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int64))
        model.endModel()
        self._object = fcl.CollisionObject(model)
        # A point is a ball too small to matter, of a size relative to the mesh.
        self._ball = fcl.Sphere(1e-6 * float(np.ptp(vertices, axis=0).max()))
        self._samples = KDTree(np.concatenate([vertices, points_on(vertices[faces], _NEAR)]))

    def farthest(
        self, points: np.ndarray, counts: Callable[[int], bool] = lambda i: True
    ) -> tuple[np.ndarray, float, int]:
        """Find the farthest of points (n, 3).

        Args:
            points: The points [m].
            counts: Tells whether a point counts, by its index.

        Returns:
            An upper bound of the distance of each point [m], shape (n,); the largest distance of those that count, 0 if
            none does; and the index of that point.
        """
        at_most, most, which = self._samples.query(points)[0], 0.0, 0
        for i in np.argsort(-at_most):
            if at_most[i] <= most:
                break
            ball = fcl.CollisionObject(self._ball, fcl.Transform(points[i]))
            away = float(fcl.distance(self._object, ball, fcl.DistanceRequest(), fcl.DistanceResult()))
            if away > most and counts(int(i)):
                most, which = away, int(i)
        return at_most, most, which


def points_on(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return points on triangles (n, 3, 3), uniform by area, shape (count, 3)."""
    return points_with_normals(triangles, count)[0]


def points_with_normals(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points on triangles (n, 3, 3), uniform by area, and their normals, shapes (count, 3)."""
    rng = np.random.default_rng(0)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normals, axis=1)
    which = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1)
    return (triangles[which] * weights[:, :, None]).sum(axis=1), normals[which] / area[which, None]
