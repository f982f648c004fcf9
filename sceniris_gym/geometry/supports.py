"""Support surfaces: level faces of a body as polygons, and the regions on them for the pivot of an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry import MultiPoint, MultiPolygon, Point, Polygon, box

from sceniris_gym.config.bounds import MOST_FAR
from sceniris_gym.config.fields import Points
from sceniris_gym.config.objects import RegionConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import Piece, PieceType
from sceniris_gym.geometry.rotations import matrix

if TYPE_CHECKING:
    import trimesh

COS_MAX_TILT = float(np.cos(np.radians(0.1)))
"""Cosine of the greatest tilt of a support, 0.1 degrees. Under an object of 8 cm, one side is then 0.1 mm higher than
the other, a fifth of the default gap."""
# Cosine of the greatest slope of a supporting face, 1 degree.
_COS_MAX_SLOPE = np.cos(np.radians(1.0))
# If level faces are sorted by height, neighbours with at most this difference [m] belong to one surface.
_STEP = 2.0e-4
# A section at this height [m] above a surface finds the pieces that stand on it.
_ABOVE = 5.0e-4
# A strip narrower than 2 cm (a rim, the edge of a wall, a handle) is not a support.
_HALF_WIDTH = 0.01
# Half the edge [m] of the square that represents an endless plane. All placed objects are inside this square.
_ENDLESS = 4.0 * MOST_FAR
# A point up to this distance [m] beyond the edge of a surface is still on it, because meshes have single precision.
_ON_EDGE = 1.0e-6
# An erosion rounds corners by this number of segments per quarter circle. An erosion by 4 cm is then accurate to 3 um.
_ARC = 64


@dataclass(frozen=True)
class SupportSurface:
    """A level part of a body's surface. Objects can stand on it.

    Attributes:
        body: Id of the body (0: the world, for the floor).
        height: Height z of the surface [m] in the body's frame.
        outline: The whole surface as polygons [m], in x and y of the body's frame.
        region: The part of the surface where an object's pivot may be: polygons or points [m].
        is_endless: Whether the surface is an infinite plane. The outline is then a large square of this plane.
    """

    body: int
    height: float
    outline: MultiPolygon
    region: MultiPolygon | MultiPoint
    is_endless: bool = False

    @cached_property
    def triangles(self) -> np.ndarray:
        """The region as triangles [m], shape (n, 3, 2), from `triangulate`."""
        return triangulate(self.region)


def level_surfaces(
    body: int, pieces: list[Piece], *, open_above: bool, geom: int | None = None
) -> list[SupportSurface]:
    """Return the level surfaces of a body: planes first, then the others from low to high.

    If `geom` is given, only the surfaces of this geom are returned.

    If a piece of the body stands on a surface, the area below this piece is cut out. With `open_above`, the area below
    any higher piece of the body is cut out, so no part of the body is above the surfaces. Strips narrower than 2 cm
    are left out.
    """
    carrying = [p for p in pieces if geom is None or p.geom == geom]
    planes = [p for p in carrying if p.type == PieceType.PLANE and matrix(p.quat)[2, 2] > _COS_MAX_SLOPE]
    solids = tuple(_Solid(p.mesh, geom in (None, p.geom)) for p in pieces if p.mesh is not None)
    flat = [SupportSurface(body, height, area, area) for height, area in _flat_areas(solids, open_above)]
    return [_plane_surface(body, p) for p in planes] + flat


class _Solid:
    """A mesh that equals all meshes of the same shape, and whether its level faces carry."""

    def __init__(self, mesh: trimesh.Trimesh, carries: bool) -> None:
        self.mesh, self.carries = mesh, carries
        self._key = mesh.vertices.tobytes(), mesh.faces.tobytes(), carries

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Solid) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@lru_cache(maxsize=1024)  # many objects of a scene may have the same asset
def _flat_areas(solids: tuple[_Solid, ...], open_above: bool) -> list[tuple[float, MultiPolygon]]:
    """Return the heights [m] and outlines of `level_surfaces` that are not planes."""
    surfaces, meshes = [], [solid.mesh for solid in solids]
    for height, flat in _levels([solid.mesh for solid in solids if solid.carries]):
        over = [shadow(m, height + _ABOVE) if open_above else section(m, height + _ABOVE) for m in meshes]
        outline = polygons_of(flat.difference(shapely.union_all([o for o in over if o is not None])))
        # shrink until strips are gone, then grow to 10 um beyond the edges
        core = outline.buffer(-_HALF_WIDTH, join_style="mitre")
        wide = polygons_of(outline.intersection(core.buffer(_HALF_WIDTH + 1e-5, join_style="mitre")))
        if not wide.is_empty:
            surfaces.append((height, wide))
    return surfaces


def _plane_surface(body: int, plane: Piece) -> SupportSurface:
    """Return a plane's rectangle as a surface. For an infinite plane, the rectangle is larger than any layout."""
    x, y = (half if half > 0.0 else _ENDLESS for half in plane.size[:2])
    corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]) @ matrix(plane.quat).T + plane.pos
    seen = MultiPolygon([Polygon(corners[:, :2])])
    return SupportSurface(body, float(plane.pos[2]), seen, seen, bool(min(plane.size[:2]) <= 0.0))


