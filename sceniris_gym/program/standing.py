"""Stances of free objects: their feet, their depth in MuJoCo's soft contacts, and the loads on them."""

from collections.abc import Callable, Sequence
from itertools import chain
from typing import NamedTuple

import mujoco
import numpy as np
import shapely
from shapely.geometry import MultiPoint, Polygon

from sceniris_gym.config.bounds import MAX_FOOT
from sceniris_gym.geometry.feet import around, curved_foot, flat_foot
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces
from sceniris_gym.geometry.resting_poses import ROCKING, HomeShape, StablePose, of_heading_zero, weights
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.geometry.supports import SupportSurface, section
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.device_statics import MOST_MOVE, RISE, ROLL
from sceniris_gym.program.dropping import STILL, drop, moved, only
from sceniris_gym.program.loads import CONTACTS, contact_heights, contact_of, deepest, depth_of, tilt_of
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.resting import drawn_states, touch_distances
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree

# A piece is part of a surface if its top is within this distance [m] of the height of the surface.
_NEAR = 5.0e-4
# A foot with more corners than this is round.
_FEW_CORNERS = 8
# A foot or a surface with more corners than the first number loses some of its contacts. Outlines of surfaces are
# simplified to the second number [m] before their corners are counted.
_FOUR, _STRAIGHT = 4, 1.0e-4
# Margin of a load from the edge of such a surface, as a fraction of the root of sink times height (see `Law`). We
# dropped boxes and prisms near its rim in MuJoCo C 26,400 times, with radii of 2 to 50 cm. The objects that fell needed
# up to 1 on 4 corners, 1.6 on 8, 2.2 on a cylinder and 2.5 on 32.
_SWAP = 2.2
# From a curved foot, the object rights itself after it leans by one of these angles [degrees]. A ball of facets needs
# the larger angles.
_LEANS = (ROCKING, 2.0 * ROCKING, 4.0 * ROCKING)
# `Law.steady` of an object that rolls, if its support may lean or MuJoCo's contact points are not exact. With a centre
# of mass closer to the centre of curvature, the impact of placing makes the object roll for a second or more.
_STEADY = 0.1
_BALLS = {PieceType.SPHERE, PieceType.CAPSULE}
# A foot cannot reach over walls of this width [m] around a surface.
_WALL = 5.0e-3
# A load does not tip its carrier if it moves the carrier's centre of mass by less than this fraction of its margin.
_LIGHT = 0.25
# A part of a foot with a smaller area [m^2] is an edge or a corner. MuJoCo finds depths of up to 46 mm between such a
# part and the end of a cylinder: in MuJoCo C, 201 of 512 lemons were thrown off a cylinder, and 0 off the same shape as
# a mesh.
_EDGE = 1.0e-8
# An axis counts as level if its vertical part is smaller than this.
_MAX_TILT = 1.0e-3


class Law(NamedTuple):
    """Coefficients of the margin: how far a load's centre of mass has to be inside its patch so that the load stands.

    The docstring of `placement/standing.py` has the formula, and explains load, patch, fall and sink.

    Attributes:
        shake: Margin for the impact of the fall onto the support, divided by the root of fall times height.
        lean: Increase of `shake` for each radian of lean of the load.
        soft: Factor for the computed lean.
        hold: Fraction of the patch's radius. Within it, a load stands on any four contacts that MuJoCo may keep.
        swap: Additional margin while other contacts replace these four, divided by the root of sink times height.
        tip: Additional margin of a curved foot, divided by height.
        steady: Least distance of the centre of mass below the centre of curvature of a curved foot, divided by the
            foot's radius.
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
"""The margins of different feet.

- `FLAT`: boxes on boxes or planes, and flat feet with a few corners on one convex geom.
- `CURVED`: curved feet, which roll as they lean and roll back if the load is low enough.
- `ROUND`: round feet, whose contacts change as they lean.
- `OTHERS`: all other feet, whose contacts also change as they lean.

