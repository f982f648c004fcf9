"""Checks every relation of a scene, by distances and angles in double precision and by shapely."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
import shapely

from sceniris_gym.audit.carriers import carrier_of
from sceniris_gym.audit.geometry import Poses
from sceniris_gym.audit.outlines import Outline
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.relations import Connection, Relation
from sceniris_gym.config.scene import SceneConfig

THIN = 1e-3  # m; anchors whose hull is thinner lie on a line
_NEARLY_THIN = 1e-5  # m; this near to THIN, either answer is right
ROUNDING = 1e-6  # m; rounding error of a position in single precision, which is a large angle close to the anchor


class RelationAudit:
    """Measures by how much relations are missed.

    Args:
        config: The scene.
        mjm: The model.
        bodies: Object name -> root body id.
    """

    def __init__(self, config: SceneConfig, mjm: mujoco.MjModel, bodies: Mapping[str, int]) -> None:
        self.config, self.mjm, self.bodies = config, mjm, bodies

    def excess(
        self,
        poses: Poses,
        outlines: Mapping[str, Outline],
        present: Mapping[str, np.ndarray],
        support_heading: Mapping[str, np.ndarray],
    ) -> dict[tuple[str, str, str], np.ndarray]:
        """Measure every relation of every object.

        Args:
            poses: Poses in the rows.
            outlines: Object name -> its outline in each row.
            present: Object name -> rows in which it is present, shape (nrow,).
            support_heading: Object name -> heading of what it stands on [rad], shape (nrow,).

        Returns:
            (object, relation, unit) -> by how much it is missed in each row [m or rad], at most 0 where it holds, NaN
            where it does not apply because something is absent. Shape (nrow,).
        """
        found = {}
        for name, part in self.config.parts.items():
            for i, relation in enumerate(part.relations):
                judged = present[name] & _complete(relation, present)
                if isinstance(relation.beside, Connection):
                    missed = self._off_site(name, relation.beside, relation.site_gap, poses)
                else:
                    missed = self._missed(part, relation, outlines[name], outlines, present, support_heading[name])
                for unit, amount in missed.items():
                    found[name, f"{i} {relation.word}", unit] = np.where(judged, amount, np.nan)
        return found

    def _missed(
        self,
        part: ObjectConfig,
        relation: Relation,
        own: Outline,
        outlines: Mapping[str, Outline],
        present: Mapping[str, np.ndarray],
        support_heading: np.ndarray,
    ) -> dict[str, np.ndarray]:
        """Return unit -> by how much a relation is missed. Absent objects count, except anchors of 'between'."""
        if relation.kind == "between":
            anchors = np.stack([outlines[a].pivot[:, :2] for a in relation.anchors], 1)
            there = np.stack([present[a] for a in relation.anchors], 1)
            width = (own.high - own.low).min(1) if relation.width is None else np.full(len(there), relation.width)
            return {"m": _off_between(own.pivot[:, :2], anchors, there, width)}
        anchor, axis = outlines[relation.anchors[0]], relation.heading(self.config.all_robots)
        turned = {"anchor": anchor.heading, "support": support_heading, "world": np.zeros(len(anchor.heading))}
        frame = turned[relation.frame] if relation.frame in turned else outlines[relation.frame].heading
        if relation.kind == "beside":
            return {"m": _off_beside(own, anchor, axis + frame, relation.gap)}
        missed = {}
        apart = own.pivot[:, :2] - anchor.pivot[:, :2]
        if relation.low > 0 or relation.high < np.inf:
            distance = _between_bounds(own, anchor) if relation.bounds else np.linalg.norm(apart, axis=1)
            missed["m"] = np.maximum(relation.low - distance, distance - relation.high)
        if relation.kind == "direction":
            off = wrapped(np.arctan2(apart[:, 1], apart[:, 0]) - axis - frame)
            rounding = ROUNDING / np.maximum(np.linalg.norm(apart, axis=1), ROUNDING)
            missed["rad"] = np.abs(off) - relation.half_angle - rounding
        return missed

    def _off_site(self, name: str, joined: Connection, gap: float, poses: Poses) -> dict[str, np.ndarray]:
        """Return how far [m] sites are from where they should meet, and how far [rad] one is turned from the other."""
        own, own_x = self._site(name, joined.my, poses)
        its, its_x = self._site(joined.of, joined.its, poses)
        level = its_x / np.linalg.norm(its_x, axis=1, keepdims=True)
        between = np.arctan2(own_x[:, 1], own_x[:, 0]) - np.arctan2(its_x[:, 1], its_x[:, 0])
        off = wrapped(between - np.radians(joined.turn))
        return {"m": np.linalg.norm(own - its - gap * level, axis=1), "rad": np.abs(off)}

    def _site(self, name: str, word: str, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Where a site of an object is seen from above [m], and its x axis, shape (nrow, 2) each."""
        root = self.bodies[name]
        inside = self.mjm.body(root).name.rpartition("/")[0] or name
        sites = {self.mjm.site(i).name: i for i in range(self.mjm.nsite)}
        site = sites[f"{inside}/{word}" if f"{inside}/{word}" in sites else word]
        body, turn = int(self.mjm.site_bodyid[site]), np.zeros(9)
        mujoco.mju_quat2Mat(turn, self.mjm.site_quat[site])
        at = poses.xpos[:, body] + poses.xmat[:, body] @ self.mjm.site_pos[site]
        return at[:, :2], (poses.xmat[:, body] @ turn.reshape(3, 3)[:, 0])[:, :2]


