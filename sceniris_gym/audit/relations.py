"""Checks of relations, by distances and angles in double precision and by shapely."""

from __future__ import annotations

from functools import singledispatch

import numpy as np
import shapely

from sceniris_gym.audit.geometry import rotation
from sceniris_gym.audit.language import Excess
from sceniris_gym.audit.outlines import Outline, Seen
from sceniris_gym.audit.scene import JudgedScene
from sceniris_gym.config.relations import Beside, Between, Joined, Near, Relation, Sector

THIN = 1e-3  # m; anchors with a thinner hull lie on a line
_NEARLY_THIN = 1e-5  # m; so near to THIN, either answer is right
ROUNDING = 1e-6  # m; rounding error of a position in single precision, a large angle close to the anchor


def excess(scene: JudgedScene, seen: Seen) -> Excess:
    """Measure every relation of every object.

    Returns:
        (object, relation, unit) -> violation in each row [m or rad], at most 0 where the relation holds, NaN where it
        does not apply because something is absent. Shape (nrow,).
    """
    found = {}
    for name, part in scene.config.parts.items():
        for i, relation in enumerate(part.relations):
            applies = seen.present[name] & _is_complete(relation, seen)
            for unit, amount in _missed(relation, name, scene, seen).items():
                found[name, f"{i} {relation.word}", unit] = np.where(applies, amount, np.nan)
    return found


def _is_complete(relation: Relation, seen: Seen) -> np.ndarray:
    """Return the rows in which enough of a relation's objects are present, shape (nrow,)."""
    enough = np.sum([seen.present[anchor] for anchor in relation.anchors], axis=0) >= relation.least_anchors
    return np.all([enough, *(seen.present[name] for key, name in relation.references if key == "frame")], axis=0)


@singledispatch
def _missed(relation: Relation, name: str, scene: JudgedScene, seen: Seen) -> dict[str, np.ndarray]:
    """Return unit -> violation of an object's relation. Absent objects count, except anchors of 'between'."""
    raise NotImplementedError(f"no audit of {type(relation).__name__}")


@_missed.register
def _off_sector(relation: Sector, name: str, scene: JudgedScene, seen: Seen) -> dict[str, np.ndarray]:
    own, anchor = seen.outlines[name], seen.outlines[relation.anchors[0]]
    missed = {}
    apart = own.pivot[:, :2] - anchor.pivot[:, :2]
    if relation.low > 0 or relation.high < np.inf:
        distance = np.linalg.norm(apart, axis=1)
        if relation.by_bounds:
            distance = np.asarray(shapely.distance(_rectangles(own), _rectangles(anchor)))
        missed["m"] = np.maximum(relation.low - distance, distance - relation.high)
    if not isinstance(relation, Near):
        off = wrapped(np.arctan2(apart[:, 1], apart[:, 0]) - _heading(relation, name, scene, seen))
        rounding = ROUNDING / np.maximum(np.linalg.norm(apart, axis=1), ROUNDING)
        missed["rad"] = np.abs(off) - relation.half_angle - rounding
    return missed


@_missed.register
def _off_between(relation: Between, name: str, scene: JudgedScene, seen: Seen) -> dict[str, np.ndarray]:
    own = seen.outlines[name]
    anchors = np.stack([seen.outlines[a].pivot[:, :2] for a in relation.anchors], 1)
    there = np.stack([seen.present[a] for a in relation.anchors], 1)
    width = (own.high - own.low).min(1) if relation.width is None else np.full(len(there), relation.width)
    return {"m": _off_hull(own.pivot[:, :2], anchors, there, width)}


@_missed.register
def _off_beside(relation: Beside, name: str, scene: JudgedScene, seen: Seen) -> dict[str, np.ndarray]:
    """Return the larger of two errors: that of the gap, and the part of the narrower bounds beyond the wider ones."""
    own, anchor, heading = seen.outlines[name], seen.outlines[relation.beside], _heading(relation, name, scene, seen)
    side = np.stack([np.cos(heading), np.sin(heading)], 1)
    across = np.stack([-side[:, 1], side[:, 0]], 1)
    off = np.abs(own.span(side)[0] - anchor.span(side)[1] - relation.gap)
    (low, high), (other_low, other_high) = own.span(across), anchor.span(across)
    inside = np.maximum(other_low - low, high - other_high)
    around = np.maximum(low - other_low, other_high - high)
    return {"m": np.maximum(off, np.where(high - low <= other_high - other_low, inside, around))}