With these margins, the objects of 19,168 worlds of 1,000 random scenes all moved by less than 1 cm in half a second of
MuJoCo C (`tests.stress.mixed`, first scene 30000, seed 990).
"""


class Roll(NamedTuple):
    """The rectangle around a curved foot. The test of standing uses it to compute how far the object rolls.

    The rectangle is seen from above, relative to the object's pivot, for the object at heading 0.

    Attributes:
        center: Centre [m], shape (2,).
        axis: Unit vector along the first side, shape (2,).
        reach: Half of the length along `axis`, and half of the length across `axis` [m], shape (2,).
    """

    center: np.ndarray = np.zeros(2)
    axis: np.ndarray = np.zeros(2)
    reach: np.ndarray = np.zeros(2)


class Foot(NamedTuple):
    """The foot of an object in one of its stable poses: the part of the object that rests on the support.

    The foot is seen from above, relative to the object's pivot, for the object at heading 0.

    Attributes:
        parts: Corners [m] of its convex parts, as `geometry.feet.flat_foot` and `curved_foot` return them.
        law: Coefficients of the margin that the object needs on this foot.
        margin: How far [m] the object's centre of mass, without its load, is inside the edge of the foot: the least
            value over all drawn joint positions. Negative outside the foot, -inf if drawn masses move the centre.
        most: The greatest such distance [m] over all drawn joint positions.
        bottom: Height [m] over the object's root of the lowest point that drawn joints do not move.
        hangs: How far [m] drawn joints can move parts of the object below `bottom`. Negative if all stay above.
        drop: Height [m] of the fall of the object from its place onto the support. Negative if it is placed inside the
            support. 0 if the geoms used for placing also collide.
        roll: The rectangle of a curved foot, zeros for a flat foot.
    """

    parts: list[np.ndarray]
    law: Law
    margin: float
    most: float
    bottom: float = 0.0
    hangs: float = -np.inf
    drop: float = 0.0
    roll: Roll = Roll()


class Stance(NamedTuple):
    """The feet and contacts of an object that has to stand, and the stack below it.

    Attributes:
        levels: The stack as numbers in `Plan.objects`: the object, the free object that carries it, and so on down to
            a free object on a support that stays in place. Empty if the object does not have to stand.
        feet: Its foot in each of its stable poses, empty if it does not collide with its support.
        load: Greatest simultaneous weight [kg] of the object and everything on it.
        depth: Greatest depth of the object in its support [m].
        touch: Distance at which its support begins to carry it [m], 0 without contact margins.
        friction: Least drawn coefficient of sliding friction, in the contact that has the most friction.
        is_whole: Whether its whole foot is always on its support.
        sinks: Depths [m] of the object in its support at the least drawn masses, for the test of standing. For the key
            None, the depth under `load`. For the number of an object above it, the depth under the greatest load that
            includes this object above. Each depth assumes four contacts, as soft as a friction of 1 or more makes them.
        is_belt: Whether a geom of the object or of its support has a `surfacevel`, which moves the object like a belt.
        tilt: Tangent of the greatest angle between straight down and the pull of gravity and wind.
    """

    levels: list[int]
    feet: list[Foot]
    load: float
    depth: float
    touch: float
    friction: float
    is_whole: bool
    sinks: dict[int | None, float]
    is_belt: bool = False
    tilt: float = 0.0

    @property
    def is_certain(self) -> bool:
        """True if the object stands wherever it is placed. Only objects on top of it then need the test of standing."""
        return len(self.levels) < 2 and self.is_whole and not self.tilt and all(f.margin > 0.0 for f in self.feet)


NO_STANCE = Stance([], [], 0.0, 0.0, 0.0, 0.0, is_whole=True, sinks={})
"""The stance of an object that does not have to stand."""


def stances(scene: SceneModel, objects: list[PlacedObject], pieces: list[Piece]) -> list[Stance]:
    """Return the stance of each object of a plan: its foot, contacts and loads.

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
        stance = _stance(scene, o, pieces, loads[number])._replace(levels=[number], tilt=lean)
        if any(f.law.tip for f in stance.feet):  # it rolls if any object below leans, however little
            stance = stance._replace(levels=chain_below(number, below))
        elif carrier is not None and not _is_heavy(scene, objects[carrier], pieces, found[carrier]):
            stance = stance._replace(levels=[number, *found[carrier].levels])
        found.append(stance)
    return found


