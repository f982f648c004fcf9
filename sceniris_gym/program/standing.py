"""Stances of free objects: their feet, the springs of MuJoCo's contacts below them, and what they carry."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

import mujoco
import numpy as np
import shapely
from shapely.geometry import MultiPoint, Polygon

from sceniris_gym.config.bounds import MAX_FOOT
from sceniris_gym.geometry.feet import around, curved_foot, flat_foot
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces
from sceniris_gym.geometry.resting_poses import ROCKING, HomeShape, StablePose, weights
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.geometry.supports import SupportSurface, section
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.device_statics import MOST_MOVE, RISE, ROLL
from sceniris_gym.program.loads import CONTACTS, contact_heights, contact_of, deepest, depth_of, tilt_of
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.resting import drawn_states, touch_distances
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree

# A piece whose top is as near as this [m] to the height of a surface is part of it.
_NEAR = 5.0e-4
# A foot with more corners than this is round.
_FEW_CORNERS = 8
# A foot or a surface with more corners than these, up to so many metres, loses some of its contacts.
_FOUR, _STRAIGHT = 4, 1.0e-4
# Share of the root of sink times height by which a load keeps from the edge of such a surface; see `Law`. In 26,400
# drops of boxes and prisms near its rim in MuJoCo C, with radii of 2 to 50 cm, those that fell needed up to 1 on 4
# corners, 1.6 on 8, 2.2 on a cylinder and 2.5 on 32.
_SWAP = 2.2
# A curved foot is one from which the object comes back as it leans by one of these angles [degrees]: a ball of facets
# needs the larger ones.
_LEANS = (ROCKING, 2.0 * ROCKING, 4.0 * ROCKING)
# The steadiness of what rolls on a support that may lean, or with contacts that are a little off: with a centre of mass
# that is nearer to the centre of curvature it is kicked as it is put down, and rolls for a second or more.
_STEADY = 0.1
_BALLS = {PieceType.SPHERE, PieceType.CAPSULE}
# Width [m] of the walls around a surface that a foot cannot reach over.
_WALL = 5.0e-3
# A load that moves the centre of mass of what carries it by less than this share of its margin does not tip it.
_LIGHT = 0.25
# A part of a foot with a smaller area [m^2] is an edge or a corner. MuJoCo finds depths of up to 46 mm between that and
# the end of a cylinder: 201 of 512 lemons on one were thrown off in MuJoCo C, none from the same shape as a mesh.
_EDGE = 1.0e-8
# Sine of the greatest inclination of an axis that is level.
_MAX_TILT = 1.0e-3


class Law(NamedTuple):
    """The margin that keeps a load from falling; `placement/standing.py` has the formula and its measurement.

    Attributes:
        shake: The margin as a share of the root of fall times height.
        lean: What each radian by which the load leans adds to that share.
        soft: What the lean is multiplied by.
        hold: The share of the radius of its patch in which contacts hold it, wherever around it MuJoCo keeps four.
        swap: What is added to the margin as four contacts give way to others, as a share of the root of sink times
            height.
        tip: The same as the foot rolls, as a share of height.
        steady: The least distance of the centre of mass below the centre of curvature, as a share of the radius.
    """

    shake: float
    lean: float
    soft: float
    hold: float
    swap: float = 0.0
    tip: float = 0.0
    steady: float = 0.0


FLAT, CURVED = Law(0.4, 0.0, 1.3, 1e3), Law(0.0, 0.0, 0.0, 1e3)
ROUND, OTHERS = Law(0.3, 20.0, 2.0, 0.7), Law(0.3, 20.0, 2.0, 1e3)
"""The laws of boxes on boxes or planes and of flat feet with a few corners on one convex geom; of curved feet, which
roll as they lean, and come back to where they were if the load is low enough; of round feet; and of all others.
Contacts of the last two change as they lean.

