"""Measures the distance between convex parts and the surface that they replace, in both directions.

The error is the larger of two distances: from the surface to the parts, and from the outside of the parts to the
surface. The outside consists of the points that a ball can touch when it rolls over the parts. The ball's diameter is a
little less than the tolerance. A gap between parts is therefore no error if the ball cannot enter it, because the parts
would close such a gap by growing by half the tolerance. For the first distance, all surface points count, also points
inside such a gap.
"""

from collections.abc import Callable

import fcl
import numpy as np
import trimesh
from scipy.spatial import KDTree
from trimesh.collision import mesh_to_BVH

LEAST_TOLERANCE, SHARE = 0.002, 0.02
"""The default tolerance: 2 mm, or 2% of the mesh's longest edge if that is larger [m, fraction]."""
_SAMPLES = 10_000  # points on the mesh, and on parts with the same area
_LEAST = 200  # smallest number of points on a part
# Refinement: number of rounds, new points around each candidate, and candidates per round. Candidates are the points
# that may be farthest away, and each round halves the spacing. Without refinement, the errors of a kettle and an arm's
# link were a seventh smaller.
_FINER, _AROUND, _DOUBTFUL = 3, 4, 100
_BALL = 0.8  # diameter as a fraction of the tolerance: also finds small places that the full ball barely enters
_NEAR = 10_000  # points on the surface for upper bounds of distances
_BESIDE = 1e-5  # fraction of the size: parts closer than this leave no gap
_Counts = Callable[[int], bool]
_NEEDLE = 1e-6  # sine of the smallest angle in a face: FCL's distances from sharper faces are wrong


def tolerance_of(mesh: trimesh.Trimesh) -> float:
    """Return the default tolerance of convex parts of a mesh [m]."""
    return max(LEAST_TOLERANCE, SHARE * float(mesh.extents.max()))