def _loads(scene: SceneModel, objects: list[PlacedObject], below: list[int | None]) -> list[dict[int | None, float]]:
    """Return the greatest simultaneous weight [kg] of each object and everything on it.

    The result has a dict for each object. Under the key None, it has the maximum over all worlds. Under the number of
    another object, it has the maximum over the worlds where that other object is present.
    """
    own = np.array([weights(scene.most)[o.bodies].sum() for o in objects])
    on: list[dict[str | None, list[int]]] = [{} for _ in objects]  # by group: a world may omit some of its members
    for number, o in enumerate(objects):
        for level in chain_below(number, below):
            on[level].setdefault(scene.config.absent.get(o.name) if level != number else None, []).append(number)
    count = {key: group.count[1] for key, group in scene.config.presence.groups.items()}

    def heaviest(stacked: dict[str | None, list[int]], there: int | None) -> float:
        ranked = {label: sorted(of, key=lambda n: (n != there, -own[n])) for label, of in stacked.items()}
        return float(sum(own[of[: count.get(str(label))]].sum() for label, of in ranked.items()))

    return [{n: heaviest(stacked, n) for n in (None, *chain(*stacked.values()))} for stacked in on]


def chain_below(number: int, carriers: Sequence[int | None]) -> list[int]:
    """Return the number of an object, then of its carrier, of the carrier's carrier, and so on downwards."""
    carrier = carriers[number]
    return [number, *([] if carrier is None else chain_below(carrier, carriers))]


def _is_heavy(scene: SceneModel, o: PlacedObject, pieces: list[Piece], stance: Stance) -> bool:
    """Return whether an object stands wherever it is placed, and is too heavy for its loads to tip it."""
    mjm, home, joints = scene.mjm, scene.home, scene.moving_joints(o.name)
    # A joint must not move its load sideways. A joint that tilts does no harm, as a tilted surface is not a support.
    tilts = all(mjm.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE and abs(home.xaxis[j][2]) < _MAX_TILT for j in joints)
    shape = HomeShape(home, o.bodies[0], [p for p in pieces if p.body in o.bodies and p.mesh is not None])
    reach = np.linalg.norm(np.concatenate(shape.points()) - shape.center_of_mass, axis=1).max()
    above = stance.load - weights(scene.most)[o.bodies].sum()
    share = above / max(weights(scene.least)[o.bodies].sum() + above, mujoco.mjMINVAL)
    least = min((f.margin for f in stance.feet), default=0.0)
    return stance.is_certain and tilts and share * reach < _LIGHT * least


def carriers_of(objects: list[PlacedObject]) -> list[int | None]:
    """For each object, return the number of the placed free object that carries it, or None."""
    free = {o.name: i for i, o in enumerate(objects) if o.kind == ObjectKind.FREE}
    return [None if o.support is None else free.get(str(o.support.owner)) for o in objects]


