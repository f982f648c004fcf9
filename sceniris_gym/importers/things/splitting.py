"""Splits convex parts along planes until no part sticks out of a closed solid by more than an allowed distance.

For each split, several planes are tried: planes through the point of the part that sticks out farthest, and planes
along nearby faces, such as the wall of a slot or the floor of a pocket. The best plane gives the two halves whose hulls
have the smallest total volume.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from sceniris_gym.errors import import_extra
from sceniris_gym.geometry.pieces import convex_hull
from sceniris_gym.importers.things.fit import Distances, height_over, points_on
from sceniris_gym.progress import tell

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
        solid: The solid. Only areas of a part outside this solid stick out.
        mesh: The surface from which distances [m] are measured. `solid` is a simplified copy of this surface.
        allowed: How far parts may stick out [m].
    """

    def __init__(self, solid: manifold3d.Manifold, mesh: trimesh.Trimesh, allowed: float) -> None:
        self.solid, self.allowed = solid, allowed
        self._distances = Distances(mesh.vertices, mesh.faces)
        self._size = float(mesh.extents.max())

    def of(self, part: trimesh.Trimesh) -> tuple[float, np.ndarray]:
        """Return how far a part sticks out of the solid [m], and the point that sticks out farthest, shape (3,)."""
        out = mesh_of(hull_of(part.vertices) - self.solid)
        skin = out.triangles[height_over(part, out.triangles_center) > -_BESIDE * self._size]
        area = float(np.linalg.norm(np.cross(skin[:, 1] - skin[:, 0], skin[:, 2] - skin[:, 0]), axis=1).sum())
        if not area > 0.0:
            return 0.0, part.vertices[0]
        count = int(np.clip(area / (_APART * self.allowed) ** 2, _FEWEST, _MOST))
        points = np.concatenate([points_on(skin, count)[0], skin.mean(axis=1)])
        _, most, which = self._distances.farthest(points)
        return most, points[which]

    def beyond(self, part: trimesh.Trimesh, others: Sequence[trimesh.Trimesh]) -> float:
        """Return how far a part sticks out of the solid [m], for `merge`. `others` has no effect."""
        return self.of(part)[0]


def split(parts: Sequence[trimesh.Trimesh], excess: Excess, most: int) -> list[trimesh.Trimesh]:
    """Split parts that stick out of a solid too far, until all parts fit or there are more than `most` parts.

    Args:
        parts: Convex parts that cover the solid.
        excess: Has the solid and the allowed distance, and measures how far a part sticks out.
        most: If there are more parts than this number, no part is split further.
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
        tell("parts split", len(found), len(found) + len(pieces))
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
    """Cut a piece of the solid at a plane near a point, so that the hulls of both halves have the least total volume.

    Args:
        piece: The piece.
        where: The point that sticks out farthest [m], shape (3,).
        away: How far this point sticks out [m]. Vertices within 1.5 times this distance give further planes.

    Returns:
        The two halves, or an empty tuple if no plane near the point cuts the piece.
    """
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
    """Yield normals of planes to try: the three axes, then the mean normals of the largest groups of parallel faces."""
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

    The smaller hull keeps the vertex that is farthest in each of many evenly spread directions. In regions that are
    nearly flat, this may drop vertices that matter. Vertices are therefore added until no vertex of the full hull is
    farther than `allowed` [m] outside the smaller hull.
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
    """Return `small_hull` of points (n, 3), or None if the points are nearly in one plane."""
    flat = hull_of(points).volume() <= 1e-9 * float(np.ptp(points, axis=0).max()) ** 3
    return None if flat else small_hull(points, allowed)


def manifold_of(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """Convert a closed mesh to a solid. If an edge of the mesh does not have exactly two faces, the solid is empty.

    Raises:
        MissingExtraError: manifold3d is not installed.
    """
    library = import_extra("manifold3d", "import")
    return library.Manifold(library.Mesh64(np.array(mesh.vertices, float), np.array(mesh.faces, np.uint64)))


def hull_of(points: np.ndarray) -> manifold3d.Manifold:
    """Return the convex hull of points (n, 3) as a solid. If the points are in one plane, the solid is empty.

    Convex parts are converted to solids by this function and not by `manifold_of`, because the faces of a nearly flat
    part may not form a manifold.

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


def union_of_parts(parts: Iterable[trimesh.Trimesh]) -> manifold3d.Manifold:
    """Return the union of convex parts as a solid. Raises as `union_of`."""
    return union_of([hull_of(part.vertices) for part in parts])


def mesh_of(solid: manifold3d.Manifold) -> trimesh.Trimesh:
    """Return the surface of a solid."""
    found = solid.to_mesh64()
    return trimesh.Trimesh(found.vert_properties[:, :3], found.tri_verts.astype(int), process=False)
