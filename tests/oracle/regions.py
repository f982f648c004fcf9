"""Areas in which an object may be, in shapely for each layout, from its relations and the outlines it is given."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from sceniris_gym.audit.scene import Outline
from sceniris_gym.config.relations import Between, Relation

_SEGMENTS = 32  # of a quarter circle
_ENDLESS = 10.0  # m


def wedges(apex: np.ndarray, axis: np.ndarray, half_angle: float) -> np.ndarray:
    """All points within `half_angle` [rad] of each direction (n,) [rad], seen from its apex (n, 2), shape (n,)."""
    turns = axis[:, None] + np.linspace(-half_angle, half_angle, 4 * _SEGMENTS)
    far = apex[:, None] + _ENDLESS * np.stack([np.cos(turns), np.sin(turns)], 2)
    return np.asarray(shapely.polygons(far if half_angle >= np.pi else np.concatenate([apex[:, None], far], 1)))


def strips(points: np.ndarray, width: float) -> list[BaseGeometry]:
    """Strips of one width [m] between the two points of each row (n, k, 2) that are farthest apart."""
    ends = [max(combinations(row, 2), key=lambda pair: np.linalg.norm(pair[0] - pair[1])) for row in points]
    return [shapely.LineString(pair).buffer(width / 2, cap_style="flat") for pair in ends]


def regions(relation: Relation, own: Outline, anchors: Mapping[str, Outline], support: np.ndarray) -> np.ndarray:
    """The points where an object may have its pivot by one relation, in each row, shape (n,).

    Args:
        relation: a direction, or 'near' or 'between'.
        own: the outline of the object, of which its place does not matter.
        anchors: object name -> outline.
        support: headings of what the object stands on [rad], shape (n,).
    """
    at = np.stack([anchors[name].pivot[:, :2] for name in relation.anchors], 1)
    if isinstance(relation, Between):
        hulls = np.asarray(shapely.convex_hull(shapely.multipoints(at)))
        if relation.width is not None:
            flat = shapely.area(shapely.buffer(shapely.oriented_envelope(hulls), -5e-4)) == 0
            hulls[flat] = strips(at[flat], relation.width)
        return hulls
    heading, frame = {"support": support, "world": np.zeros(len(at))}, relation.reference_frame
    turned = heading[frame] if frame in heading else anchors[frame].heading
    areas = wedges(at[:, 0], relation.heading(()) + turned, relation.half_angle)
    cores = shapely.points(at[:, 0])
    if relation.by_bounds:
        theirs = anchors[relation.anchors[0]].corners()
        mine = own.corners() - own.pivot[:, None, :2]
        cores = shapely.convex_hull(shapely.multipoints((theirs[:, :, None] - mine[:, None]).reshape(len(at), -1, 2)))
    if relation.high < np.inf:
        areas = shapely.intersection(areas, shapely.buffer(cores, relation.high, quad_segs=_SEGMENTS))
    if relation.low > 0:
        areas = shapely.difference(areas, shapely.buffer(cores, relation.low, quad_segs=_SEGMENTS))
    return np.asarray(areas)
