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


def wedge(apex: np.ndarray, axis: float, half_angle: float) -> BaseGeometry:
    """All points within `half_angle` [rad] of a direction, seen from the apex."""
    turns = axis + np.linspace(-half_angle, half_angle, 4 * _SEGMENTS)
    far = apex + _ENDLESS * np.stack([np.cos(turns), np.sin(turns)], 1)
    if half_angle >= np.pi:
        return shapely.Polygon(far)
    return shapely.Polygon([apex, *far])


def region(relation: Relation, own: Outline, anchors: Mapping[str, Outline], row: int, support: float) -> BaseGeometry:
    """The points where an object of the heading and bounds in a row may have its pivot, by one relation.

    Args:
        relation: a direction, or 'near' or 'between'.
        own: the outline of the object, of which its place does not matter.
        anchors: object name -> outline.
        row: the row.
        support: heading of what the object stands on [rad].
    """
    at = [anchors[name].pivot[row, :2] for name in relation.anchors]
    if isinstance(relation, Between):
        hull = shapely.MultiPoint(at).convex_hull
        if relation.width is None or hull.minimum_rotated_rectangle.buffer(-5e-4).area > 0:
            return hull
        ends = max(combinations(at, 2), key=lambda pair: np.linalg.norm(pair[0] - pair[1]))
        return shapely.LineString(ends).buffer(relation.width / 2, cap_style="flat")
    heading, frame = {"support": support, "world": 0.0}, relation.reference_frame
    turned = heading[frame] if frame in heading else anchors[frame].heading[row]
    area = wedge(at[0], relation.heading(()) + turned, relation.half_angle)
    core = shapely.Point(at[0])
    if relation.by_bounds:
        theirs = anchors[relation.anchors[0]].corners()[row]
        mine = own.corners()[row] - own.pivot[row, :2]
        core = shapely.MultiPoint((theirs[:, None] - mine[None]).reshape(-1, 2)).convex_hull
    if relation.high < np.inf:
        area = area.intersection(core.buffer(relation.high, quad_segs=_SEGMENTS))
    if relation.low > 0:
        area = area.difference(core.buffer(relation.low, quad_segs=_SEGMENTS))
    return area
