"""How far convex parts are from the surface that they stand for, both ways."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import trimesh

LEAST_TOLERANCE, SHARE = 0.002, 0.02
"""Parts are to stay within 2 mm of the mesh, or 2% of its longest edge if that is more."""
_SAMPLES = 6000  # points on either side; with 2,000 the error of a mug came out up to a fifth smaller
_LEAST = 60  # of them on each part
_BESIDE = 1e-5  # of the size: parts that touch within this leave no gap
# Of the size: nothing gets into a gap of this width between parts, such as small hulls leave along a cut.
_SLIVER = 1e-3


@dataclass(frozen=True)
class Fit:
    """How parts fit a mesh [m].

    Attributes:
        bare: How far the mesh reaches out of the parts.
        beyond: How far the parts' own surface is from that of the mesh: what they fill, or stick out by.
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
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._size, self._area = float(mesh.extents.max()), float(mesh.area)
        self._surface = _Distance(mesh.vertices, mesh.faces)
        self._points = np.concatenate(
            [_with_normals(mesh, _SAMPLES)[0], mesh.vertices[:: max(len(mesh.vertices) // _SAMPLES, 1)]]
        )

    def fit(self, parts: list[trimesh.Trimesh]) -> Fit:
        """Return how parts, closed and convex, fit the mesh."""
        beside = _BESIDE * self._size
        out = np.min([height_over(part, self._points) for part in parts], axis=0)
        bare = 0.0
        if len(far := self._points[out > beside]):
            starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
            faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
            bare = _Distance(np.concatenate([part.vertices for part in parts]), faces).farthest(far)
        beyond = max(self.beyond(part, [*parts[:i], *parts[i + 1 :]]) for i, part in enumerate(parts))
        return Fit(bare, beyond)

    def beyond(self, part: trimesh.Trimesh, others: list[trimesh.Trimesh]) -> float:
        """How far the surface of a part is from that of the mesh [m], where no other part covers it."""
        share = max(int(_SAMPLES * min(float(part.area) / self._area, 1.0)), _LEAST)
        points, normals = _with_normals(part, share)
        corners = part.vertices - part.vertices.mean(axis=0)
        points = np.concatenate([points, part.vertices])
        normals = np.concatenate([normals, corners / np.linalg.norm(corners, axis=1, keepdims=True)])
        just_out = points + _SLIVER * self._size * normals  # what faces a sliver is no surface of theirs
        for other in others:
            if (
                len(points)
                and (other.bounds[0] <= just_out.max(axis=0)).all()
                and (other.bounds[1] >= just_out.min(axis=0)).all()
            ):
                bare = height_over(other, just_out) > _BESIDE * self._size
                points, just_out = points[bare], just_out[bare]
        return self._surface.farthest(points)


def height_over(part: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """How far points (n, 3) are above the planes of a convex part's faces: negative inside of it."""
    normals = part.face_normals
    return (points @ normals.T - (normals * part.triangles[:, 0]).sum(axis=1)).max(axis=1)


class _Distance:
    """Distances of points from triangles, by FCL."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        import fcl

        model = fcl.BVHModel()
        model.beginModel(len(faces), len(vertices))
        model.addSubModel(np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int64))
        model.endModel()
        self._object = fcl.CollisionObject(model)
        # Lengths within FCL are compared with absolute tolerances: a point is a ball too small to matter.
        self._radius = 1e-6 * float(np.ptp(vertices, axis=0).max())

    def farthest(self, points: np.ndarray) -> float:
        """The largest distance of points (n, 3); 0 without points."""
        import fcl

        most, ball = 0.0, fcl.Sphere(self._radius)
        request = fcl.DistanceRequest()
        for point in points:
            found = fcl.distance(
                self._object, fcl.CollisionObject(ball, fcl.Transform(point)), request, fcl.DistanceResult()
            )
            most = max(most, found)
        return most


def _with_normals(mesh: trimesh.Trimesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on a surface, uniform by area, and its vertices if it is small; with normals, shapes (n, 3)."""
    rng = np.random.default_rng(0)
    area = mesh.area_faces
    which = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1)
    return (mesh.triangles[which] * weights[:, :, None]).sum(axis=1), mesh.face_normals[which]
