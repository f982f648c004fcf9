"""How far convex parts are from the surface that they stand for, both ways.

The error is the larger of two distances: of the surface from the parts, and of the parts' outside from the surface.
Their outside is what a ball can touch whose diameter is the tolerance. A gap between parts that this ball cannot enter
is no error: to close it, parts would have to grow by half the tolerance at most. Points of the surface within such a
gap count as any others do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import trimesh

LEAST_TOLERANCE, SHARE = 0.002, 0.02
"""Parts are to stay within 2 mm of the mesh, or 2% of its longest edge if that is more."""
_SAMPLES = 10_000  # points on either side
_LEAST = 200  # of them on each part
# How often more points are drawn where one may be farther away than all before: so many around each of the farthest so
# many, half as far apart. Without them the errors of a kettle and an arm's link came out a seventh smaller.
_FINER, _AROUND, _DOUBTFUL = 3, 4, 100
_BALL = 0.8  # of the tolerance, so that no small place is missed that the ball of the definition just gets into
_NEAR = 60_000  # points on the surface that distances are bounded by
_BESIDE = 1e-5  # of the size: parts that touch within this leave no gap
_NEEDLE = 1e-6  # sine of the least angle between edges of a face that FCL can tell distances of


@dataclass(frozen=True)
class Fit:
    """How parts fit a mesh [m].

    Attributes:
        bare: How far the mesh reaches out of the parts.
        beyond: How far the parts' outside is from the surface of the mesh: what they fill, or stick out by.
    """

    bare: float
    beyond: float

    @property
    def error(self) -> float:
        """The larger of both."""
        return max(self.bare, self.beyond)


def tolerance_of(mesh: trimesh.Trimesh) -> float:
    """How far convex parts may be from a mesh [m] if nothing else is said."""
    return max(LEAST_TOLERANCE, SHARE * float(mesh.extents.max()))


class Measure:
    """Measures parts against one mesh, at points drawn with a fixed seed.

    Args:
        mesh: The mesh; nothing of it needs to be closed.
        tolerance: How far parts may be from it [m]: the diameter of the ball that touches them.
        samples: How many points are drawn on either side.
    """

    def __init__(self, mesh: trimesh.Trimesh, tolerance: float, samples: int = _SAMPLES) -> None:
        self._size, self._area, self._radius = float(mesh.extents.max()), float(mesh.area), 0.5 * _BALL * tolerance
        self.samples, self._surface = samples, Distances(mesh.vertices, mesh.faces)
        self._points = np.concatenate(
            [points_on(mesh.triangles, samples), mesh.vertices[:: max(len(mesh.vertices) // samples, 1)]]
        )

    def fit(self, parts: list[trimesh.Trimesh]) -> Fit:
        """Return how parts, closed and convex, fit the mesh."""
        beside = _BESIDE * self._size
        out = np.min([height_over(part, self._points) for part in parts], axis=0)
        bare = 0.0
        if len(far := self._points[out > beside]):
            starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
            faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
            bare = Distances(np.concatenate([part.vertices for part in parts]), faces).farthest(far)[1]
        beyond = max(self.beyond(part, [*parts[:i], *parts[i + 1 :]]) for i, part in enumerate(parts))
        return Fit(bare, beyond)

    def beyond(self, part: trimesh.Trimesh, others: list[trimesh.Trimesh]) -> float:
        """How far the outside of a part among others is from the surface of the mesh [m]."""
        share = max(int(self.samples * min(float(part.area) / self._area, 1.0)), _LEAST)
        apart = np.sqrt(float(part.area) / share)
        points, normals = _with_normals(part.triangles, share)
        points = np.concatenate([points, part.triangles.reshape(-1, 3)])
        normals = np.concatenate([normals, np.repeat(part.face_normals, 3, axis=0)])
        reach = 2.0 * self._radius
        near = [
            other
            for other in others
            if (other.bounds[0] <= part.bounds[1] + reach).all() and (other.bounds[1] >= part.bounds[0] - reach).all()
        ]
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
        """How far points of a part are at most that no other part covers, what the ball touches of them, and which."""
        beside = _BESIDE * self._size
        middles, bare = points + self._radius * normals, np.ones(len(points), bool)
        for other in near:
            bare[bare] = height_over(other, middles[bare]) > -beside
        middles, least = middles[bare], self._radius - beside

        def fits(i: int) -> bool:
            return all(_distance_over(other, middles[i], least) >= least for other in near)

        away, most, _ = self._surface.farthest(points[bare], fits)
        return away, most, np.flatnonzero(bare)


def height_over(part: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """How far points (n, 3) are above the planes of a convex part's faces: negative inside of it."""
    normals = part.face_normals
    return (points @ normals.T - (normals * part.triangles[:, 0]).sum(axis=1)).max(axis=1)


def _distance_over(part: trimesh.Trimesh, point: np.ndarray, enough: float) -> float:
    """How far a point (3,) outside of a convex part is from it [m]; a lower bound where that is enough."""
    import trimesh

    if (height := float(height_over(part, point[None])[0])) >= enough:
        return height
    nearest = trimesh.triangles.closest_point(part.triangles, np.broadcast_to(point, (len(part.faces), 3)))
    return float(np.linalg.norm(nearest - point, axis=1).min())


class Distances:
    """Distances from triangles: by FCL, where those from samples leave a doubt.

    Args:
        vertices: Their corners [m], shape (n, 3).
        faces: Which corners each has, shape (m, 3).
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        import fcl
        from scipy.spatial import KDTree

        # FCL says 0 of faces without area, wherever they are. Their edges are other faces' edges, too.
        a, b = (vertices[faces[:, i]] - vertices[faces[:, 0]] for i in (1, 2))
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        faces = faces[np.linalg.norm(np.cross(a, b), axis=1) > _NEEDLE * lengths]
        model = fcl.BVHModel()
        model.beginModel(len(faces), len(vertices))
        model.addSubModel(np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int64))
        model.endModel()
        self._object = fcl.CollisionObject(model)
        # Lengths within FCL are compared with absolute tolerances: a point is a ball too small to matter.
        self._radius = 1e-6 * float(np.ptp(vertices, axis=0).max())

        self._samples = KDTree(np.concatenate([vertices, points_on(vertices[faces], _NEAR)]))

    def farthest(
        self, points: np.ndarray, counts: Callable[[int], bool] = lambda i: True
    ) -> tuple[np.ndarray, float, int]:
        """What distances of points (n, 3) are at most, the largest of those that count, 0 without any, and whose."""
        at_most, most, which = self._samples.query(points)[0], 0.0, 0
        for i in np.argsort(-at_most):
            if at_most[i] <= most:
                break
            if (away := self._distance(points[i])) > most and counts(int(i)):
                most, which = away, int(i)
        return at_most, most, which

    def _distance(self, point: np.ndarray) -> float:
        import fcl

        ball = fcl.CollisionObject(fcl.Sphere(self._radius), fcl.Transform(point))
        return float(fcl.distance(self._object, ball, fcl.DistanceRequest(), fcl.DistanceResult()))


def points_on(triangles: np.ndarray, count: int) -> np.ndarray:
    """Points on triangles (n, 3, 3), uniform by area, shape (count, 3)."""
    return _with_normals(triangles, count)[0]


def _with_normals(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on triangles (n, 3, 3), uniform by area, with normals, shapes (count, 3)."""
    rng = np.random.default_rng(0)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normals, axis=1)
    which = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1)
    return (triangles[which] * weights[:, :, None]).sum(axis=1), normals[which] / area[which, None]
