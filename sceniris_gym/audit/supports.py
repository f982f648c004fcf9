"""Finds the level surfaces of bodies, and tests whether points are inside them, with shapely."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from sceniris_gym.audit.geometry import Form, Solid, convex_hull

COS_MAX_SLOPE = np.cos(np.radians(1.0))  # greatest slope of a carrying face, 1 degree
UPRIGHT = np.cos(np.radians(0.101))  # greatest tilt of a body's z axis in the world, 0.1 degree and rounding
NARROW = 0.02  # m, narrower strips carry no objects
HEIGHT_TOLERANCE = 1e-4  # m
EDGE_TOLERANCE = 1e-5  # m
_SEGMENTS = 128
_ABOVE = 5e-4  # m, parts that stand on a surface are cut at this height above it


@dataclass(frozen=True)
class LevelSurface:
    """A level surface of a body.

    Attributes:
        height: Height z of the surface [m] in the body's frame.
        area: The area in the coordinates x and y [m] of the body's frame.
    """

    height: float
    area: shapely.Geometry


def surface_of(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and outward triangles of a solid. The hull of surface points approximates a curved solid."""
    if solid.form is Form.POLYHEDRON:
        return solid.vertices, solid.faces
    angles = np.linspace(0, 2 * np.pi, _SEGMENTS, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], 1)
    if solid.form is Form.CYLINDER:
        rim = ring * solid.size[0]
        return convex_hull(np.concatenate([rim + [0, 0, z] for z in (-solid.size[1], solid.size[1])]))
    tilt = np.linspace(-np.pi / 2, np.pi / 2, _SEGMENTS // 2 + 1)
    ball = (ring[None] * np.cos(tilt)[:, None, None] + [0, 0, 1] * np.sin(tilt)[:, None, None]).reshape(-1, 3)
    if solid.form is Form.ELLIPSOID:
        return convex_hull(ball * solid.size)
    return convex_hull(np.concatenate([ball * solid.radius + end for end in solid.vertices]))


def plane_surface(size: np.ndarray, pos: np.ndarray, mat: np.ndarray) -> LevelSurface | None:
    """Return the rectangle of a plane geom, None if the plane is not level.

    Args:
        size: MuJoCo's sizes of the plane [m]. A size of 0 means an infinite plane, which becomes 10 km to each side.
        pos: Position [m] in the body's frame.
        mat: Orientation in the body's frame, shape (3, 3).
    """
    if mat[2, 2] <= COS_MAX_SLOPE:
        return None
    half = np.where(size[:2] > 0.0, size[:2], 1e4)
    corners = (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half) @ mat[:, :2].T + pos
    return LevelSurface(float(pos[2]), shapely.Polygon(corners[:, :2]))


def level_surfaces(parts: Mapping[int, np.ndarray], *, open_above: bool, only: int | None = None) -> list[LevelSurface]:
    """Return the level surfaces of a body. Surfaces at the same height are joined.

    If another part of the body stands on a surface, the area under this part is excluded.

    Args:
        parts: Geom of the body -> outward triangles of its solid [m], shape (n, 3, 3), in the body's frame.
        open_above: Whether to exclude all areas below another part of the body.
        only: The geom whose surfaces are returned. None for all.
    """
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(t for geom, t in parts.items() if only in (None, geom))])
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    level = triangles[normal[:, 2] > COS_MAX_SLOPE * np.maximum(np.linalg.norm(normal, axis=1), 1e-16)]
    level = level[np.argsort(level[:, :, 2].mean(1))]
    if not len(level):
        return []
    heights = level[:, :, 2].mean(1)
    surfaces = []
    for group in np.split(np.arange(len(level)), np.flatnonzero(np.diff(heights) > EDGE_TOLERANCE) + 1):
        height = float(heights[group].mean())
        above = height + _ABOVE
        taken = [_shadow(t, above) if open_above else _section(t, above) for t in parts.values()]
        area = shapely.union_all(shapely.polygons(level[group][:, :, :2])).difference(shapely.union_all(taken))
        wide = [part for part in shapely.get_parts(area) if not part.buffer(-NARROW / 2).is_empty]
        if wide:
            surfaces.append(LevelSurface(height, shapely.union_all(wide)))
    return surfaces


def _crossings(triangles: np.ndarray, z: float) -> np.ndarray:
    """Return the points where the edges of triangles cross the plane at `z`, (n, 3, 2), NaN where they do not."""
    a, b = triangles, np.roll(triangles, -1, axis=1)
    rises = a[:, :, 2:] < b[:, :, 2:]
    low, high = np.where(rises, a, b), np.where(rises, b, a)  # both triangles of an edge must find the same point
    crosses = (low[:, :, 2:] <= z) & (high[:, :, 2:] > z)
    t = (z - low[:, :, 2:]) / np.where(crosses, high[:, :, 2:] - low[:, :, 2:], 1.0)
    return np.where(crosses, low[:, :, :2] + t * (high[:, :, :2] - low[:, :, :2]), np.nan)


def _section(triangles: np.ndarray, z: float) -> shapely.Geometry:
    """Return the section of a closed surface with the horizontal plane at `z`."""
    points = _crossings(triangles, z)
    pairs = points[~np.isnan(points[:, :, 0])].reshape(-1, 2, 2)
    segments = [shapely.LineString(pair) for pair in np.round(pairs, 9) if np.any(pair[0] != pair[1])]
    return shapely.build_area(shapely.GeometryCollection(segments))


def _shadow(triangles: np.ndarray, z: float) -> shapely.Geometry:
    """Return the vertical projection of a closed surface's part above `z`, together with the section at `z`."""
    seen = triangles[(triangles[:, :, 2] > z).any(1)]
    above = np.where(seen[:, :, 2:] > z, seen[:, :, :2], np.nan)
    points = np.concatenate([above, _crossings(seen, z)], axis=1)  # the corners of each triangle's part above `z`
    row, corner = np.nonzero(~np.isnan(points[:, :, 0]))
    clipped = shapely.convex_hull(shapely.multipoints(points[row, corner], indices=row))
    return shapely.union_all([*clipped, _section(triangles, z)])


def inside(area: shapely.Geometry, points: np.ndarray, erosion: np.ndarray | None = None) -> np.ndarray:
    """Return a mask of the points (n, 2) in an area, shape (n,).

    If `erosion` [m] (n,) is given, a point must also be at least this far from the boundary. Both tests allow the edge
    tolerance.
    """
    grown = shapely.buffer(area, EDGE_TOLERANCE, join_style="mitre")
    shapely.prepare(grown)
    found = shapely.intersects_xy(grown, points[:, 0], points[:, 1])
    if erosion is not None and erosion.any():
        edge = shapely.boundary(area)
        shapely.prepare(edge)
        found &= shapely.distance(edge, shapely.points(points)) >= erosion - EDGE_TOLERANCE
    return found