def _stance(scene: SceneModel, o: PlacedObject, pieces: list[Piece], loads: dict[int | None, float]) -> Stance:
    """Return the stance of one object. `loads` is the object's dict from `_loads`."""
    load, support, mjm = loads[None], o.support, scene.mjm
    assert support is not None
    drawn = [adr for adr, (low, high) in o.spans.items() if low < high]
    moved = {b for j in np.flatnonzero(np.isin(mjm.jnt_qposadr, drawn)) for b in subtree(mjm, int(mjm.jnt_bodyid[j]))}
    bodies = {*o.bodies, support.body}
    pieces = [p for p in pieces if p.body in bodies]
    fixed, moving = ([p for p in pieces if p.body in of and p.mesh is not None] for of in ({*o.bodies} - moved, moved))
    if scene.config.geometry != "physics":  # visible pieces do not collide, so they carry no load
        pieces = extract_pieces(mjm, "physics", bodies)
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
        and (p.type == PieceType.PLANE or any(abs(p.bounds[1][2] - s.height) < _NEAR for s in surfaces))
    ] or there
    walls = [p for p in there if p.contact_class in {b.contact_class for b in below}]
    parts = own, [p for p in own if p.body not in moved], fixed, moving
    states = drawn_states(scene, o) if o.joint_ranges else [scene.home]
    shapes = [[HomeShape(state, o.bodies[0], part) for part in parts] for state in states]
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
    # MuJoCo's contact is exact below the lowest point on a plane, and below the centre of a ball or a capsule on a box
    is_exact = {p.type for p in below} == {PieceType.PLANE} or {p.type for p in own} <= _BALLS
    steady = 0.0 if is_exact and not mjm.body_weldid[support.body] else _STEADY
    takes_edges = not any(p.type == PieceType.CYLINDER for p in below)

    def foot_in(pose: StablePose) -> Foot:
        return _foot(shapes, pose, law, is_shifted, takes_edges, steady)

    feet = [foot_in(v) for v in o.stable_poses]
    # it may rock to rest if nothing stands on it, its support cannot move, and no part of it is beyond the edge
    is_firm = whole and len(loads) == 2 and not (o.joint_ranges or mjm.body_weldid[support.body])
    begins = max(distance for distance in touch if distance is not None)
    if is_firm and max(f.most for f in feet) <= 0.0:
        feet = [_at_rest(scene, o, i, f, begins, foot_in) for i, f in enumerate(feet)]
    # the surface used for placing may be higher than the top of the support's colliding geoms
    tops = [p.pos[2] if p.type == PieceType.PLANE else p.bounds[1][2] for p in there]
    lower = max((min((s.height - top for top in tops), key=abs) for s in surfaces), key=abs)
    feet = [f._replace(drop=f.drop + lower) for f in feet]  # pyrefly: ignore[unsupported-operation]
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
        touch=begins,
        friction=max(c.friction for c in every),
        is_whole=is_whole,
        is_belt=bool(np.any(getattr(mjm, "geom_surfacevel", np.zeros(mjm.ngeom))[[p.geom for p in (*own, *below)]])),
        sinks=dict(zip(loads, deep.tolist(), strict=True)),
    )