@_missed.register
def _off_site(relation: Joined, name: str, scene: JudgedScene, seen: Seen) -> dict[str, np.ndarray]:
    """Return the distance of the sites from where they should meet, and the error of the angle between them."""
    sites = relation.beside
    own, own_x = _site(name, sites.my, scene, seen)
    its, its_x = _site(sites.of, sites.its, scene, seen)
    level = its_x / np.linalg.norm(its_x, axis=1, keepdims=True)
    between = np.arctan2(own_x[:, 1], own_x[:, 0]) - np.arctan2(its_x[:, 1], its_x[:, 0])
    off = wrapped(between - np.radians(sites.turn))
    return {"m": np.linalg.norm(own - its - (relation.gap or 0.0) * level, axis=1), "rad": np.abs(off)}


def _heading(relation: Relation, name: str, scene: JudgedScene, seen: Seen) -> np.ndarray:
    """Return the heading [rad] of a relation in the world, shape (nrow,)."""
    turned = {"support": seen.support_heading[name], "world": np.zeros(len(seen.support_heading[name]))}
    frame = relation.reference_frame
    heading = turned[frame] if frame in turned else seen.outlines[frame].heading
    return heading + relation.heading(scene.config.all_robots)


def _site(name: str, word: str, scene: JudgedScene, seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    """Return the position of an object's site from above [m], and its x axis, shape (nrow, 2) each."""
    mjm, poses = scene.mjm, seen.poses
    inside = mjm.body(scene.bodies[name]).name.rpartition("/")[0] or name
    sites = {mjm.site(i).name: i for i in range(mjm.nsite)}
    site = sites[f"{inside}/{word}" if f"{inside}/{word}" in sites else word]
    body = int(mjm.site_bodyid[site])
    at = poses.xpos[:, body] + poses.xmat[:, body] @ mjm.site_pos[site]
    return at[:, :2], (poses.xmat[:, body] @ rotation(mjm.site_quat[site])[:, 0])[:, :2]


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles [rad] wrapped into (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def _rectangles(outline: Outline) -> np.ndarray:
    """Return the bounds as shapes, shape (nrow,); bounds without area become a point or a line."""
    return np.asarray(shapely.convex_hull(shapely.multipoints(outline.corners())))


def _off_hull(point: np.ndarray, anchors: np.ndarray, there: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return the distance [m] of points (nrow, 2) from the hull, strip or square of anchors (nrow, n, 2)."""
    first = anchors[np.arange(len(there)), there.argmax(1)]
    anchors = np.where(there[..., None], anchors, first[:, None])  # absent ones do not count
    hull = shapely.convex_hull(shapely.multipoints(anchors))
    to_hull = shapely.distance(shapely.points(point), hull)

    apart = np.linalg.norm(anchors[:, :, None] - anchors[:, None], axis=-1)
    a, b = np.unravel_index(apart.reshape(len(point), -1).argmax(1), apart.shape[1:])
    rows = np.arange(len(point))
    length = apart[rows, a, b]
    along = (anchors[rows, b] - anchors[rows, a]) / np.maximum(length, 1e-12)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], 1)
    from_line = np.einsum("nkj,nj->nk", anchors - anchors[rows, a][:, None], across)
    thin = np.ptp(from_line, axis=1)
    t, u = (((point - anchors[rows, a]) * axis).sum(1) for axis in (along, across))
    to_strip = np.hypot(np.maximum(np.maximum(-t, t - length), 0), np.maximum(np.abs(u) - width / 2, 0))
    from_point = np.abs(point - (anchors[rows, a] + anchors[rows, b]) / 2)
    to_square = np.linalg.norm(np.maximum(from_point - width[:, None] / 2, 0), axis=1)
    to_strip = np.where(length > THIN + _NEARLY_THIN, to_strip, to_square)
    either = np.minimum(to_hull, to_strip)
    return np.where(thin > THIN + _NEARLY_THIN, to_hull, np.where(thin < THIN - _NEARLY_THIN, to_strip, either))
