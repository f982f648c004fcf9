"""Splits convex parts along planes until all parts stay close to a closed solid.

The plane goes through the point that sticks out farthest, or along a nearby face, such as the wall of a slot or the
floor of a pocket. The best plane minimises the hull volume of both halves.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from sceniris_gym.errors import import_extra
from sceniris_gym.geometry.pieces import convex_hull
from sceniris_gym.importers.things.fit import Distances, height_over, points_with_normals

if TYPE_CHECKING:
    import manifold3d

_APART = 0.25  # spacing of sample points, as a fraction of the tolerance
_FEWEST, _MOST = 100, 20_000  # limits of the sample points on a part
_BESIDE = 1e-5  # fraction of the size: a part that sticks out less is ignored
_SLIVER = 1e-7  # fraction of the solid's bounding box volume: smaller pieces are dropped
_NEAR = 1.5  # multiple of the distance to the surface: vertices in this radius are candidates for planes
# Candidate planes: normals with the largest face area, in addition to the axes, and levels along each normal.
_DIRECTIONS, _LEVELS = 6, 6
_ALIKE = 20  # steps per unit, to group similar normals
_MOST_VERTICES = 96  # of a part: more vertices slow down MuJoCo-Warp's collisions
_EVEN = 192  # number of evenly spread directions
_LOST = 0.9  # fraction of the allowed distance for removing vertices: later steps need the rest


class Excess:
    """Measures how far convex parts stick out of a solid.

    Args:
        solid: The closed solid, close to `mesh`.
        mesh: Reference surface for distances [m].
        allowed: How far parts may stick out [m].
    """

    def __init__(self, solid: manifold3d.Manifold, mesh: trimesh.Trimesh, allowed: float) -> None:
        self.solid, self.allowed = solid, allowed
        self._distances = Distances(mesh.vertices, mesh.faces)
        self._size = float(mesh.extents.max())

    def of(self, part: trimesh.Trimesh) -> tuple[float, np.ndarray]:
        """Return how far a part sticks out [m], and its farthest point, shape (3,)."""
        out = mesh_of(hull_of(part.vertices) - self.solid)
        if not len(out.faces):
            return 0.0, part.vertices[0]
        skin = out.triangles[height_over(part, out.triangles_center) > -_BESIDE * self._size]
        area = float(np.linalg.norm(np.cross(skin[:, 1] - skin[:, 0], skin[:, 2] - skin[:, 0]), axis=1).sum())
        if not area > 0.0:
            return 0.0, part.vertices[0]
        count = int(np.clip(area / (_APART * self.allowed) ** 2, _FEWEST, _MOST))
        points = np.concatenate([points_with_normals(skin, count)[0], skin.mean(axis=1)])
        _, most, which = self._distances.farthest(points)
        return most, points[which]

    def beyond(self, part: trimesh.Trimesh, others: Sequence[trimesh.Trimesh]) -> float:
        """Return how far a part sticks out [m], including areas that other parts cover."""
        return self.of(part)[0]


def split(parts: Sequence[trimesh.Trimesh], excess: Excess, most: int) -> list[trimesh.Trimesh]:
    """Split parts that stick out of the solid, again and again, until all parts fit or there are `most` parts.

    Args:
        parts: Convex parts that cover the solid.
        excess: Measures how far parts stick out of the solid.
        most: Largest number of parts.
    """
    found, pieces = [], []
    for part in parts:
        if excess.of(part)[0] <= excess.allowed:
            found.append(part)
        else:
            pieces += (excess.solid ^ hull_of(part.vertices)).decompose()
    low, high = np.split(np.array(excess.solid.bounding_box()), 2)
    least = _SLIVER * float(np.prod(high - low))
    while pieces:
        piece = pieces.pop()
        if piece.volume() < least or (part := hull_or_none(mesh_of(piece).vertices, excess.allowed)) is None:
            continue
        away, where = excess.of(part)
        halves = () if away <= excess.allowed or len(found) + len(pieces) > most else _halves(piece, where, away)
        if halves:
            pieces += [each for half in halves for each in half.decompose()]
        else:
            found.append(part)
    return found


def _halves(piece: manifold3d.Manifold, where: np.ndarray, away: float) -> tuple[manifold3d.Manifold, ...]:
    """Return both sides of the best plane near a point, or an empty tuple if no plane cuts the piece there."""
    mesh, best, least = mesh_of(piece), (), np.inf
    near = mesh.vertices[np.linalg.norm(mesh.vertices - where, axis=1) <= _NEAR * away]
    for normal in _normals(mesh):
        heights = mesh.vertices @ normal
        low, width = heights.min(), np.ptp(heights)
        levels = np.unique(np.round((near @ normal - low) / width, 3))
        some = np.linspace(0, len(levels) - 1, min(len(levels), _LEVELS)).astype(int)
        for level in (*levels[some], (where @ normal - low) / width):
            if not 0.01 < level < 0.99:
                continue
            sides = piece.split_by_plane(normal.tolist(), float(low + level * width))
            volume = sum(side.hull().volume() for side in sides)
            if volume < least and not any(side.is_empty() for side in sides):
                best, least = sides, volume
    return best


def _normals(mesh: trimesh.Trimesh) -> Iterable[np.ndarray]:
    """Yield the axes, and the face normals with the largest total area. Opposite normals count as equal."""
    normals = mesh.face_normals * np.where(mesh.face_normals @ [1.0, 1e-2, 1e-4] < 0.0, -1.0, 1.0)[:, None]
    _, alike = np.unique(np.round(_ALIKE * normals), axis=0, return_inverse=True)
    areas = np.bincount(alike.ravel(), mesh.area_faces)
    yield from np.eye(3)
    for i in np.argsort(-areas)[:_DIRECTIONS]:
        mean = (normals * mesh.area_faces[:, None])[alike.ravel() == i].sum(axis=0)
        if (length := np.linalg.norm(mean)) > 0.0:
            yield mean / length


def small_hull(points: np.ndarray, allowed: float = np.inf) -> trimesh.Trimesh:
    """Return the convex hull of points (n, 3), with fewer vertices if it has more than `_MOST_VERTICES`.

    The reduced hull has the farthest vertices in evenly spread directions. These miss regions that are nearly flat, so
    more vertices are added until all vertices of the hull are within `allowed` [m].
    """
    hull = convex_hull(points)
    if len(hull.vertices) <= _MOST_VERTICES:
        return hull
    angles = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_EVEN)
    height = 1.0 - 2.0 * (np.arange(_EVEN) + 0.5) / _EVEN
    level = np.sqrt(1.0 - height**2)
    directions = np.stack([level * np.cos(angles), level * np.sin(angles), height], axis=1)
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    farthest = np.unique(np.argmax(hull.vertices @ directions.T, axis=0))
    heights = (hull.vertices * hull.vertex_normals).sum(axis=1)
    lost = heights - (hull.vertices[farthest] @ hull.vertex_normals.T).max(axis=0)
    while lost.max() > _LOST * allowed:
        farthest = np.append(farthest, lost.argmax())
        lost = np.minimum(lost, heights - hull.vertex_normals @ hull.vertices[farthest[-1]])
    return convex_hull(hull.vertices[farthest])


def hull_or_none(points: np.ndarray, allowed: float = np.inf) -> trimesh.Trimesh | None:
    """Return `small_hull` of points (n, 3), or None if they are coplanar."""
    flat = hull_of(points).volume() <= 1e-9 * float(np.ptp(points, axis=0).max()) ** 3
    return None if flat else small_hull(points, allowed)


def manifold_of(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """Convert a closed mesh to a solid. The solid is empty unless each edge has two faces.

    Raises:
        MissingExtraError: manifold3d is not installed.
    """
    library = import_extra("manifold3d", "import")
    return library.Manifold(library.Mesh64(np.array(mesh.vertices, float), np.array(mesh.faces, np.uint64)))


def hull_of(points: np.ndarray) -> manifold3d.Manifold:
    """Return the convex hull of points (n, 3) as a solid. It is empty if the points are coplanar.

    Convex parts are converted to solids this way, because the faces of nearly flat parts may not form a manifold.

    Raises:
        MissingExtraError: manifold3d is not installed.
    """
    return import_extra("manifold3d", "import").Manifold.hull_points(np.array(points, float))


def union_of(solids: Sequence[manifold3d.Manifold]) -> manifold3d.Manifold:
    """Return the union of solids.

    Raises:
        MissingExtraError: manifold3d is not installed.
    """
    library = import_extra("manifold3d", "import")
    return library.Manifold.batch_boolean(list(solids), library.OpType.Add)


def mesh_of(solid: manifold3d.Manifold) -> trimesh.Trimesh:
    """Return the surface of a solid."""
    found = solid.to_mesh64()
    return trimesh.Trimesh(found.vert_properties[:, :3], found.tri_verts.astype(int), process=False)
