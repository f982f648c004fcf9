"""The layer "regions" of the viewer: where on its support the pivot of each object may be, in one world's state."""

import math
from collections.abc import Container, Sequence
from functools import singledispatch

import numpy as np
import shapely
from shapely.affinity import affine_transform
from shapely.geometry import LineString, MultiPoint, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from sceniris_gym.config.relations import Beside, Between, Joined, Relation, Sector
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.geometry.rotations import pose_matrix
from sceniris_gym.geometry.supports import polygons_of, shadow
from sceniris_gym.program.device import Cover
from sceniris_gym.program.plan import PlacedObject
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import GREY, PALETTE, Sketch

Standing = tuple[np.ndarray, np.ndarray]
"""An object's pivot [m] with its heading [rad], shape (4,), and its bounds [m] from the pivot, as in `Plan`."""
Others, Robots = Sequence[Standing], Container[str]
_FAR = 20.0  # m, radius of the area of a relation without a greatest distance
_ARC = 128  # segments of a half circle
_LINE = 0.002  # m, half width of a line
_ALIKE = 0.75  # least overlap of two regions that share a label, as a fraction of the larger region
_MOST_NAMED = 5
_CROWDED = 0.2  # m, labels that are nearer to each other are moved apart
_SITE = 0.005  # m, radius of the discs that stand for points and for joined sites
_LIFT = 0.002  # m, height of a region above its surface, and above the region before it
_OVER = 1e-4  # m, only geometry at least this high above a surface covers it, as in the generator