def _foot(
    shapes: list[list[HomeShape]], pose: StablePose, law: Law, is_shifted: bool, takes_edges: bool, steady: float
) -> Foot:
    """Return the foot of an object in one of its poses.

    Args:
        shapes: For each state of the drawn joints, four shapes of the object. The first has all pieces that the support
            carries. The second has only the carried pieces that drawn joints do not move, and forms the foot. The third
            and the fourth have the pieces used for placing: pieces that drawn joints do not move, and pieces that they
            move.
        pose: The pose.
        law: The `Law` of the foot if it is neither round nor curved.
        is_shifted: Whether draws of masses move the object's centre of mass.
        takes_edges: Whether the support carries edges and corners of pieces. If not, a foot with edges or corners does
            not hold the object.
        steady: `Law.steady` of a curved foot.
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
    drop = whole.bottom(quat) - bottom
    found = []
    curved = (_rolling(shape, pose, np.radians(a), steady) for a in _LEANS)
    for corners, its_law, roll in [(parts, law, Roll())] if parts else curved:
        hull, at = MultiPoint(np.concatenate(corners)).convex_hull, shapely.points(ends[:, :2])
        margins = np.where(hull.contains(at), hull.boundary.distance(at), -hull.distance(at)) - its_law.tip * ends[:, 2]
        margins = margins if its_law.hold else np.full_like(margins, -np.inf)
        if its_law.tip:
            margins = np.minimum(margins, _spare(roll, its_law, ends))
        least = -np.inf if is_shifted else float(margins.min())
        found.append(Foot(corners, its_law, least, float(margins.max()), bottom, hangs, drop, roll))
    return next((f for f in found if f.margin > 0.0), max(found, key=lambda f: f.most))


def _at_rest(
    scene: SceneModel, o: PlacedObject, i: int, foot: Foot, touch: float, foot_in: Callable[[StablePose], Foot]
) -> Foot:
    """Return the foot of an object after it has rocked to rest, or `foot` if it then falls or has moved too far.

    Args:
        scene: The scene.
        o: The object.
        i: Number of its stable pose.
        foot: Its foot in this pose.
        touch: Distance [m] at which its support begins to carry it.
        foot_in: Returns its foot in a pose.
    """
    poses = drop(only(scene.mjm, o), scene, o, i, touch - foot.bottom, {})
    center = HomeShape(scene.home, o.bodies[0], []).center_of_mass
    rest = foot_in(o.stable_poses[i]._replace(quat=of_heading_zero(matrix(poses[1][3:]))))
    far = o.config.gap + max(moved(*poses, at) for at in (np.zeros(3), center))
    if far > STILL or rest.margin <= 0.0:
        return foot
    return rest._replace(bottom=foot.bottom, hangs=foot.hangs, drop=foot.drop)


def _rolling(shape: HomeShape, pose: StablePose, lean: float, steady: float) -> tuple[list[np.ndarray], Law, Roll]:
    """Return the curved foot of an object that rolls back after it leans, the foot's `Law`, and its rectangle.

    Args:
        shape: The pieces that the support carries.
        pose: The stable pose.
        lean: Lean of the object [rad]. A greater angle gives a larger foot.
        steady: `Law.steady` of the result.
    """
    rotation = matrix(pose.quat)
    corners = curved_foot(lambda up: shape.lowest(up @ rotation) - up @ rotation @ pose.pivot, lean)
    box = shapely.get_coordinates(MultiPoint(corners).minimum_rotated_rectangle)[:3]
    sides = 0.5 * np.diff(box, axis=0)
    reach = np.linalg.norm(sides, axis=1)
    few = corners[(corners @ around(MAX_FOOT).T).argmax(axis=0)]
    law = CURVED._replace(tip=RISE * np.tan(0.5 * lean), steady=steady)
    return [few], law, Roll(box[0] + sides.sum(axis=0), sides[0] / reach[0], reach)


def _spare(roll: Roll, law: Law, ends: np.ndarray) -> np.ndarray:
    """Return by how much [m] the roll of an object on a curved foot is below the limit. Negative if it rolls too far.

    Args:
        roll: The rectangle around the curved foot.
        law: The `Law` of this foot.
        ends: Position of the object's centre of mass relative to its pivot [m] in each state of its drawn joints, shape
            (n, 3).

    Returns:
        Shape (n,).
    """
    tan, axes = law.tip / RISE, np.array([roll.axis, [-roll.axis[1], roll.axis[0]]])
    height = ends[:, 2:]
    rise = roll.reach - tan * height
    factor = 2.0 * height * tan / np.maximum(rise, 2.0 * height * roll.reach / ROLL)
    far = np.linalg.norm(factor * ((ends[:, :2] - roll.center) @ axes.T), axis=1)
    return np.minimum(MOST_MOVE - far, (rise - law.steady * roll.reach).min(axis=1))


def _cannot_leave(o: PlacedObject, feet: list[Foot], walls: list[Piece]) -> bool:
    """Return whether the whole foot of an object is on its support at every place and heading.

    Either its region keeps the foot away from the edges of the surface, or walls stand all around the surface.

    Args:
        o: The object.
        feet: Its foot in each of its stable poses.
        walls: The pieces of the support that may be such walls.
    """
    for surfaces, own in zip(o.surfaces, feet, strict=True):
        reach = np.linalg.norm(np.concatenate(own.parts), axis=1).max()
        parts = shapely.union_all([MultiPoint(part).convex_hull for part in own.parts])
        is_one = isinstance(parts.buffer(0.5 * _WALL), Polygon)  # a foot in one part cannot continue beyond a wall
        rise = o.config.gap + 2.0 * reach * np.tan(np.radians(ROCKING))
        for s in surfaces:
            inside = s.outline.contains(shapely.buffer(s.region, reach))
            if not inside and not (is_one and _is_walled(s, rise, walls)):
                return False
    return True


def _is_walled(surface: SupportSurface, height: float, walls: list[Piece]) -> bool:
    """Return whether the pieces `walls` enclose a surface and rise at least `height` [m] above it."""
    meshes = [p.mesh for p in walls if p.mesh is not None and p.mesh.is_convex]
    ends = (-_NEAR, _NEAR, max(height, _NEAR))
    floor, low, high = ([section(mesh, surface.height + z) for mesh in meshes] for z in ends)
    solid = shapely.union_all(shapely.intersection(low, high)).buffer(1e-5)
    # The outline of a visible surface may end before the walls. The pieces that collide then carry the foot up to them.
    room = surface.outline.union(surface.outline.buffer(_WALL, join_style="mitre").difference(solid))
    around, inside = (room.buffer(by, join_style="mitre") for by in (_WALL, 0.02 * _WALL))
    ground = shapely.union_all([surface.outline, *floor]).buffer(1e-5)
    return ground.covers(room) and solid.covers(around.difference(inside))
