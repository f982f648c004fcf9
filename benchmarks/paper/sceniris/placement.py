"""The place of an object of an original configuration: on its parent, or at a fixed position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.paper.sceniris.keys import KeyReader
from benchmarks.paper.sceniris.relations import Views, note_origins, read_relation
from sceniris_gym.config.bounds import MOST_FAR
from sceniris_gym.config.fields import FLOOR

_PLANE = "_plane"  # the original's name for its ground
_SUPPORT_WORDS = {"top": "on", "inside": "inside", "in": "inside"}
_FIXED = "fixed_world_positions"
GROUND = 1e-6  # m; positions that are no farther from the height of the ground are on it
_LIFTED = 1.1e-3  # m over the floor, for objects that nothing carries: a little more than their clearance


def needed_floor(objects: Mapping[str, KeyReader]) -> np.ndarray:
    """Return the smallest size of a floor [m] that contains all fixed positions on it, shape (2,)."""
    size = np.zeros(2)
    for part in objects.values():
        points = fixed_points(part)
        if points is not None and not points[:, 2].any():
            size = np.maximum(size, 2.0 * np.abs(points[:, :2]).max(axis=0))
            if (size > 2.0 * MOST_FAR).any():
                raise part.wrong(_FIXED, f"should be within {MOST_FAR:g} m of the world's origin")
    return size


def fixed_points(keys: KeyReader) -> np.ndarray | None:
    """Return the fixed positions of an object, shape (n, 3), if it has any, without taking them.

    Those on the ground have a z of exactly 0.
    """
    fixed = keys.value(_FIXED)
    if not isinstance(fixed, Sequence | np.ndarray) or len(fixed) == 0:
        return None
    points = np.stack([keys.checked(_FIXED, point, (3,)) for point in fixed])
    points[np.abs(points[:, 2]) <= GROUND, 2] = 0.0
    return points


def fixed_place(keys: KeyReader, points: np.ndarray) -> dict:
    """Return the words for fixed positions [m], shape (n, 3): points of the floor if all are on it, else in space."""
    keys.ignore(_FIXED, "parent_id", "relation_to_parent", "ratio_on_support", "position", "constraints")
    keys.made(f"{keys.path}.region", _FIXED)
    keys.made(f"{keys.path}.region.points", _FIXED)
    on_floor = points[:, 2] == 0.0
    if on_floor.all():
        return {"on": FLOOR, "region": {"points": points[:, :2]}}
    told = []
    if (sunk := ~on_floor & (points[:, 2] < _LIFTED)).any():
        told.append(
            f"those below the ground, or too near to it, are never used: {points[sunk].tolist()}; z = 0 is on it"
        )
    if on_floor.any():
        points = np.where(on_floor[:, None], points + [0.0, 0.0, _LIFTED], points)
        told.append(f"those on the ground are {1e3 * _LIFTED:g} mm over it, as others are not")
    if told:
        keys.change(_FIXED, "; ".join(told))
    return {"region": {"points": points}}


def place(keys: KeyReader, views: Views, limits: np.ndarray | None) -> dict:
    """Return the words for a place on a parent; `limits` [m], shape (2, 2), is the part of the floor to keep to."""
    parent = str(keys.take("parent_id", _PLANE))
    keys.known("parent_id", "object", parent.split("/")[0], [_PLANE, *views.objects], views.own)
    parent = FLOOR if parent == _PLANE else parent
    relation = keys.take("relation_to_parent", "top")
    word = _SUPPORT_WORDS[keys.known("relation_to_parent", "relation to a parent", relation, _SUPPORT_WORDS)]
    position = keys.section("position")
    is_cropped = position.value("xy_limit") is not None
    limit = position.array("xy_limit", [[0.0, 0.0], [1.0, 1.0]], (2, 2))
    crop = np.sort(limit.clip(0.0, 1.0), axis=0)
    if (crop != limit).any():
        position.change("xy_limit", f"{crop.tolist()} here: the low corner first, clipped to the support's bounds")
    position.finish()
    region: dict | None = {"fraction": crop} if is_cropped else None
    if parent == FLOOR and limits is not None:
        region = {"box": limits[0] + crop * (limits[1] - limits[0])}
    relations: list[dict] = []
    for constraint in keys.sections("constraints"):
        if (found := read_relation(constraint, views)) is not None:
            note_origins(constraint, f"{keys.path}.relations.{len(relations)}", found)
            relations.append(found)
    keys.made(f"{keys.path}.{word}", "parent_id")
    keys.made(f"{keys.path}.region", "position.xy_limit")
    keys.made(f"{keys.path}.relations", "constraints")
    asked = keys.number("ratio_on_support", 0.0)
    ratio = min(max(asked, 0.0), 1.0)
    if ratio != asked:
        keys.change("ratio_on_support", f"{asked:g} is clipped to {ratio:g}, as in the original")
    return {word: parent, "ratio_on_support": ratio, "region": region, "relations": relations}