def sketch_regions(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw the regions for the pivots of objects as coloured areas, and their supports as grey outlines.

    Args:
        world: The world.
        only: The object whose region is drawn, or None for all objects.
    """
    sketch = Sketch()
    found: dict[tuple[bytes, float], tuple[list[str], MultiPolygon]] = {}
    for name in [only] if only is not None else world.placed_names:
        for outline, left, height in regions_left(world, name):
            for part in shapely.get_parts(outline):
                ring = np.asarray(part.exterior.coords)[:-1, :2]
                sketch.outline(np.c_[ring, np.full(len(ring), height + _LIFT)], GREY)
            if left.is_empty:
                at = outline.representative_point()
                sketch.labels.append((f"no region for {name}", np.array([at.x, at.y, height])))
            else:
                found.setdefault((left.normalize().wkb, height), ([], left))[0].append(name)
    # Many regions are drawn closer together and more transparent, so that the stack looks like a few regions.
    lift, opacity = 2.0 * _LIFT / max(len(found), 2), 0.45 / math.sqrt(max(len(found) / 3.0, 1.0))
    for i, ((_, height), (_, left)) in enumerate(found.items()):
        sketch.area(left, height + (i + 1) * lift, PALETTE[i % len(PALETTE)], opacity)
    sketch.labels += _labels([(names, left, height) for (_, height), (names, left) in found.items()])
    return sketch


def _labels(regions: list[tuple[list[str], MultiPolygon, float]]) -> list[tuple[str, np.ndarray]]:
    """Return the text and position [m] of labels for regions, which are given as (objects, area, height [m]).

    Nearly equal regions share a label. If a label would be close to another label, it moves to the region's edge.
    """
    shared: list[tuple[list[str], MultiPolygon, float]] = []
    for names, left, height in regions:
        for others, area, at_height in shared:
            if at_height == height and area.intersection(left).area > _ALIKE * max(area.area, left.area):
                others += names
                break
        else:
            shared.append((list(names), left, height))
    labels: list[tuple[str, np.ndarray]] = []
    for i, (names, left, height) in enumerate(shared):
        at = left.representative_point()
        if any(math.dist((at.x, at.y), other[:2]) < _CROWDED for _, other in labels):
            edge = max(shapely.get_parts(left), key=lambda part: part.area).exterior
            at = edge.interpolate((i + 0.5) / len(shared), normalized=True)
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        labels.append((f"{', '.join(names[:_MOST_NAMED])}{more} here", np.array([at.x, at.y, height])))
    return labels


def regions_left(world: ShownWorld, name: str) -> list[tuple[MultiPolygon, MultiPolygon, float]]:
    """Return (outline, area for the object's pivot, height [m]) of each surface that may support an object.

    Outlines and areas [m] are in the world frame, seen from above. The area is the part of the surface's region in
    which all relations of the object can hold. Places where the support covers the pivot are left out for `on`, and all
    other places for `inside`. If a relation measures distances between bounds, the area allows for all headings of the
    object, so it is a little too large.
    """
    placed = world.placed(name)
    relations = [relation_area(world, name, relation) for relation in placed.config.relations]
    found = []
    for surface in placed.surfaces[0] if placed.surfaces else []:
        mat, pos = world.data.xmat[surface.body].reshape(3, 3), world.data.xpos[surface.body]
        across = (mat[0, 0], mat[0, 1], mat[1, 0], mat[1, 1], pos[0], pos[1])
        height = float(pos[2] + mat[2, 2] * surface.height)
        outline = affine_transform(_areas(surface.region) if surface.is_endless else surface.outline, across)
        region = affine_transform(surface.region, across)
        for area in relations:
            region = region.intersection(area) if area is not None else region
        region = is_covered_rightly(world, placed, region, height)
        found.append((outline, _areas(region), height))
    return found


def is_covered_rightly(world: ShownWorld, placed: PlacedObject, region: BaseGeometry, height: float) -> BaseGeometry:
    """Return the part of a region, at a height [m], in which the pivot is open above or covered, as the scene requires.

    For an object 'on' its support, no geometry of the support may be above the pivot. For an object 'inside' its
    support, some geometry of the support should be above the pivot.
    """
    if placed.cover == Cover.EITHER or region.is_empty:
        return region
    cover = cover_over(world, placed, height)
    return region.intersection(cover) if placed.cover == Cover.COVERED else region.difference(cover)


def cover_over(world: ShownWorld, placed: PlacedObject, height: float) -> BaseGeometry:
    """Return the outline, seen from above, of all geometry above a height [m] that belongs to an object's support."""
    compiled = world.compiled
    assert placed.support is not None
    parent = compiled.scene.around(placed.support)
    found = []
    for piece in compiled.plan.pieces:
        if piece.body in parent and piece.type != PieceType.PLANE and piece.mesh is not None:
            mesh = piece.mesh.copy(include_cache=True)
            mesh.apply_transform(pose_matrix(world.data.xpos[piece.body], world.data.xquat[piece.body]))
            found.append(shadow(mesh, height + _OVER))
    return shapely.union_all(found)


def _areas(region: BaseGeometry) -> MultiPolygon:
    """Return a region as polygons that can be drawn. Points become small discs, and lines are left out."""
    discs = [part.buffer(_SITE) if isinstance(part, Point) else part for part in shapely.get_parts(region)]
    return polygons_of(shapely.union_all([disc for disc in discs if isinstance(disc, Polygon)]))


def relation_area(world: ShownWorld, name: str, relation: Relation) -> BaseGeometry | None:
    """Return the area that a relation allows for an object's pivot, or None if absent objects make it inactive."""
    frames = [other for key, other in relation.references if key == "frame"]
    there = [anchor for anchor in relation.anchors if world.is_shown(anchor)]
    if len(there) < relation.least_anchors or not all(map(world.is_shown, frames)):
        return None
    robots, roots = world.compiled.config.all_robots, world.compiled.plan.joined_bounds(world.own(name), relation)
    heading = relation.heading(robots) + _frame_heading(world, name, relation)
    standing = {other: world.standing(other) for other in (name, *there)}
    own, *anchors = ((place, roots.get(world.own(other), bounds)) for other, (place, bounds) in standing.items())
    return area_of(relation, own, anchors, heading, robots)


def _frame_heading(world: ShownWorld, name: str, relation: Relation) -> float:
    """Return the heading [rad], in the world, of the frame in which a relation's direction is given."""
    if relation.reference_frame == "world":
        return 0.0
    if relation.reference_frame == "support":
        ground = world.placed(name).ground
        mat = world.data.xmat[0 if ground is None else ground]
        return math.atan2(mat[3], mat[0])
    return float(world.standing(relation.reference_frame)[0][3])


@singledispatch
def area_of(relation: Relation, own: Standing, anchors: Others, heading: float, robots: Robots) -> BaseGeometry:
    """Return the area, seen from above, that a relation allows for an object's pivot.

    Args:
        relation: The relation.
        own: Pivot and bounds of the object.
        anchors: Pivots and bounds of the present anchors.
        heading: The direction of the relation in the world, as a heading [rad].
        robots: Names of the scene's robots, whose sides have other directions.
    """
    raise NotImplementedError(f"no area of {type(relation).__name__}")


@area_of.register
def _sector(relation: Sector, own: Standing, anchors: Others, heading: float, robots: Robots) -> BaseGeometry:
    (place, bounds), low, high = anchors[0], relation.low, min(relation.high, _FAR)
    if relation.by_bounds:
        low -= _outside(bounds) + _outside(own[1])
        high += _radius(bounds) + _radius(own[1])
    return _wedge(place[:2], heading, relation.half_angle, max(low, 0.0), high)


@area_of.register
def _between(relation: Between, own: Standing, anchors: Others, heading: float, robots: Robots) -> BaseGeometry:
    hull = MultiPoint([place[:2] for place, _ in anchors]).convex_hull
    if isinstance(hull, Polygon):
        return hull
    width = relation.width or min(own[1][2:] - own[1][:2])
    return hull.buffer(width / 2.0, cap_style="flat" if isinstance(hull, LineString) else "square")


@area_of.register
def _joined(relation: Joined, own: Standing, anchors: Others, heading: float, robots: Robots) -> BaseGeometry:
    return Point(*own[0][:2]).buffer(_SITE)


@area_of.register
def _beside(relation: Beside, own: Standing, anchors: Others, heading: float, robots: Robots) -> BaseGeometry:
    """Return the line of positions for the pivot at which the gap between object and anchor has the required width.

    The gap is measured between the bounds of both. At either end of the line, the two bounds are flush on one side.
    With `align`, the line is a point.
    """
    side = np.array([math.cos(heading), math.sin(heading)])
    along = np.array([-side[1], side[0]])
    offset = _extent(anchors[0], side)[1] + relation.gap - _extent(own, side)[0]
    wide, narrow = _extent(anchors[0], along), _extent(own, along)
    right, left = wide[0] - narrow[0], wide[1] - narrow[1]
    if (end := relation.aligned(robots)) is not None:
        right = left = right + (end + 1) / 2.0 * (left - right)
    middle = anchors[0][0][:2] + offset * side
    return MultiPoint([middle + right * along, middle + left * along]).convex_hull.buffer(_LINE)


def _wedge(apex: np.ndarray, axis: float, half_angle: float, low: float, high: float) -> BaseGeometry:
    if half_angle >= math.pi:
        return Point(*apex).buffer(high, _ARC // 2).difference(Point(*apex).buffer(low, _ARC // 2))
    angles = axis + np.linspace(-half_angle, half_angle, max(2, math.ceil(_ARC * half_angle / math.pi) * 2))
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    inner = apex + low * rays[::-1] if low > 0.0 else apex[None]
    return Polygon(np.concatenate([apex + high * rays, inner]))


def _extent(standing: Standing, along: np.ndarray) -> tuple[float, float]:
    """Return the least and greatest coordinate [m] of an object's bounds along a direction, relative to its pivot.

    `along` is a horizontal unit vector in the world, shape (2,).
    """
    (*_, heading), bounds = standing
    c, s = math.cos(heading), math.sin(heading)
    corners = np.array([[x, y] for x in bounds[[0, 2]] for y in bounds[[1, 3]]]) @ np.array([[c, s], [-s, c]])
    reach = corners @ along
    return float(reach.min()), float(reach.max())


def _radius(bounds: np.ndarray) -> float:
    """Return the distance [m] from the pivot to the furthest corner of the bounds."""
    return float(np.linalg.norm(np.maximum(np.abs(bounds[:2]), np.abs(bounds[2:]))))


def _outside(bounds: np.ndarray) -> float:
    """Return the distance [m] from the pivot to the nearest point of the bounds. 0 if the pivot is in the bounds."""
    return float(np.linalg.norm(np.maximum(np.maximum(bounds[:2], -bounds[2:]), 0.0)))
