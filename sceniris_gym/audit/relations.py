"""Checks relations and orientations in double precision, with shapely and with angles, and counts violations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch

import mujoco
import numpy as np
import shapely

from sceniris_gym.audit.geometry import Poses, rotation
from sceniris_gym.audit.scene import JudgedScene, Outline, Seen
from sceniris_gym.config.orientation import DrawnOrientation
from sceniris_gym.config.relations import HEADINGS, ROBOT_HEADINGS, Beside, Between, Joined, Near, Relation, Sector

Excess = dict[tuple[str, str, str], np.ndarray]
"""(Name, word, unit) -> violation in each row, NaN where the requirement does not apply, shape (nrow,)."""
TOLERANCES = {"m": 1e-4, "rad": 1e-3, "objects": 0.0}


@dataclass(frozen=True)
class Kept:
    """Counts for one requirement of an object or a group.

    Attributes:
        name: The object or the group.
        word: The requirement: a relation (its index among the object's relations, and its key, such as "0 near"), or a
            part of the orientation or of the group, such as "yaw" or "count".
        unit: "m", "rad" or "objects".
        checked: Number of rows where the requirement applies.
        broken: Number of rows with a violation above the tolerance of the unit.
        worst: Largest violation in the unit, at most 0 if the requirement is always met.
        row: The row with the largest violation, -1 if the requirement applies nowhere.
    """

    name: str
    word: str
    unit: str
    checked: int
    broken: int
    worst: float
    row: int


def count(found: Sequence[Excess]) -> list[Kept]:
    """Count the rows that violate each requirement, from the violations in each chunk of rows."""
    return [_counted(key, np.concatenate([chunk[key] for chunk in found])) for key in (found[0] if found else ())]


def _counted(key: tuple[str, str, str], amount: np.ndarray) -> Kept:
    applies = ~np.isnan(amount)
    amount = np.where(applies, amount, -np.inf)
    row = int(amount.argmax()) if applies.any() else -1
    broken = int((amount > TOLERANCES[key[-1]]).sum())
    return Kept(*key, int(applies.sum()), broken, float(amount.max(initial=-np.inf)), row)


THIN = 1e-3  # m, if the hull of the anchors is thinner, the anchors count as points of a line
_NEARLY_THIN = 1e-5  # m, if the hull differs from THIN by less, both the hull and the strip are right
_ROUNDING = 1e-6  # m, rounding error of a position in single precision, which is a large angle close to the anchor
_LOWEST = 1e-4  # m, points up to this height above the lowest point carry the object
_ONE_POINT = 1e-5  # m, pivots up to this distance apart coincide, up to rounding


def excess(scene: JudgedScene, seen: Seen) -> Excess:
    """Measure every relation of every object.

    Returns:
        (object, relation, unit) -> violation in each row [m or rad], shape (nrow,). At most 0 if the relation holds.
        NaN if the relation does not apply, because an object is absent.
    """
    found = {}
    for name, part in scene.config.parts.items():
        for i, relation in enumerate(part.relations):
            applies = seen.present[name] & _is_complete(relation, seen)
            for unit, amount in _missed(relation, name, scene, seen).items():
                found[name, f"{i} {relation.word}", unit] = np.where(applies, amount, np.nan)
    return found


def _is_complete(relation: Relation, seen: Seen) -> np.ndarray:
    """Return a mask of the rows where enough anchors, and the object that `frame` names, are present, shape (nrow,)."""
    enough = np.sum([seen.present[anchor] for anchor in relation.anchors], axis=0) >= relation.least_anchors
    return np.all([enough, *(seen.present[name] for key, name in relation.references if key == "frame")], axis=0)


@singledispatch
def _missed(relation: Relation, name: str, scene: JudgedScene, seen: Seen) -> dict[str, np.ndarray]:
    """Return how far each row violates an object's relation: unit ('m' or 'rad') -> violation, shape (nrow,).

    A relation may have both units, for a distance and an angle. The violation is computed as if all objects were
    present. But absent anchors of 'between' are left out.
    """
    raise NotImplementedError(f"audit: {type(relation).__name__} cannot be judged. Leave out this relation.")


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
        off = _wrapped(np.arctan2(apart[:, 1], apart[:, 0]) - _heading(relation, name, scene, seen))
        rounding = _ROUNDING / np.maximum(np.linalg.norm(apart, axis=1), _ROUNDING)
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
    """Return the larger of two errors [m]: of the gap between the objects, and of their alignment.

    The alignment is wrong by the distance that the narrower object sticks out beyond an end of the wider object. With
    `align`, it is wrong by the distance between the two ends at this side, or between the two middles.
    """
    joined, owners = scene.config.joined_by_root(name, relation), scene.config.owners
    by_root = {n: seen.roots[n] for one in joined for n in (one, owners.get(one, one)) if n in seen.roots}
    own, anchor = (by_root.get(n, seen.outlines[n]) for n in (name, relation.beside))
    heading = _heading(relation, name, scene, seen)
    side = np.stack([np.cos(heading), np.sin(heading)], 1)
    across = np.stack([-side[:, 1], side[:, 0]], 1)
    off = np.abs(own.span(side)[0] - anchor.span(side)[1] - relation.gap)
    (low, high), (other_low, other_high) = own.span(across), anchor.span(across)
    if relation.align is not None:
        apart = (low + high - other_low - other_high) / 2
        if relation.align != "middle":
            sides = ROBOT_HEADINGS if relation.reference_frame in scene.config.all_robots else HEADINGS
            turned = heading + sides[relation.align] - sides[relation.side]
            end = np.stack([np.cos(turned), np.sin(turned)], 1)
            apart = own.span(end)[1] - anchor.span(end)[1]
        return {"m": np.maximum(off, np.abs(apart))}
    inside = np.maximum(other_low - low, high - other_high)
    around = np.maximum(low - other_low, other_high - high)
    return {"m": np.maximum(off, np.where(high - low <= other_high - other_low, inside, around))}


@_missed.register
def _off_site(relation: Joined, name: str, scene: JudgedScene, seen: Seen) -> dict[str, np.ndarray]:
    """Return the errors of the distance and of the angle between the two sites."""
    sites = relation.beside
    own, own_x = _site(name, sites.site, scene, seen)
    its, its_x = _site(sites.of, sites.of_site, scene, seen)
    level = its_x / np.linalg.norm(its_x, axis=1, keepdims=True)
    between = np.arctan2(own_x[:, 1], own_x[:, 0]) - np.arctan2(its_x[:, 1], its_x[:, 0])
    off = _wrapped(between - np.radians(sites.angle))
    return {"m": np.linalg.norm(own - its - (relation.gap or 0.0) * level, axis=1), "rad": np.abs(off)}


def _heading(relation: Relation, name: str, scene: JudgedScene, seen: Seen) -> np.ndarray:
    """Return the required direction from the anchor to the object, as an angle [rad] in the world, shape (nrow,)."""
    headings = {"support": seen.support_heading[name], "world": np.zeros(len(seen.support_heading[name]))}
    frame = relation.reference_frame
    heading = headings[frame] if frame in headings else seen.outlines[frame].heading
    return heading + relation.heading(scene.config.all_robots)


def _site(name: str, word: str, scene: JudgedScene, seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    """Return the position [m] of an object's site and the site's x axis, both seen from above, shape (nrow, 2)."""
    mjm, poses = scene.mjm, seen.poses
    if members := scene.config.variants.get(name):
        there = np.argmax([seen.present[member] for member in members], axis=0), np.arange(len(poses.xpos))
        at, x = zip(*(_site(member, word, scene, seen) for member in members), strict=True)
        return np.stack(at)[there], np.stack(x)[there]
    root, sites = mjm.body(scene.bodies[name]).name, {mjm.site(i).name: i for i in range(mjm.nsite)}
    prefixes = f"{root}/", f"{root.rpartition('/')[0] or name}/", ""
    site = next(sites[prefix + word] for prefix in prefixes if prefix + word in sites)
    body = int(mjm.site_bodyid[site])
    at = poses.xpos[:, body] + poses.xmat[:, body] @ mjm.site_pos[site]
    return at[:, :2], (poses.xmat[:, body] @ rotation(mjm.site_quat[site])[:, 0])[:, :2]


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles [rad] wrapped into (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def _rectangles(outline: Outline) -> np.ndarray:
    """Return the bounds as shapely geometries, shape (nrow,). Bounds without area become a point or a line."""
    return np.asarray(shapely.convex_hull(shapely.multipoints(outline.corners())))


def _off_hull(point: np.ndarray, anchors: np.ndarray, there: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return the distance [m] of points from the region of `between`, shape (nrow,).

    The region is the hull of the present anchors. If this hull is thin, the region is a strip along the anchors. If all
    anchors lie at one place, the region is a square.

    Args:
        point: The points [m], shape (nrow, 2).
        anchors: Pivots of the anchors [m], shape (nrow, n, 2).
        there: Whether each anchor is present, shape (nrow, n).
        width: Width of the strip, and side of the square [m], shape (nrow,).
    """
    rows = np.arange(len(point))
    first = anchors[rows, there.argmax(1)]
    anchors = np.where(there[..., None], anchors, first[:, None])  # absent anchors do not count
    hull = shapely.convex_hull(shapely.multipoints(anchors))

    apart = np.linalg.norm(anchors[:, :, None] - anchors[:, None], axis=-1)
    a, b = np.unravel_index(apart.reshape(len(point), -1).argmax(1), apart.shape[1:])
    ends = np.stack([anchors[rows, a], anchors[rows, b]], 1)
    along = (ends[:, 1] - ends[:, 0]) / np.maximum(apart[rows, a, b], 1e-12)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], 1)
    thin = np.ptp(np.einsum("nkj,nj->nk", anchors, across), axis=1)
    strip = shapely.buffer(shapely.linestrings(ends), width / 2, cap_style="flat")
    square = shapely.buffer(shapely.points(ends.mean(1)), width / 2, cap_style="square")
    narrow = np.where(apart[rows, a, b] > THIN + _NEARLY_THIN, strip, square)
    to_hull, to_narrow = (shapely.distance(shapely.points(point), region) for region in (hull, narrow))
    either = np.minimum(to_hull, to_narrow)
    return np.where(thin > THIN + _NEARLY_THIN, to_hull, np.where(thin < THIN - _NEARLY_THIN, to_narrow, either))


