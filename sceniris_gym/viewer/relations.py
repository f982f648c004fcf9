"""The layer of relations: an arrow from each anchor to the object, and the wedge or strip that it has to lie in."""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Point, Polygon

from sceniris_gym.config.relations import Connection, Relation
from sceniris_gym.geometry.supports import triangulate
from sceniris_gym.viewer.regions import relation_area
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import PALETTE, Sketch

_LIFT = 0.004  # m above the height of the object's pivot
_BEYOND = 0.15  # m that an area without end is drawn beyond the object


def sketch_relations(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw the relations of all objects, or of one."""
    sketch = Sketch()
    number = 0
    for name in [only] if only is not None else world.placed_names:
        config = world.compiled.config.parts[name]
        for relation in config.relations:
            area = relation_area(world, name, relation)
            if area is None:
                continue
            colour = PALETTE[number % len(PALETTE)]
            number += 1
            at = world.standing(name)[0][:3]
            anchors = [world.standing(a)[0][:3] for a in relation.anchors if world.is_shown(a)]
            height = float(at[2]) + number * _LIFT
            seen = area
            if relation.high == math.inf and relation.kind == "direction":
                far = float(np.linalg.norm(at[:2] - anchors[0][:2])) + _BEYOND
                seen = area.intersection(Point(*anchors[0][:2]).buffer(far))
            triangles = triangulate(MultiPolygon([p for p in shapely.get_parts(seen) if isinstance(p, Polygon)]))
            points = np.c_[triangles.reshape(-1, 2), np.full(3 * len(triangles), height)]
            sketch.surfaces.append((points, np.arange(len(points)).reshape(-1, 3), colour, 0.3))
            for anchor in anchors:
                ends = np.stack([anchor, at]) + [0.0, 0.0, 0.02 + number * _LIFT]
                sketch.arrows.append((ends, colour))
            sketch.words.append((f"{name}: {describe(relation)}", at + [0.0, 0.0, 0.05 * number]))
    return sketch


def describe(relation: Relation) -> str:
    """Say a relation in a line, as in 'right_of plate, at most 0.5 m'."""
    words = f"{relation.word} {' and '.join(relation.anchors)}"
    if relation.side is not None:
        words = f"beside {relation.anchors[0]}, {relation.side}, gap {relation.gap:g} m"
    if isinstance(relation.beside, Connection):
        words = f"{relation.beside.my} at {relation.beside.its} of {relation.anchors[0]}"
    if relation.low > 0.0:
        words += f", at least {relation.low:g} m"
    if relation.high < math.inf:
        words += f", at most {relation.high:g} m"
    return words + (" between bounds" if relation.bounds else "")
