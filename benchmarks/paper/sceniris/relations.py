"""Constraints between objects of an original configuration, as relations of a scene."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.paper.sceniris.keys import KeyReader
from sceniris_gym.config.relations import HEADINGS

_SIDES = {"x": "right", "-x": "left", "y": "back", "-y": "front"} | {side: side for side in HEADINGS}
_LIMITS = {"greater": "min", "less": "max", "equal": "equal"}
_KEYS = {
    "direction": "direction",
    "angle": "direction_tolerance_angle",
    "frame": "relation_axis_transform",
    "distance": "distance",
    "measure": "distance_start_bbox",
}
_LEAST = 0.01  # m, the original's least distance


@dataclass(frozen=True)
class Views:
    """The frames that a direction may be given in: all objects by id, and transforms of the world by robot name.

    `own` is the object whose keys are being read.
    """

    objects: Collection[str]
    robots: Mapping[str, Any]
    own: str | None = None


def read_relation(keys: KeyReader, views: Views) -> dict | None:
    """Return a constraint as an entry of `relations`, or None if it cannot be carried over."""
    anchors = [
        keys.known("anchor_object_ids", "object", name, views.objects, views.own)
        for name in keys.values("anchor_object_ids")
    ]
    direction, kind = keys.take("direction"), keys.take("distance_type")
    side = direction.lower() if isinstance(direction, str) else None
    middle = "middle" in (kind, side)
    if middle and len(anchors) == 1:
        raise keys.wrong("anchor_object_ids", f"{anchors} should name two objects or more for 'middle'")
    if len(anchors) > 1 and (middle or direction is None):
        if len(anchors) == 2:
            said = "direction" if side == "middle" else "distance_type" if middle else "anchor_object_ids"
            keys.change(said, "a strip between two anchors here, a rectangle along the support's axes in the original")
        return _between(keys, anchors)
    distance = _distance(keys, kind)
    # Without an anchor the original ignores a constraint; in the other cases it stops with an error.
    if len(anchors) != 1 or side == "next_to" or (direction is None and not distance):
        keys.leave_out()
        return None
    if direction is None:
        relation = distance | _around(keys, anchors[0], distance)
    else:
        relation = distance | _towards(keys, anchors[0], side or direction, views)
    keys.finish()
    return relation


def note_origins(keys: KeyReader, part: str, relation: Mapping[str, Any]) -> None:
    """Remember which keys of a constraint the parts of a relation are made from; `part` is its path in the scene."""
    keys.made(part, "")
    for word in relation:
        keys.made(f"{part}.{word}", _KEYS.get(word, "anchor_object_ids"))
    keys.made(f"{part}.distance.tolerance", "distance_relax")


def _between(keys: KeyReader, anchors: list[str]) -> dict:
    keys.ignore("direction_tolerance_angle", "relation_axis_transform", "distance", "distance_relax")
    if not keys.value("distance_start_bbox"):
        keys.ignore("distance_start_bbox", "max_mesh_projection_z")
    keys.finish()
    return {"between": anchors}


def _distance(keys: KeyReader, kind: str | None) -> dict:
    """Return the distance and how it is measured, empty if there is none."""
    measure = {"measure": "bounds"} if keys.take("distance_start_bbox", False) else {}
    if measure:
        keys.change(
            "distance_start_bbox", "between the bounds of both here, from the anchor's hull to a point in the original"
        )
    else:
        keys.ignore("max_mesh_projection_z")
    if isinstance(keys.value("distance"), str):  # 'next_to'
        keys.leave_out("distance")
    tolerance = keys.number("distance_relax", 0.01)
    if keys.value("distance") is None:
        return {"distance": {"min": _LEAST}, **measure} if measure else {}
    kind = "equal" if kind is None else keys.known("distance_type", "distance type", kind, _LIMITS)
    distance = {_LIMITS[kind]: keys.number("distance", 0.0)}
    return {"distance": distance | ({"tolerance": tolerance} if kind == "equal" else {}), **measure}


def _around(keys: KeyReader, anchor: str, distance: dict) -> dict:
    """Return the words for all directions around an anchor."""
    keys.ignore("direction_tolerance_angle", "relation_axis_transform")
    if "min" in distance["distance"]:  # 'near' would need an upper limit
        return {"direction": (1.0, 0.0), "of": anchor, "angle": 180.0}
    return {"near": anchor}


def _towards(keys: KeyReader, anchor: str, direction: Any, views: Views) -> dict:
    frame, turn = _frame(keys, anchor, views)
    words: dict[str, Any] = {"frame": frame, "angle": abs(keys.number("direction_tolerance_angle", 90.0))}
    if isinstance(direction, str):
        side = _SIDES[keys.known("direction", "direction", direction, _SIDES)]
        if turn is None:
            return words | {f"{side}_of": anchor}
        vector = np.array([math.cos(HEADINGS[side]), math.sin(HEADINGS[side])])
    else:
        vector = keys.checked("direction", direction, (2,))
    return words | {"direction": vector if turn is None else turn[:2, :2] @ vector, "of": anchor}


def _frame(keys: KeyReader, anchor: str, views: Views) -> tuple[str, np.ndarray | None]:
    """Return the frame of a direction, and the rotation of the direction in it, shape (3, 3)."""
    key = "relation_axis_transform"
    transform = keys.take(key)
    if transform is None:
        return "support", None
    if not isinstance(transform, str):
        return "support", keys.rotation(key, transform)
    if transform in views.robots:
        return "world", keys.rotation(key, views.robots[transform])
    keys.known(key, "frame", transform, ["world", *views.objects, *views.robots], views.own)
    if transform not in ("world", anchor):
        keys.change(key, f"turned with '{transform}' here, with the support in the original, as it is not an anchor")
    return ("anchor" if transform == anchor else transform), None