class OrientationAudit:
    """Measures the violation of orientations.

    Args:
        scene: The scene.
        hulls: Object name -> corners of its convex hull in the start pose [m], in the frame of its root, shape (n, 3).
    """

    def __init__(self, scene: JudgedScene, hulls: Mapping[str, np.ndarray]) -> None:
        self.scene, self.hulls, home = scene, hulls, scene.home
        self._mass_at = {
            name: home.xmat[root].reshape(3, 3).T @ (_center_of_weight(home, root) - home.xpos[root])
            for name, root in scene.bodies.items()
        }

    def excess(self, seen: Seen) -> Excess:
        """Measure the orientation of every placed object.

        Returns:
            (object, requirement, unit) -> violation in each row [m or rad], shape (nrow,). At most 0 if the orientation
            is right. NaN if the object is absent.
        """
        found, outlines = {}, seen.outlines
        for name, part in self.scene.placed.items():
            if part.drawn_orientation.kind == "any":
                continue
            drawn_as, root = part.drawn_orientation, self.scene.bodies[name]
            missed = {("yaw", "rad"): _off_interval(outlines[name].heading - seen.support_heading[name], 0.0, drawn_as)}
            if drawn_as.kind == "stable":
                missed["stable", "m"] = self._off_balance(name, seen.poses)
            else:
                up = seen.poses.xmat[:, root] @ rotation(self.scene.mjm.body_quat[root])[2]
                missed["upright", "rad"] = np.arctan2(np.linalg.norm(up[:, :2], axis=1), up[:, 2])
            if drawn_as.target is not None:
                target, own = outlines[drawn_as.target], outlines[name]
                turn = (own.heading - target.heading, 0.0) if drawn_as.kind == "with" else _from_target(own, target)
                yaw = missed.pop(("yaw", "rad"))
                turned = _off_interval(*turn, drawn_as)
                missed[drawn_as.kind, "rad"] = np.where(seen.present[drawn_as.target], turned, yaw)
            found |= {(name, *key): np.where(seen.present[name], amount, np.nan) for key, amount in missed.items()}
        return found

    def _off_balance(self, name: str, poses: Poses) -> np.ndarray:
        """Return how far [m] an object is out of balance in each row, shape (nrow,).

        This is the distance, seen from above, between the centre of mass and the hull of the lowest points.
        """
        mat = poses.xmat[:, self.scene.bodies[name]]
        points = np.einsum("nij,kj->nki", mat, self.hulls[name])
        row, corner = np.nonzero(points[:, :, 2] <= points[:, :, 2].min(1)[:, None] + _LOWEST)
        carried = shapely.convex_hull(shapely.multipoints(points[row, corner, :2], indices=row))
        return shapely.distance(shapely.points((mat @ self._mass_at[name])[:, :2]), carried)