With them none of 19,168 worlds of 1,000 random scenes moved by 1 cm in half a second of MuJoCo C (`tests.stress.mixed`,
first scene 30000, seed 990).
"""


class Roll(NamedTuple):
    """The rectangle around a curved foot, seen from above around the pivot at heading 0. It says how the foot rolls.

    Attributes:
        center: Its centre [m], shape (2,).
        axis: Its first axis, shape (2,).
        reach: Half of its sides along that and across [m], shape (2,).
    """

    center: np.ndarray = np.zeros(2)
    axis: np.ndarray = np.zeros(2)
    reach: np.ndarray = np.zeros(2)


_NO_ROLL = Roll()
"""The rectangle of a flat foot."""


@dataclass(frozen=True)
class Foot:
    """The foot of an object in one of its stable poses, seen from above around its pivot at heading 0.

    Attributes:
        parts: Corners [m] of its convex parts; see `geometry.feet.foot`.
        law: The margin that the object needs on it.
        margin: Least distance [m] of the object's own centre of mass from the edge of its foot in the states that its
            joints are drawn in; negative outside, and -inf where draws of masses move it.
        most: The greatest one.
        bottom: Height [m] over the object's root of the lowest point that no drawn joint moves.
        hangs: How far [m] parts that drawn joints move reach below that at most; negative above.
        drop: Height [m] from which it falls until its support carries it; negative inside of that. It is 0 unless other
            geoms collide than it is placed by.
        roll: How it rolls, if it is curved.
    """

    parts: list[np.ndarray]
    law: Law
    margin: float
    most: float
    bottom: float = 0.0
    hangs: float = -np.inf
    drop: float = 0.0
    roll: Roll = _NO_ROLL


@dataclass(frozen=True)
class Stance:
    """The feet, contacts and levels of an object that has to stand.

    Attributes:
        levels: Itself, the free object that carries it, and so on down to one on what cannot move, as their numbers in
            `Plan.objects`.
        feet: Its foot in each of its stable poses; none if it does not collide with its support.
        load: The greatest weight [kg] of it and of all that is on it at a time.
        depth: The greatest depth to which it may sink into its support [m].
        touch: The distance from which on its support carries it [m]: 0 without contact margins.
        friction: The greatest coefficient of sliding friction between them, with the least that is drawn.
        is_whole: Whether all of its foot is on its support.
        is_belt: Whether a surface between them moves, as that of a belt.
        tilt: Tangent of the angle by which it may be pulled away from straight down.
        sinks: How deep its contacts are [m] under the greatest load with one object on it, by the number of that, and
            under `load`, by None, with the least masses that are drawn. For the test of standing: four contacts, with
            the softness of a friction of 1 or more.
    """

    levels: list[int]
    feet: list[Foot]
    load: float
    depth: float
    touch: float
    friction: float
    is_whole: bool
    is_belt: bool = False
    tilt: float = 0.0
    sinks: dict[int | None, float] = field(default_factory=dict)

    @property
    def sink(self) -> float:
        """Depth of its contacts [m] under `load`, 0 if it need not stand."""
        return self.sinks.get(None, 0.0)

    @property
    def is_certain(self) -> bool:
        """True if it stands wherever it is placed, so that only what is put on it needs a test."""
        is_alone = len(self.levels) < 2 and self.is_whole and not self.tilt
        return is_alone and all(f.margin > 0.0 for f in self.feet)


NO_STANCE = Stance([], [], 0.0, 0.0, 0.0, 0.0, is_whole=True)
"""The stance of what need not stand."""


def stances(scene: SceneModel, objects: list[PlacedObject], pieces: list[Piece]) -> list[Stance]:
    """Return how each object of a plan stands.

    Args:
        scene: The scene.
        objects: Its objects in placement order.
        pieces: All obstacles.
    """
    below = carriers_of(objects)
    loads = _loads(scene, objects, below)
    lean = tilt_of(scene, [o for o in objects if o.config.has_to_stand and o.heap is None])
    found: list[Stance] = []
    for number, (o, carrier) in enumerate(zip(objects, below, strict=True)):
        if not o.config.has_to_stand or o.heap is not None:
            found.append(NO_STANCE)
            continue
        stance = replace(_stance(scene, o, pieces, loads[number]), levels=[number], tilt=lean)
        if any(f.law.tip for f in stance.feet):  # it rolls as anything below leans, however little
            stance = replace(stance, levels=_down(number, below))
        elif carrier is not None and not _is_heavy(scene, objects[carrier], pieces, found[carrier]):
            stance = replace(stance, levels=[number, *found[carrier].levels])
        found.append(stance)
    return found


def _loads(scene: SceneModel, objects: list[PlacedObject], below: list[int | None]) -> list[dict[int | None, float]]:
    """Return the greatest weight [kg] of each object and of all that is on it at a time.

    The key None has the greatest of all worlds, the number of an object on it the greatest with that one there.
    """
    own = np.array([weights(scene.most)[o.bodies].sum() for o in objects])
    on: list[dict[str | None, list[int]]] = [{} for _ in objects]  # by the group that may leave some of them out
    for number, o in enumerate(objects):
        for level in _down(number, below):
            on[level].setdefault(scene.config.absent.get(o.name) if level != number else None, []).append(number)
    count = {label: group.count[1] for label, group in scene.config.groups.items()}

    def heaviest(stacked: dict[str | None, list[int]], there: int | None) -> float:
        ranked = {label: sorted(of, key=lambda n: (n != there, -own[n])) for label, of in stacked.items()}
        return float(sum(own[of[: count.get(str(label))]].sum() for label, of in ranked.items()))

    return [{n: heaviest(stacked, n) for n in (None, *chain(*stacked.values()))} for stacked in on]


def _down(number: int, below: list[int | None]) -> list[int]:
    """Return the numbers of an object and of all that carry it."""
    carrier = below[number]
    return [number, *([] if carrier is None else _down(carrier, below))]


def _is_heavy(scene: SceneModel, o: PlacedObject, pieces: list[Piece], stance: Stance) -> bool:
    """Return whether an object stands anywhere, and its weight keeps it where it is whatever is put on it."""
    mjm, home, joints = scene.mjm, scene.home, scene.moving_joints(o.name)
    # a joint may not carry things sideways; one that tilts them does no harm, as nothing is placed on what it turns up
    tilts = all(mjm.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE and abs(home.xaxis[j][2]) < _MAX_TILT for j in joints)
    shape = HomeShape(home, o.bodies[0], [p for p in pieces if p.body in o.bodies and p.mesh is not None])
    reach = np.linalg.norm(np.concatenate(shape.points()) - shape.center_of_mass, axis=1).max()
    above = stance.load - weights(scene.most)[o.bodies].sum()
    share = above / max(weights(scene.least)[o.bodies].sum() + above, mujoco.mjMINVAL)
    least = min((f.margin for f in stance.feet), default=0.0)
    return stance.is_certain and tilts and share * reach < _LIGHT * least


def carriers_of(objects: list[PlacedObject]) -> list[int | None]:
    """Return the number of the placed free object that carries each object, None where there is none."""
    free = {o.name: i for i, o in enumerate(objects) if o.kind == ObjectKind.FREE}
    return [None if o.support is None else free.get(str(o.support.owner)) for o in objects]


def _stance(scene: SceneModel, o: PlacedObject, pieces: list[Piece], loads: dict[int | None, float]) -> Stance:
    """Work out how one object stands under its loads; see `_loads`."""
    load, support, mjm = loads[None], o.support, scene.mjm
    assert support is not None
    drawn = [adr for adr, (low, high) in o.spans.items() if low < high]
    moved = {b for j in np.flatnonzero(np.isin(mjm.jnt_qposadr, drawn)) for b in subtree(mjm, int(mjm.jnt_bodyid[j]))}
    fixed, moving = ([p for p in pieces if p.body in of and p.mesh is not None] for of in ({*o.bodies} - moved, moved))
    if scene.config.geometry != "physics":  # visible pieces carry nothing
        pieces = extract_pieces(mjm, "physics", {*o.bodies, support.body})
    found = [p for p in pieces if p.body in o.bodies]
    touch = touch_distances(scene, found, support.body)
    own = [p for p, distance in zip(found, touch, strict=True) if distance is not None and p.mesh is not None]
    if not own:
        return NO_STANCE
    surfaces = [s for mine in o.surfaces for s in mine]
    there = [p for p in pieces if p.body == support.body]
    below = [
        p
        for p in there
        if support.geom in (None, p.geom)
        and (p.type == PieceType.PLANE or any(abs(p.bounds()[1][2] - s.height) < _NEAR for s in surfaces))
    ] or there
    walls = [p for p in there if p.contact_class in {b.contact_class for b in below}]
    parts = own, [p for p in own if p.body not in moved], fixed, moving
    states = drawn_states(scene, o) if o.joint_ranges else [scene.home]
    shapes = [[HomeShape(state, o.bodies[0], part) for part in parts] for state in states]
    tops = [p.pos[2] if p.type == PieceType.PLANE else p.bounds()[1][2] for p in there]
    lower = max((min((s.height - top for top in tops), key=abs) for s in surfaces), key=abs)
    contacts = [{contact_of(scene, a.geom, b.geom) for b in below} for a in own]
    every = set().union(*contacts)
    whole = support.is_floor or all(s.is_endless for s in surfaces) or o.config.ratio_on_support == 1.0
    are_boxes = {p.type for p in (*own, *below)} <= {PieceType.BOX, PieceType.PLANE}
    law = FLAT if are_boxes or len(own) == len(below) == 1 else OTHERS
    heavy = set(np.flatnonzero(scene.most.body_mass)) & set(o.bodies)
    fields = {draw.word.field for draw in scene.draws if heavy.intersection(draw.rows.tolist())}
    is_shifted = "body_ipos" in fields or ("body_mass" in fields and len(heavy) > 1)  # its centre of mass
    rims = [shapely.get_num_coordinates(s.outline.convex_hull.simplify(_STRAIGHT)) - 1 for s in surfaces]
    law = law if are_boxes or max(rims) <= _FOUR else OTHERS._replace(swap=_SWAP)
    # MuJoCo finds the exact point below the lowest one on a plane, and below the centre of a ball or a capsule on a box
    is_exact = {p.type for p in below} == {PieceType.PLANE} or {p.type for p in own} <= _BALLS
    steady = 0.0 if is_exact and not mjm.body_weldid[support.body] else _STEADY
    takes_edges = not any(p.type == PieceType.CYLINDER for p in below)
    feet = [_foot(shapes, v, law, lower, is_shifted, takes_edges, steady) for v in o.stable_poses]
    heights = [contact_heights(own, shapes[0][0], v) for v in o.stable_poses]
    rough, light = (c._replace(cone=max(c.cone, 1.0)) for c in every), scene.least.body_invweight0[:, 0]
    each = np.array(list(loads.values())) / CONTACTS
    deep = np.max([depth_of(scene, c, each, light[[c.own, c.below]].sum()) for c in rough], axis=0)
    is_whole = whole or _cannot_leave(o, feet, walls)
    return Stance(
        levels=[],
        feet=feet,
        load=load,
        depth=max(deepest(scene, contacts, at, o.bodies, load, is_whole) for at in heights),
        touch=max(distance for distance in touch if distance is not None),
        friction=max(c.friction for c in every),
        is_whole=is_whole,
        is_belt=bool(np.any(getattr(mjm, "geom_surfacevel", np.zeros(mjm.ngeom))[[p.geom for p in (*own, *below)]])),
        sinks=dict(zip(loads, deep.tolist(), strict=True)),
    )


def _foot(
    shapes: list[list[HomeShape]],
    pose: StablePose,
    law: Law,
    lower: float,
    is_shifted: bool,
    takes_edges: bool,
    steady: float,
) -> Foot:
    """Return the foot of an object in one of its poses, whose law is the given one unless the foot is round.

    Args:
        shapes: In each state of its joints: all that its support carries, the part of it that no drawn joint moves,
            which makes the foot, all that it is placed by and no drawn joint moves, and what they move.
        pose: The pose.
        law: The law.
        lower: Height [m] of the support that it is placed by over the support that it collides with.
        is_shifted: Whether draws of masses move its centre of mass.
        takes_edges: Whether the support carries edges and corners of pieces; otherwise no such foot holds.
        steady: What `Law.steady` is on a curved foot.
    """
    rotation, quat, (whole, standing, fixed, _) = matrix(pose.quat).T, pose.quat, shapes[0]
    shape = standing if standing.points() else whole
    ends = np.array([(own.center_of_mass - pose.pivot) @ rotation for own, *_ in shapes])
    parts = flat_foot([(points - pose.pivot) @ rotation for points in shape.points()])
    if len(parts) == 1 and len(parts[0]) > _FEW_CORNERS:
        law = ROUND
    elif any(len(part) > _FOUR for part in parts):
        law = law._replace(swap=_SWAP)
    if not takes_edges and any(MultiPoint(part).convex_hull.area < _EDGE for part in parts):
        law = law._replace(hold=0.0)
    bottom = fixed.bottom(quat) if standing.points() else np.inf
    hangs = max(bottom - moving.bottom(quat) for *_, moving in shapes)
    drop = whole.bottom(quat) - bottom + lower
    found = []
    curved = (_rolling(shape, pose, np.radians(a), steady) for a in _LEANS)
    for corners, its_law, roll in [(parts, law, _NO_ROLL)] if parts else curved:
        hull, at = MultiPoint(np.concatenate(corners)).convex_hull, shapely.points(ends[:, :2])
        margins = np.where(hull.contains(at), hull.boundary.distance(at), -hull.distance(at)) - its_law.tip * ends[:, 2]
        margins = margins if its_law.hold else np.full_like(margins, -np.inf)
        if its_law.tip:
            margins = np.minimum(margins, _spare(roll, its_law, ends))
        least = -np.inf if is_shifted else float(margins.min())
        found.append(Foot(corners, its_law, least, float(margins.max()), bottom, hangs, drop, roll))
    return next((f for f in found if f.margin > 0.0), max(found, key=lambda f: f.most))


def _rolling(shape: HomeShape, pose: StablePose, lean: float, steady: float) -> tuple[list[np.ndarray], Law, Roll]:
    """Return the curved foot of an object that is to come back from a lean [rad], its law, and how it rolls."""
    rotation = matrix(pose.quat)
    corners = curved_foot(lambda up: shape.lowest(up @ rotation) - up @ rotation @ pose.pivot, lean)
    box = shapely.get_coordinates(MultiPoint(corners).minimum_rotated_rectangle)[:3]
    sides = 0.5 * np.diff(box, axis=0)
    reach = np.linalg.norm(sides, axis=1)
    few = corners[(corners @ around(MAX_FOOT).T).argmax(axis=0)]
    law = CURVED._replace(tip=RISE * np.tan(0.5 * lean), steady=steady)
    return [few], law, Roll(box[0] + sides.sum(axis=0), sides[0] / reach[0], reach)


def _spare(roll: Roll, law: Law, ends: np.ndarray) -> np.ndarray:
    """Return by how much less [m] than it may an object with its centre of mass at each end, shape (n, 3), rolls."""
    tan, axes = law.tip / RISE, np.array([roll.axis, [-roll.axis[1], roll.axis[0]]])
    height = ends[:, 2:]
    rise = roll.reach - tan * height
    factor = 2.0 * height * tan / np.maximum(rise, 2.0 * height * roll.reach / ROLL)
    far = np.linalg.norm(factor * ((ends[:, :2] - roll.center) @ axes.T), axis=1)
    return np.minimum(MOST_MOVE - far, (rise - law.steady * roll.reach).min(axis=1))


def _cannot_leave(o: PlacedObject, feet: list[Foot], walls: list[Piece]) -> bool:
    """Return whether the foot lies on its support in any heading, as its region or walls keep it from the edge."""
    for surfaces, own in zip(o.surfaces, feet, strict=True):
        reach = np.linalg.norm(np.concatenate(own.parts), axis=1).max()
        parts = shapely.union_all([MultiPoint(part).convex_hull for part in own.parts])
        is_one = isinstance(parts.buffer(0.5 * _WALL), Polygon)  # no part of it is beyond a wall
        rise = o.config.gap + 2.0 * reach * np.tan(np.radians(ROCKING))
        for s in surfaces:
            inside = s.outline.contains(shapely.buffer(s.region, reach))
            if not inside and not (is_one and _is_walled(s, rise, walls)):
                return False
    return True


def _is_walled(surface: SupportSurface, height: float, walls: list[Piece]) -> bool:
    """Return whether walls stand all around a surface up to a height [m] above it."""
    ends = surface.height + _NEAR, surface.height + max(height, _NEAR)
    meshes = [p.mesh for p in walls if p.mesh is not None and p.mesh.is_convex]
    low, high = ([section(mesh, z) for mesh in meshes] for z in ends)
    solid = shapely.union_all(shapely.intersection(low, high))
    around, inside = (surface.outline.buffer(by, join_style="mitre") for by in (_WALL, 0.02 * _WALL))
    return solid.buffer(1e-5).covers(around.difference(inside))