def rectangle(low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray) -> SupportSurface:
    """Return a surface of the world body at height 0: a rectangle with edges along x and y.

    `low` and `high` are the x and y [m] of two opposite corners.
    """
    seen = MultiPolygon([box(low[0], low[1], high[0], high[1])])
    return SupportSurface(0, 0.0, seen, seen)


def points_in_space(points: Points) -> list[SupportSurface]:
    """Return surfaces whose regions are the given points, for an object without a support.

    Points of equal height share a surface. Its outline is the rectangle around these points, with a margin of 1 cm.
    """
    found = []
    for z in dict.fromkeys(z for *_, z in points):
        seen = MultiPoint([point[:2] for point in points if point[2] == z])
        found.append(SupportSurface(0, z, MultiPolygon([box(*seen.buffer(_HALF_WIDTH).bounds)]), seen))
    return found


def crop(
    surfaces: list[SupportSurface], region: RegionConfig | None, erosions: Sequence[float], where: str
) -> list[list[SupportSurface]]:
    """Set the region of each surface: its outline, eroded so that an object does not overhang, and cut to `region`.

    Args:
        surfaces: The surfaces of the support.
        region: The object's `region` in the scene file, or None for the whole eroded outline.
        erosions: How far [m] the outlines shrink, for each stable pose of the object.
        where: Prefix of error messages.

    Returns:
        For each erosion, the surfaces whose regions are not empty. Equal erosions share one list.

    Raises:
        SceneKeyError: No surface has an area left, or a point of the region is not on a surface.
    """
    rounded = [round(erosion, 7) for erosion in erosions]  # erosions of poses that differ only by rounding are equal
    erosion, points = min(rounded), None if region is None else region.points
    keep = None if region is None or points is not None else _crop_shape(surfaces, region)
    kept = {e: _kept(surfaces, keep, points, e) for e in set(rounded)}
    x0, y0, x1, y1 = shapely.union_all([s.outline for s in surfaces]).bounds
    spans = f"[{x0:.4g}, {x1:.4g}] x [{y0:.4g}, {y1:.4g}] m"
    if points is not None:  # each point has to be on a surface after the smallest erosion
        used = {tuple(xy) for s in kept[erosion] for xy in shapely.get_coordinates(s.region).tolist()}
        for i, at in ((i, Point(point)) for i, point in enumerate(points) if point not in used):
            beyond = min(s.outline.distance(at) for s in surfaces)
            said = f"off the surface, by {beyond:.4g} m"
            if beyond <= _ON_EDGE:
                said = f"nearer to an edge of the surface than the {erosion:.4g} m that 'ratio_on_support' requires"
            raise SceneKeyError(
                f"{where}: point {i} of the region, [{at.x:.4g}, {at.y:.4g}], is not on the support, but {said}."
                f" The surface spans {spans} in the support's frame. Move or remove the point."
            )
    elif not any(kept.values()):
        cuts = {f"erosion by {erosion:.4g} m": erosion > 0.0, "cropping to the region": region is not None}
        said = " and ".join(cut for cut, is_made in cuts.items() if is_made)
        raise SceneKeyError(
            f"{where}: no area of the support is left after {said}. Its surface spans {spans}. Use a smaller "
            "ratio_on_support, a region that overlaps the surface, or a larger support."
        )
    return [kept[e] for e in rounded]


def _kept(
    surfaces: list[SupportSurface], keep: Polygon | None, points: Points | None, erosion: float
) -> list[SupportSurface]:
    """Set the region of each surface: the outline eroded by `erosion` [m], then cut to `keep`.

    If `points` are given, the region has the points that lie in the eroded outline instead. Surfaces with an empty
    region are left out.
    """
    found = []
    for surface in surfaces:
        area = surface.outline.buffer(-erosion, quad_segs=_ARC) if erosion > 0.0 else surface.outline
        if points is not None:
            region = MultiPoint(np.array(points)[shapely.distance(area, shapely.points(points)) <= _ON_EDGE])
        else:
            region = polygons_of(area if keep is None else area.intersection(keep))
        if not region.is_empty:
            found.append(replace(surface, region=region))
    return found


