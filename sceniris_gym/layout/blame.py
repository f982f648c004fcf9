"""Explain rejected candidates by their colliding geoms, and make the error for a scene without a valid layout."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import mujoco
import numpy as np

from sceniris_gym.collide.leaves import SKIN
from sceniris_gym.config.member_names import split_support
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.geometry.colliders import collect_colliders
from sceniris_gym.geometry.supports import COS_MAX_TILT
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import allocate_record
from sceniris_gym.layout.tables import read_rejected
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause
from sceniris_gym.program.pack.home_touch import HomeTouch
from sceniris_gym.program.pack.pairs import Pair, PairRules, collider_pairs
from sceniris_gym.program.placed_object import PlacedObject

# Recorded candidates per world, enough for most objects to appear in the record.
_RECORDED = 8
_LOOKED_AT = 48  # at most this many recorded candidates of one object
_UNDECIDED = 1.0e-6  # [m] beyond margin and skin: geoms at this distance may still have been rejected
# From this number of placed objects on, a full support is called too small.
_CROWD = 5
# Causes that only occur after all objects are placed.
_LATE = tuple(cause.name.lower() for cause in (Cause.NO_IK, Cause.BLOCKED, Cause.NO_PATH))
AT_ONCE = (Cause.EMPTY, Cause.REGION, Cause.NO_IK, Cause.BLOCKED, Cause.NO_PATH, Cause.UNSOUND)
"""Causes that end a layout without further attempts."""
_PLAIN = "Give the object a larger region or support, a smaller clearance, or fewer neighbours."
_MOST_NAMED = 3  # objects of a message
_CLOSER = "Place the object closer to the robot, turn it towards the robot, or use a less strict tier of 'reachable'."
_REMEDIES = {
    "overhead": "'on' requires open space above, and 'inside' a part of the support above. Use 'in' to accept both.",
    "unsound": "Layouts had non-finite numbers, or numbers out of all bounds. Look for such numbers in the model.",
    "falls": "Narrow the ranges of its 'mass' or 'ipos', give it a wider support or a region further from the edge, or "
    "write 'stands: false' if it may fall.",
    **dict.fromkeys(("unreachable", "no_ik", "blocked"), _CLOSER),
    "no_path": "Keep the robot's start pose further from other geoms than the object's 'margin'. " + _CLOSER,
}


class Hit(NamedTuple):
    """Two geoms that are too close to each other.

    Attributes:
        geoms: Ids of the geoms. The first geom belongs to the placed object.
        names: Names of the geoms and their bodies.
        distance: Distance of the geoms [m], negative if they overlap.
        margin: The least allowed distance [m]. It is negative if the geoms overlap in the home pose, because they may
            then overlap as deeply in a layout.
    """

    geoms: tuple[int, int]
    names: str
    distance: float
    margin: float

    def __str__(self) -> str:
        return f"{self.names} ({_gap(self.distance, self.margin)})"


class Blame:
    """Finds the colliding geoms of candidates of a compiled scene, one candidate at a time.

    MuJoCo C computes the distances of collision geoms, even in scenes with `geometry: visual`. Only for two geoms that
    overlap in the home pose, the class `HomeTouch` measures the distance, as it does in the home pose.
    """

    def __init__(self, compiled: CompiledScene) -> None:
        plan = compiled.plan
        colliders = collect_colliders(plan.pieces, compiled.config.geometry == "visual", compiled.device)
        rules = PairRules(compiled.scene, colliders)
        self._mjm, self._written = compiled.mjm, compiled.config.written
        self._pieces = {piece.geom: piece for piece in plan.pieces}
        pairs = zip(plan.objects, collider_pairs(plan, rules), strict=True)
        self._margins = [_geom_margins(rules, o.ground, own) for o, own in pairs]

    def hits(self, data: mujoco.MjData, number: int) -> list[Hit]:
        """Return the pairs of geoms that cause the rejection of a candidate, the worst first.

        Args:
            data: State of the world with the candidate, with up-to-date kinematics.
            number: Index of the candidate's object in placement order. Later objects are ignored.
        """
        depths, found = HomeTouch(self._mjm, data), []
        for geoms, margin in self._margins[number].items():
            distance = self._distance(data, depths, geoms, margin)
            if distance is not None:
                names = " and ".join(map(self._name, geoms))
                found.append(Hit(geoms, names, distance, margin))
        return sorted(found, key=lambda hit: hit.distance - hit.margin)

    def _name(self, geom: int) -> str:
        """Return a text with the names of a geom and its body, as the scene file has them."""
        body = self._mjm.body(int(self._mjm.geom_bodyid[geom])).name
        return f"geom '{self._written(self._mjm.geom(geom).name or str(geom))}' of body '{self._written(body)}'"

    def _distance(self, data: mujoco.MjData, depths: HomeTouch, geoms: tuple[int, int], margin: float) -> float | None:
        """Return the distance of two geoms [m], or None if they are far enough apart."""
        mjm, (a, b), nearest = self._mjm, geoms, margin + SKIN + _UNDECIDED
        if margin < 0.0:
            touch = depths.between(self._pieces[a], self._pieces[b], nearest)
            return None if touch is None else touch.distance
        reach = mjm.geom_rbound[a] + mjm.geom_rbound[b] + margin
        bounded = mjm.geom_rbound[a] > 0.0 and mjm.geom_rbound[b] > 0.0  # planes have no bounding sphere
        if bounded and np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b]) > reach:
            return None
        distance = mujoco.mj_geomDistance(mjm, data, a, b, margin + 1e-3, None)
        return distance if distance <= nearest else None


def recording(generator: LayoutGenerator) -> LayoutGenerator:
    """Make a generator record the first candidates that collide, and return the generator.

    Call this before the first launch of the generator. Unlike in `LayoutGenerator._recording`, restarts still run in
    parallel. The record may therefore have candidates of restarts that were not needed.
    """
    allocate_record(generator.layouts.view, _RECORDED * generator.nworld)
    return generator


def obstructions(generator: LayoutGenerator) -> dict[str, str]:
    """For each object with recorded collisions, describe the pair of geoms that collides most often.

    The result maps each object's name to a text. The text gives the names of the two geoms, their mean distance, and
    the fraction of the object's collisions in which they collide, and the sizes of the object and its region.

    Args:
        generator: A generator that has recorded candidates. See `recording`.
    """
    rejected, found = read_rejected(generator), {}
    collided = np.flatnonzero(rejected.causes == Cause.COLLISION)
    if not len(collided):
        return {}
    blame, data = Blame(generator.compiled), mujoco.MjData(generator.compiled.mjm)
    for number in np.unique(rejected.objects[collided]).tolist():
        rows = collided[rejected.objects[collided] == number][:_LOOKED_AT]
        hits: defaultdict[tuple[int, int], list[Hit]] = defaultdict(list)
        for row in rows.tolist():
            rejected.states.put(data, row)
            mujoco.mj_kinematics(data.model, data)
            for hit in blame.hits(data, number):
                hits[hit.geoms].append(hit)
        if hits:
            most = max(hits.values(), key=len)
            gap = _gap(float(np.mean([hit.distance for hit in most])), most[0].margin, " on average")
            share = f"{len(most) / len(rows):.0%} of collisions"
            one = generator.compiled.plan.objects[number]
            found[one.name] = f"{most[0].names} ({gap}; {share}{_sizes(one)})"
    return found


def _sizes(one: PlacedObject) -> str:
    """Return the end of a text with the widths of an object and of its region, seen from above, if it has a region."""
    areas = [surface.region.bounds for surface in (one.surfaces[0] if one.surfaces else ())]
    if not areas:
        return ""
    (low, high), bounds = (np.stack(areas)[:, i : i + 2] for i in (0, 2)), one.stable_poses[0].bounds
    sizes = (bounds[2:] - bounds[:2], high.max(axis=0) - low.min(axis=0))
    own, region = (" x ".join(f"{100.0 * length:.3g}" for length in size) for size in sizes)
    return f"; '{one.name}' is {own} cm wide, its region {region} cm"


def infeasible(compiled: CompiledScene, probe: LayoutGenerator, key: str = "") -> InfeasibleSceneError:
    """Return the error for a scene without a valid layout. The error names the object that could not be placed.

    The named object is the least likely to be placed, see `_least_likely`.

    Args:
        compiled: The scene.
        probe: A generator that has recorded candidates and made no valid layout. See `recording`.
        key: Text after the scene's name in the message, such as ": start.1". It names the variant, group member or kind
            of start that all tried layouts had.
    """
    counts = probe.rejection_counts()
    if not any(any(causes.values()) for causes in counts.values()):
        return _never_drawn(compiled, probe, key)
    (name, cause), ways = _least_likely(counts, compiled.attempts), obstructions(probe)
    part, way = compiled.config.parts.get(name), ways.get(name)
    if cause == Cause.EMPTY.name.lower() and (leaning := _leaning_support(compiled, probe, name)) is not None:
        orientation = compiled.config.objects[split_support(leaning, compiled.config.objects)[0]].drawn_orientation.kind
        remedy = _of_leaning(leaning, orientation)
    elif cause == Cause.COLLISION.name.lower():
        remedy = _of_collision(_room(compiled, name), None if part is None else part.joined_to)
    else:
        remedy = _REMEDIES.get(cause, _PLAIN)
    if remedy == _PLAIN and part is not None and part.relations:
        named = " and ".join(f"'{relation.summary}'" for relation in part.relations)
        remedy = f"It has to be {named}. Widen or remove a relation, or give the object a larger region or support."
    remedy = " Or choose ".join((remedy, *(f"{cure}." for cure in of_starts(compiled.config, name, cause))))
    where = compiled.config.where + key
    return InfeasibleSceneError(
        f"{where}: no valid layout was found: '{name}' could not be placed, mostly because of {cause}. "
        f"{'' if way is None else f'Most often in its way: {way}. '}Rejections: {_rejections(counts)}. {remedy}",
        where,
        name,
        cause,
        counts,
        ways,
    )


def of_starts(config: SceneConfig, name: str, cause: str) -> tuple[str, ...]:
    """Return the advice about the kinds of `start` that take an arm to an object, if they may cause its rejections."""
    kinds = [f"start.{i}" for i, kind in enumerate(config.start) if name in kind.targets(config.variants)]
    only = f"which accept only grasps that hold '{name}' without collisions"
    return (f"other grasps or a lower 'lift' in {', '.join(kinds)}, {only}",) if kinds and cause in _LATE else ()


def ended_restarts(cause: str, rejections: int, attempts: int) -> float:
    """Return the number of restarts that rejections end: one for each, or for `attempts` of them, by their cause."""
    return rejections if Cause[cause.upper()] in AT_ONCE else rejections / attempts


def _least_likely(counts: dict[str, dict[str, int]], attempts: int) -> tuple[str, str]:
    """Return the object that is least likely to be placed, and the cause of most of its failures.

    A restart that failed at one object had a place for each object before it. From these failures and successes follows
    an object's probability of success, by Laplace's rule of succession. So an object is not blamed if only a few
    restarts came as far as this object. The stages after placing come last.

    Args:
        counts: Rejected candidates by object, in placement order, and cause, when no layout was found.
        attempts: Number of rejections that end a restart, unless their cause ends it at once.
    """
    placed, found = 0.0, []
    for late in (True, False):
        for name, causes in reversed(counts.items()):
            own = [cause for cause in causes if (cause in _LATE) is late]
            failed = {cause: ended_restarts(cause, causes[cause], attempts) for cause in own}
            if failures := sum(failed.values()):
                found.append(((placed + 1.0) / (placed + failures + 2.0), name, max(failed, key=failed.__getitem__)))
                placed += failures
    return min(found)[1:]


def _never_drawn(compiled: CompiledScene, probe: LayoutGenerator, key: str) -> InfeasibleSceneError:
    """Return the error for an object that no drawn layout had, although all of them are valid."""
    where = compiled.config.where + key
    text = (
        f"{where}: no valid layout has it, because its conditions exclude each other, or almost. Change its 'if', "
        "its 'unless', its support or its groups."
    )
    return InfeasibleSceneError(text, where, key.rpartition(".")[2], "absent", probe.rejection_counts(), {})


def _rejections(counts: Mapping[str, Mapping[str, int]]) -> str:
    """Return a text with the objects that have the most rejections, and the number of their rejections by cause."""
    rejected = {obj: sum(by_cause.values()) for obj, by_cause in counts.items() if any(by_cause.values())}
    worst = sorted(rejected, key=rejected.__getitem__)[-_MOST_NAMED:]
    rows = [f"{obj}: " + ", ".join(f"{c} {n}" for c, n in counts[obj].items() if n) for obj in rejected if obj in worst]
    if len(rejected) > len(worst):
        rows.append(f"and {len(rejected) - len(worst)} other objects less often")
    return "; ".join(rows)


def _of_leaning(support: str, orientation: str) -> str:
    """Return the advice for a support that leans in most worlds.

    The support is a part of another object, such as a drawer of a cabinet. `orientation` is the kind of orientation of
    this other object (here the cabinet).
    """
    better = "Restrict the joints that move this support to states in which it is level."
    if orientation in ("any", "stable"):
        owner = support.split("/")[0]
        better = f"Keep '{owner}' upright: give it a yaw or 'fixed' instead of 'orientation: {orientation}'."
    return (
        f"The object's support '{support}' leans by more than 0.1 degree in most of the drawn states, but objects are "
        f"placed on level surfaces only. {better}"
    )


def _of_collision(room: str | None, joined: str | None) -> str:
    """Return the advice for an object that collides.

    Args:
        room: The advice of `_room`, or None if the support of the object is not full.
        joined: Name of the object to which the colliding object is joined, or None if it is not joined.
    """
    if joined is None:
        return room or _PLAIN
    return (
        f"The object is joined to '{joined}': give 'beside' a 'gap' of a few millimetres, or move the sites away from "
        "both objects by this distance. The objects then keep their 'clearance'."
    )


def _room(compiled: CompiledScene, name: str) -> str | None:
    """Return the advice if an object's support is full before all of the support's objects are placed, otherwise None.

    If equal objects are placed at random, one after another, the fraction of a large area that they fill does not
    depend on the size of the area (random sequential adsorption, Feder 1980). The required area is therefore
    proportional to the number of objects. The number of placed objects comes from the best of many worlds. The advice
    names twice the required area, which is enough for most of the other worlds.
    """
    (one,) = (o for o in compiled.plan.objects if o.name == name)
    same = [o.name for o in compiled.plan.objects if o.support is not None and o.support == one.support]
    owners = compiled.config.owners
    crowd = list(dict.fromkeys(owners.get(other, other) for other in same))  # one variant of an object is there
    placed = crowd.index(owners.get(name, name)) if name in same else 0
    if placed < _CROWD:
        return None
    area = sum(surface.outline.area for surface in one.surfaces[0])
    assert one.config.support is not None
    return (
        f"The {area:.3g} m2 of '{one.config.support.parent}' were full after {placed} of its {len(crowd)} objects. "
        f"Use a support of about {2.0 * area * len(crowd) / placed:.2g} m2, or fewer objects."
    )


def _leaning_support(compiled: CompiledScene, probe: LayoutGenerator, name: str) -> str | None:
    """Return the name of an object's support if this support leans in most worlds, otherwise None.

    The last state of each world counts.
    """
    ground = int(compiled.program.obj_ground.numpy()[compiled.placed.index(name)])
    part = compiled.config.parts.get(name)
    if ground < 0 or part is None or part.support is None:
        return None
    x, y = probe.layouts.view.body_quat.numpy()[:, ground, 1:3].T
    leans = 1.0 - 2.0 * (x * x + y * y) < COS_MAX_TILT  # the z component of the body's z axis
    return part.support.parent if leans.mean() > 0.5 else None


def _geom_margins(rules: PairRules, ground: int | None, pairs: Sequence[Pair]) -> dict[tuple[int, int], float]:
    """Return the least allowed distance [m] of each pair of geoms that is tested for one placed object.

    Args:
        rules: Rules of the pairs.
        ground: Body that supports the object, or None.
        pairs: The tested pairs of the object.
    """
    found: dict[tuple[int, int], float] = {}
    for pair in pairs:
        stands = ground is not None and rules.colliders[pair.b].body == ground
        margin = rules.touch(pair.a, pair.b) if stands else pair.margin
        geoms = product(rules.geoms(pair.a), rules.geoms(pair.b)) if pair.geoms is None else [pair.geoms]
        found |= dict.fromkeys(geoms, margin)  # pairs that touch at home come later, and override their bodies' pairs
    return found


def _gap(distance: float, margin: float, average: str = "") -> str:
    """Return a text with the distance of two geoms and the least allowed distance."""
    gap = f"{1e3 * abs(distance):.3g} mm {'deep' if distance < 0.0 else 'apart'}{average}"
    rule = "deep is allowed, as at home" if margin < 0.0 else "apart is required"
    return f"{gap}, {1e3 * abs(margin):.3g} mm {rule}"