class Measure:
    """Measures the distances between convex parts and one mesh, at sample points drawn with a fixed seed.

    Args:
        mesh: The mesh, which may be open.
        tolerance: Largest allowed distance between parts and mesh [m]. A ball whose diameter is 0.8 times
            the tolerance rolls over the parts, and the points that it touches are their outside.
        samples: Number of sample points on the mesh.
    """

    def __init__(self, mesh: trimesh.Trimesh, tolerance: float, samples: int = _SAMPLES) -> None:
        self._area, self._radius, self._beside = mesh.area, 0.5 * _BALL * tolerance, _BESIDE * mesh.extents.max()
        self.samples, self._surface = samples, Distances(mesh.vertices, mesh.faces)
        some = mesh.vertices[:: max(len(mesh.vertices) // samples, 1)]
        self._points = np.concatenate([points_on(mesh.triangles, samples)[0], some])

    def error(self, parts: list[trimesh.Trimesh]) -> float:
        """Return the larger of `bare` and of `beyond` for each part [m], for convex parts of the mesh.

        The parts are closed meshes.
        """
        return max(self.bare(parts), *(self.beyond(part, parts) for part in parts))

    def bare(self, parts: list[trimesh.Trimesh]) -> float:
        """Return the largest distance [m] from a point of the mesh to the parts. It is 0 if the parts contain it."""
        out = np.min([height_over(part, self._points) for part in parts], axis=0)
        far = self._points[out > self._beside]
        union = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
        return Distances(*union).farthest(far)[1] if len(far) else 0.0

    def beyond(self, part: trimesh.Trimesh, parts: list[trimesh.Trimesh]) -> float:
        """Return the largest distance [m] from the outside of a part to the mesh, without areas inside other `parts`.

        It is large if the part fills a hollow of the mesh or sticks out of it.
        """
        share = max(int(self.samples * min(float(part.area) / self._area, 1.0)), _LEAST)
        apart = np.sqrt(float(part.area) / share)
        points, which = points_on(part.triangles, share)
        points = np.concatenate([points, part.triangles.reshape(-1, 3)])
        normals = np.concatenate([part.face_normals[which], np.repeat(part.face_normals, 3, axis=0)])
        near = [other for other in parts if other is not part and are_near(part, other, 2.0 * self._radius)]
        most, rng = 0.0, np.random.default_rng(1)
        for finer in range(_FINER + 1):
            away, found, kept = self._touched(points, normals, near)
            most = max(most, found)
            if finer == _FINER or most < apart:
                break
            first = np.argsort(-away)[:_DOUBTFUL]
            doubtful = np.repeat(kept[first[away[first] > most - apart]], _AROUND)  # a neighbour may be farther away
            shift = apart * rng.uniform(-1.0, 1.0, (len(doubtful), 3))
            shift -= (shift * normals[doubtful]).sum(axis=1, keepdims=True) * normals[doubtful]
            points, normals = points[doubtful] + shift, normals[doubtful]
            on = height_over(part, points) <= self._beside
            points, normals, apart = points[on], normals[on], 0.5 * apart
        return most

    def _touched(
        self, points: np.ndarray, normals: np.ndarray, near: list[trimesh.Trimesh]
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Find points of a part that lie outside all other parts, and the largest distance of such points to the mesh.

        A point only counts for this distance if a ball that touches the part at the point misses all other parts.

        Args:
            points: Points on the surface of the part [m], shape (n, 3).
            normals: Outward normals at these points, shape (n, 3).
            near: Other parts near the part.

        Returns:
            For each of the m points outside all other parts, an upper bound of its distance to the mesh [m], shape
            (m,). The largest distance of a point that counts [m]. The indices of the m points in `points`, shape (m,).
        """
        middles, bare = points + self._radius * normals, np.ones(len(points), bool)
        for other in near:
            bare[bare] = height_over(other, middles[bare]) > -self._beside
        middles, least = middles[bare], self._radius - self._beside

        def fits(i: int) -> bool:
            return all(_distance_over(other, middles[i], least) >= least for other in near)

        away, most, _ = self._surface.farthest(points[bare], fits)
        return away, most, np.flatnonzero(bare)


def are_near(one: trimesh.Trimesh, other: trimesh.Trimesh, distance: float) -> bool:
    """Return whether the bounding boxes of two parts are at most `distance` [m] apart along each axis."""
    low, high = one.bounds
    return bool((low <= other.bounds[1] + distance).all() and (other.bounds[0] <= high + distance).all())


def height_over(part: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Return each point's greatest height [m] above any face plane of the part, shape (n,).

    The height is negative inside the convex part. `points` has shape (n, 3) [m].
    """
    normals = part.face_normals
    return (normals @ points.T - (normals * part.triangles[:, 0]).sum(axis=1)[:, None]).max(axis=0)


def _distance_over(part: trimesh.Trimesh, point: np.ndarray, enough: float) -> float:
    """Return the distance [m] from a convex part to a point (3,) outside the part.

    If a quick lower bound already is `enough` [m] or more, return this bound instead.
    """
    if (height := float(height_over(part, point[None])[0])) >= enough:
        return height
    nearest = trimesh.triangles.closest_point(part.triangles, np.broadcast_to(point, (len(part.faces), 3)))
    return float(np.linalg.norm(nearest - point, axis=1).min())


class Distances:
    """Finds the largest distance from points to a set of triangles.

    Samples on the triangles give an upper bound for each point. The collision library FCL computes the exact
    distance only for the points with the largest bounds.

    Args:
        vertices: Corners of the triangles [m], shape (n, 3).
        faces: Corner indices of each triangle, shape (m, 3).
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        # FCL returns distance 0 for degenerate faces at any position. Dropping them is safe, because their edges belong
        # to other faces too.
        a, b = (vertices[faces[:, i]] - vertices[faces[:, 0]] for i in (1, 2))
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        faces = faces[np.linalg.norm(np.cross(a, b), axis=1) > _NEEDLE * lengths]
        self._object = fcl.CollisionObject(mesh_to_BVH(trimesh.Trimesh(vertices, faces, process=False)))
        # A ball of negligible size, relative to the mesh, stands for a point.
        self._ball = fcl.Sphere(1e-6 * float(np.ptp(vertices, axis=0).max()))
        triangles = vertices[faces]
        points, which = points_on(triangles, _NEAR)
        self._samples = KDTree(np.concatenate([triangles.mean(axis=1), points]))
        self._near = np.concatenate([triangles, triangles[which]])  # the triangle of each sample

    def farthest(self, points: np.ndarray, counts: _Counts = lambda i: True) -> tuple[np.ndarray, float, int]:
        """Find the point that is farthest from the triangles.

        Args:
            points: The points [m], shape (n, 3).
            counts: Takes the index of a point. Returns False if the point should be ignored.

        Returns:
            An upper bound of each point's distance [m], shape (n,). The largest distance of a point that counts [m], 0
            if no point counts. The index of that point.
        """
        most, which = 0.0, 0
        near = self._near[self._samples.query(points)[1]]
        at_most = np.linalg.norm(trimesh.triangles.closest_point(near, points) - points, axis=1)
        for i in np.argsort(-at_most):
            if at_most[i] <= most:
                break
            ball = fcl.CollisionObject(self._ball, fcl.Transform(points[i]))
            away = float(fcl.distance(self._object, ball, fcl.DistanceRequest(), fcl.DistanceResult()))
            if away > most and counts(int(i)):
                most, which = away, int(i)
        return at_most, most, which


def points_on(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw points on triangles (n, 3, 3), uniformly by area.

    Returns:
        The points, shape (count, 3), and the number of the triangle of each point, shape (count,).
    """
    rng = np.random.default_rng(0)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    which = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1)
    return (triangles[which] * weights[:, :, None]).sum(axis=1), which