def support_headings(
    config: SceneConfig, poses: Poses, mjm: mujoco.MjModel, bodies: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """Return object name -> heading [rad] of the x axis of the body it stands on, 0 on the floor and in the air.

    Args:
        config: The scene.
        poses: Poses in the rows.
        mjm: The model.
        bodies: Object name -> root body id.
    """
    found = {}
    for name, part in config.parts.items():
        found[name] = np.zeros(len(poses.xpos))
        if part.support is not None:
            x = poses.xmat[:, carrier_of(mjm, bodies, config, part.support.parent).body, :, 0]
            found[name] = np.arctan2(x[:, 1], x[:, 0])
    return found


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles [rad] wrapped into (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def _complete(relation: Relation, present: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the rows in which enough of a relation's objects are present, shape (nrow,)."""
    there = np.stack([present[a] for a in relation.anchors])
    if relation.kind == "between":
        return there.sum(0) >= 2
    return there[0] if relation.frame_object is None else there[0] & present[relation.frame_object]


def _rectangles(outline: Outline) -> np.ndarray:
    """Return the bounds as shapes, shape (nrow,); those without area become a point or a line."""
    return np.asarray(shapely.convex_hull(shapely.multipoints(outline.corners())))


def _between_bounds(own: Outline, anchor: Outline) -> np.ndarray:
    return np.asarray(shapely.distance(_rectangles(own), _rectangles(anchor)))


def _off_beside(own: Outline, anchor: Outline, heading: np.ndarray, gap: float) -> np.ndarray:
    """Return the larger of two errors [m]: of the gap along a heading, and how far the narrower bounds stick out."""
    side = np.stack([np.cos(heading), np.sin(heading)], 1)
    across = np.stack([-side[:, 1], side[:, 0]], 1)
    off = np.abs(own.span(side)[0] - anchor.span(side)[1] - gap)
    (low, high), (other_low, other_high) = own.span(across), anchor.span(across)
    inside = np.maximum(other_low - low, high - other_high)
    around = np.maximum(low - other_low, other_high - high)
    return np.maximum(off, np.where(high - low <= other_high - other_low, inside, around))


def _off_between(point: np.ndarray, anchors: np.ndarray, there: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return how far [m] points (nrow, 2) are outside the hull, strip or square of anchors (nrow, n, 2)."""
    first = anchors[np.arange(len(there)), there.argmax(1)]
    anchors = np.where(there[..., None], anchors, first[:, None])  # the absent ones do not count
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