def triangulate(region: MultiPolygon | MultiPoint) -> np.ndarray:
    """Return the region as triangles [m], shape (n, 3, 2), by constrained Delaunay triangulation.

    A point becomes a triangle with three equal corners. In every other triangle, at least two corners differ, also
    in single precision.
    """
    if isinstance(region, MultiPoint):
        return np.repeat(shapely.get_coordinates(region)[:, None], 3, axis=1)
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(region))
    corners = np.reshape([np.asarray(t.exterior.coords)[:3, :2] for t in triangles], (-1, 3, 2))
    single = corners.astype(np.float32)
    return corners[(areas(corners) > 0.0) & (single != single[:, :1]).any(axis=(1, 2))]


def areas(triangles: np.ndarray) -> np.ndarray:
    """Return the areas [m^2] of plane triangles, shape (n, 3, 2)."""
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def weights(triangles: np.ndarray) -> np.ndarray:
    """Return the weight of each triangle of a region, shape (n,), to draw one at random: its area, or 1 for a point."""
    sizes = areas(triangles)
    return np.where(sizes > 0.0, sizes, 1.0)


def edges(outline: MultiPolygon) -> np.ndarray:
    """Return the edges [m] of an outline and of its holes as pairs of points, shape (n, 2, 2)."""
    rings = [ring for p in outline.geoms for ring in (p.exterior, *p.interiors)]
    sides = [np.stack([c[:-1], c[1:]], axis=1) for c in (np.asarray(r.coords)[:, :2] for r in rings)]
    return np.concatenate(sides)


def _crop_shape(surfaces: list[SupportSurface], region: RegionConfig) -> Polygon:
    if region.polygon is not None:
        return Polygon(region.polygon)
    corners = np.array(region.box)
    if region.box is None:
        low, high = np.reshape(shapely.union_all([s.outline for s in surfaces]).bounds, (2, 2))
        corners = low + np.array(region.fraction) * (high - low)
    return box(*corners.ravel())


def _levels(meshes: list[trimesh.Trimesh]) -> list[tuple[float, MultiPolygon]]:
    """Group the faces of meshes that are level and point up, by height.

    Return each height [m] with the faces as polygons, lowest first.
    """
    flat = [m.triangles[m.face_normals[:, 2] > _COS_MAX_SLOPE] for m in meshes]
    triangles = np.concatenate(flat) if flat else np.zeros((0, 3, 3))
    if not len(triangles):
        return []
    heights = triangles[:, :, 2].max(axis=1)
    order = np.argsort(heights, kind="stable")
    cuts = np.flatnonzero(np.diff(heights[order]) > _STEP) + 1
    levels = []
    for group in np.split(order, cuts):
        faces = np.asarray(shapely.polygons(triangles[group][:, :, :2]))
        merged = shapely.union_all(faces[shapely.area(faces) > 0.0])
        # close gaps of up to 2 um, which rounding leaves between faces of neighbouring geoms
        merged = merged.buffer(1e-6, join_style="mitre").buffer(-1e-6, join_style="mitre")
        levels.append((float(heights[group].max()), polygons_of(merged)))
    return [(z, area) for z, area in levels if not area.is_empty]


def section(mesh: trimesh.Trimesh, z: float) -> shapely.Geometry | None:
    """Return the area of the horizontal cut through a closed mesh at height `z` [m], or None if there is no cut."""
    if not mesh.bounds[0, 2] < z < mesh.bounds[1, 2]:
        return None
    cut = mesh.section([0.0, 0.0, 1.0], [0.0, 0.0, z])
    if cut is None:
        return None
    planar, _ = cut.to_2D(to_2D=np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -z], [0, 0, 0, 1.0]]))
    rings = [p for p in planar.polygons_closed if p is not None]
    return reduce(shapely.symmetric_difference, rings, Polygon())  # rings inside other rings are holes


def shadow(mesh: trimesh.Trimesh, z: float) -> shapely.Geometry | None:
    """Return the outline, seen from above, of the part of a mesh above height `z` [m], or None without such a part."""
    if mesh.bounds[1, 2] <= z:
        return None
    above = mesh.slice_plane([0.0, 0.0, z], [0.0, 0.0, 1.0]) if mesh.bounds[0, 2] < z else mesh
    if mesh.is_convex:
        return MultiPoint(above.vertices[:, :2]).convex_hull
    faces = np.asarray(shapely.polygons(above.triangles[:, :, :2]))
    return shapely.union_all(faces[shapely.area(faces) > 1e-12])


def polygons_of(geometry: shapely.Geometry) -> MultiPolygon:
    """Return the polygons of a geometry. Its lines and points are left out, because they have no area."""
    return MultiPolygon([g for g in shapely.get_parts(geometry) if isinstance(g, Polygon) and g.area > 0.0])