def _center_of_weight(home: mujoco.MjData, root: int) -> np.ndarray:
    """Return the centre of weight [m] of a root and all bodies below it. Weight that `gravcomp` bears is left out."""
    mjm = home.model
    weight = np.where(mjm.body_rootid == root, mjm.body_mass * (1.0 - mjm.body_gravcomp), 0.0)
    if not mjm.body_gravcomp.any() or weight.sum() <= 0.0:
        return home.subtree_com[root].copy()
    return weight @ home.xipos / weight.sum()


def _off_interval(angle: np.ndarray, rounding: np.ndarray | float, drawn_as: DrawnOrientation) -> np.ndarray:
    """Return how far [rad] angles are outside the yaw interval, minus their rounding error [rad]."""
    low, high = drawn_as.yaw
    return np.abs(_wrapped(angle - (low + high) / 2)) - (high - low) / 2 - rounding


def _from_target(own: Outline, target: Outline) -> tuple[np.ndarray, np.ndarray]:
    """Return the angle [rad] from the direction towards the target to an object's front (-y), and the rounding error.

    If both pivots are at one point (possible with `points` as regions), any angle is right.
    """
    to = target.pivot[:, :2] - own.pivot[:, :2]
    apart = np.linalg.norm(to, axis=1)
    rounding = np.where(apart > _ONE_POINT, _ROUNDING / np.maximum(apart, _ROUNDING), np.pi)
    return own.heading - np.pi / 2 - np.arctan2(to[:, 1], to[:, 0]), rounding
