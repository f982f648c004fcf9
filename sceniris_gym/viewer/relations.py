"""The layer of relations: an arrow from each anchor to the object, and the area of the relation."""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Point, Polygon

from sceniris_gym.config.relations import Sector
from sceniris_gym.geometry.supports import triangulate
from sceniris_gym.viewer.regions import relation_area
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import PALETTE, Sketch

_LIFT = 0.004  # m above the height of the object's pivot
_OVER = 0.02  # m; height of the ends of arrows above an object
_LINE = 0.06  # m; distance between the labels of an object's relations
_BEYOND = 0.15  # m; margin beyond the object of an endless area


def sketch_relations(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw the relations of all objects, or of one."""
    sketch = Sketch()
    number = 0
    for name in [only] if only is not None else world.placed_names:
        for i, relation in enumerate(world.compiled.config.parts[name].relations):
            area = relation_area(world, name, relation)
            if area is None:
                continue
            colour = PALETTE[number % len(PALETTE)]
            number += 1
            at = world.standing(name)[0][:3]
            anchors = [anchor for anchor in relation.anchors if world.is_shown(anchor)]
            height = float(at[2]) + number * _LIFT
            if isinstance(relation, Sector) and relation.high == math.inf:
                apex = Point(*world.standing(anchors[0])[0][:2])
                area = area.intersection(apex.buffer(apex.distance(Point(*at[:2])) + _BEYOND))
            triangles = triangulate(MultiPolygon([p for p in shapely.get_parts(area) if isinstance(p, Polygon)]))
            points = np.c_[triangles.reshape(-1, 2), np.full(3 * len(triangles), height)]
            sketch.surfaces.append((points, np.arange(len(points)).reshape(-1, 3), colour, 0.3))
            tip = _above(world, name)
            sketch.arrows += [(np.stack([_tail(world, anchor, tip), tip]), colour) for anchor in anchors]
            sketch.words.append((f"{name}: {relation.summary}", tip + [0.0, 0.0, _LINE * (i + 1)]))
    return sketch


def _above(world: ShownWorld, name: str) -> np.ndarray:
    """Return a point (3,) [m] above an object's pivot and the whole object, which hides no arrow there."""
    at = world.standing(name)[0]
    return np.array([at[0], at[1], max(at[2], world.box(name)[1][2]) + _OVER])


def _tail(world: ShownWorld, anchor: str, tip: np.ndarray) -> np.ndarray:
    """Return the start of an arrow from an anchor to `tip`: above it, or at its side if it is higher than the tip."""
    low, high = world.box(anchor, root_alone=True)
    tail = _above(world, anchor)
    if tip[2] >= high[2] or np.all((low[:2] <= tip[:2]) & (tip[:2] <= high[:2])):
        return tail
    tail[2] = max(tip[2], low[2])
    far = (tip - tail)[:2]
    ends = np.where(far > 0.0, high[:2], low[:2]) - tail[:2]
    share = np.divide(ends, far, out=np.ones(2), where=far != 0.0).min()
    return tail + np.clip(share, 0.0, 1.0) * (tip - tail)
