"""Pairs of colliders to keep apart, with their margins, for each placed object and for an arm that grasps a target.

Two geoms of one object may already touch in the start pose. With `geometry: physics`, drawn joints may not bring them
closer, or deeper into each other, than in the start pose. All other geoms of their bodies are kept apart. Depth is not
defined for visual geometry, so colliders that touch in the start pose are not tested against each other.
"""

from collections.abc import Container, Iterable
from dataclasses import dataclass, field, replace
from itertools import product

import mujoco
import numpy as np

from sceniris_gym.geometry.colliders import Collider
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.grasping.gripper import carried
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.pack.descent import Trees
from sceniris_gym.program.pack.home_touch import HomeTouch
from sceniris_gym.program.plan import Plan
from sceniris_gym.progress import tell
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import is_static

# Geoms that are closer at home than this [m] touch. Comparisons of distances have a skin of half of this.
_NEAR = 1.0e-5
# Geoms that touch at home may come closer by this [m]. The skin takes half of it, the other half is for rounding.
_DEEPER = 1.0e-5
_NO_DIRECTIONS = np.zeros((0, 3))
# Least distance [m] between a held object and all other bodies: arms sag, and held objects swing.
_CLEAR_OF_HELD = 2.0e-3


@dataclass(frozen=True)
class Pair:
    """Two colliders to keep apart, or two of their geoms that touch in the start pose.

    Attributes:
        a, b: The colliders. A plane is b.
        margin: Least allowed distance [m]. If it is negative, a and b may overlap by this depth.
        starts: Pairs of a node of a and a node of b. The test descends both box trees from these nodes.
        geoms: If this pair is two geoms that touch in the start pose, their ids. None for pairs of whole colliders.
        directions: Directions along which the test tries to separate the two geoms. Each gives an upper bound of their
            overlap. Unit vectors in the frame of a's body, then in the frame of b's body, shape (n, 3) each. The first
            direction is the best in the start pose.
    """

    a: int
    b: int
    margin: float
    starts: tuple[tuple[int, int], ...]
    geoms: tuple[int, int] | None = None
    directions: tuple[np.ndarray, np.ndarray] = (_NO_DIRECTIONS, _NO_DIRECTIONS)


@dataclass(frozen=True)
class ArmPairs:
    """Pairs of colliders to keep apart while an arm grasps a target, as lists of `Pair`.

    Attributes:
        robots: For each reach target, in placement order, the robot that has to reach it.
        itself: For each of these robots, pairs within the robot between which MuJoCo would report contacts.
        scene: For each reach target, pairs of the robot with all bodies except markers. The hand (all bodies that the
            robot's last joint moves) may touch the target.
        hand: For each reach target, pairs of the hand with all bodies except markers and the target, sorted by the
            number of the placed object. Bodies that are not placed come first.
        owners: For each pair in `hand`, the number of the placed object that the hand has to avoid, or -1.
        target: For each reach target, pairs of the hand with the target.
        held: For each reach target, pairs of the robot and the target with all other bodies except markers. The hand
            may touch the target. The list is empty if no kind of start holds the target in the air.
    """

    robots: list[str] = field(default_factory=list)
    itself: dict[str, list[Pair]] = field(default_factory=dict)
    scene: list[list[Pair]] = field(default_factory=list)
    hand: list[list[Pair]] = field(default_factory=list)
    owners: list[list[int]] = field(default_factory=list)
    target: list[list[Pair]] = field(default_factory=list)
    held: list[list[Pair]] = field(default_factory=list)


class PairRules:
    """MuJoCo's rules for the colliders of a scene: which pairs can touch, and at which distance contacts begin.

    Args:
        scene: The scene.
        colliders: Its colliders.
    """

    def __init__(self, scene: SceneModel, colliders: list[Collider]) -> None:
        self.mjm, self.colliders, self.trees = scene.mjm, colliders, Trees(colliders)
        self.contacts = ContactRules(scene.mjm, scene.config.geometry)
        self.is_physics = scene.config.geometry == "physics"
        self._simulated = self.contacts if self.is_physics else scene.contact_rules
        self._fixed = is_static(scene.mjm).tolist()

    def of(self, bodies: Container[int]) -> list[int]:
        """Return the numbers of the colliders that belong to `bodies`."""
        return [c for c, one in enumerate(self.colliders) if one.body in bodies]

    def touch(self, a: int, b: int) -> float:
        """Return the distance [m] at which MuJoCo's contact of two colliders begins."""
        return self.contacts.distance(*self._classes(a, b))

    def apart(self, a: int, b: int, margin: float) -> Pair:
        """Return a pair of two colliders with a least allowed distance [m]. The order of a and b does not matter."""
        if self.colliders[a].plane >= 0:
            a, b = b, a
        return Pair(a, b, margin, ((self.colliders[a].root, self.colliders[b].root),))

    def meet(self, a: int, b: int) -> bool:
        """Return whether two colliders can touch at all. Two planes or two static bodies cannot.

        Fixtures are kept apart even if MuJoCo would not report their contact.
        """
        first, second = self.colliders[a], self.colliders[b]
        if min(first.plane, second.plane) >= 0 or (self._fixed[first.body] and self._fixed[second.body]):
            return False
        return self.contacts.may_touch(*self._classes(a, b), first.body, second.body)

    def meet_within(self, a: int, b: int) -> bool:
        """Return whether two colliders of one object can touch. MuJoCo ignores contacts of a body with its parent."""
        bodies = self.colliders[a].body, self.colliders[b].body
        if np.ptp(self.mjm.body_weldid[[*bodies]]) == 0 or not self.meet(a, b):
            return False
        return self.contacts.is_explicit(*self._classes(a, b)) or not self.contacts.is_parent(*bodies)

    def geoms(self, collider: int) -> list[int]:
        """Return the geoms of a collider. With `geometry: visual`, return all colliding geoms of the body."""
        one = self.colliders[collider]
        of_body = np.flatnonzero(self.mjm.geom_bodyid == one.body).tolist()
        if self._simulated is not self.contacts:
            return [geom for geom in of_body if self._simulated.collides(geom)]
        return [geom for geom in of_body if self.contacts.classes[geom] == one.contact_class]

    def _classes(self, a: int, b: int) -> tuple[int, int]:
        """Return the contact class of each of two colliders, as in `ContactRules`."""
        return self.colliders[a].contact_class, self.colliders[b].contact_class


def collider_pairs(plan: Plan, rules: PairRules) -> list[list[Pair]]:
    """For each object of a plan, return the pairs of colliders that have to be apart after the object is placed.

    Args:
        plan: The plan.
        rules: The rules for its colliders.
    """
    bodies, scene, config = [c.body for c in rules.colliders], plan.scene, plan.scene.config
    clearances = dict.fromkeys(range(scene.mjm.nbody), 0.0)
    for name, part in (*config.all_robots.items(), *config.objects.items()):
        clearances |= dict.fromkeys(scene.subtree(name), part.clearance)
    left_out = _marker_bodies(scene).union(*(o.bodies for o in plan.objects))
    # clearances of the bodies already in place, at first all bodies that are not placed. Markers take no space.
    standing = {body: clearance for body, clearance in clearances.items() if body not in left_out}
    never_with = config.presence.excluded
    result = []
    for i, o in enumerate(plan.objects):
        tell("pairs", i + 1, len(plan.objects))
        clearance, is_static = o.config.clearance, o.kind == ObjectKind.STATIC
        pairs = []
        if o.config.kind != "marker":
            # objects that are never together, such as variants of one object, cannot collide
            others = {body for name in never_with.get(o.name, ()) for body in scene.subtree(name)}
            pairs = [
                rules.apart(a, b, max(rules.touch(a, b), 0.0 if is_static else max(clearance, standing[bodies[b]])))
                for a, b in product(rules.of(o.bodies), rules.of(standing.keys() - others))
                if rules.meet(a, b) and not (o.heap is not None and bodies[b] in o.heap.together)
            ]
            if o.joint_ranges:
                pairs += _among(rules, plan, o.bodies)
            standing.update(dict.fromkeys(o.bodies, clearance))
        result.append(pairs)
    return result


def _marker_bodies(scene: SceneModel) -> set[int]:
    """Return the bodies of all markers."""
    markers = [name for name, part in scene.config.objects.items() if part.kind == "marker"]
    return {body for name in markers for body in scene.subtree(name)}


def arm_pairs(plan: Plan, rules: PairRules) -> ArmPairs:
    """Return the pairs of colliders to keep apart while an arm grasps a reach target.

    Args:
        plan: The plan.
        rules: The rules for its colliders.
    """
    reaching, scene, bodies = plan.reaching, plan.scene, [c.body for c in rules.colliders]
    markers, config = _marker_bodies(scene), scene.config
    lifted = {name for start in config.start if start.is_held for name in start.targets(config.variants)}
    numbers = {body: i for i, o in enumerate(plan.objects) for body in o.bodies}
    carries = {one.robot: carried(rules.mjm, one.arm) for one in reaching.arms if one.robot not in scene.apart}

    def apart(own: list[int], others: Iterable[int]) -> list[Pair]:
        return [rules.apart(a, b, rules.touch(a, b)) for a, b in product(own, others) if rules.meet(a, b)]

    found = ArmPairs([reaching.arm_of(target).robot for target in reaching.targets])
    for name, owner in zip(reaching.names, found.robots, strict=True):
        robot = scene.subtree(owner)
        moving = rules.of(scene.moving(owner))
        hand = [c for c in moving if bodies[c] in carries.get(owner, ())]
        arm = [c for c in moving if c not in hand]
        target = rules.of(scene.subtree(name))
        others = [c for c, body in enumerate(bodies) if body not in markers.union(robot) and c not in target]
        found.scene.append(apart(moving, others) + apart(arm, target))
        others.sort(key=lambda c: numbers.get(bodies[c], -1))
        found.hand.append([pair for other in others for pair in apart(hand, [other])])
        found.owners.append([numbers.get(bodies[p.b if p.a in hand else p.a], -1) for p in found.hand[-1]])
        found.target.append(apart(hand, target))
        found.held.append([])
        if name in lifted:
            base = [c for c in rules.of(robot) if c not in moving]
            kept = [replace(p, margin=max(p.margin, _CLEAR_OF_HELD)) for p in apart(target, others + base)]
            found.held[-1] = found.scene[-1] + kept
    found.itself.update({name: _among(rules, plan, scene.subtree(name)) for name in dict.fromkeys(found.robots)})
    return found


def _among(rules: PairRules, plan: Plan, bodies: list[int]) -> list[Pair]:
    """Return the pairs of colliders within one object or robot. A body and its parent make no pair, as in MuJoCo."""
    own = rules.of(bodies)
    pairs = [rules.apart(a, b, rules.touch(a, b)) for a, b in product(own, own) if a < b and rules.meet_within(a, b)]
    if not rules.is_physics:
        return [pair for pair in pairs if not _touch_at_home(rules, plan, pair)]
    home = HomeTouch(rules.mjm, plan.scene.home)
    return [part for pair in pairs for part in _as_at_home(rules, plan, home, pair)]


def _touch_at_home(rules: PairRules, plan: Plan, pair: Pair) -> bool:
    """Return whether two colliders touch in the start pose of the model.

    Each pair of geoms is measured. MuJoCo's list of contacts could overflow, because in the start pose all objects
    without a pose are at the origin.
    """
    near = max(pair.margin, _NEAR)
    geoms = [rules.geoms(collider) for collider in (pair.a, pair.b)]
    return any(mujoco.mj_geomDistance(rules.mjm, plan.scene.home, g, h, near, None) < near for g, h in product(*geoms))


def _as_at_home(rules: PairRules, plan: Plan, home: HomeTouch, pair: Pair) -> list[Pair]:
    """Split a pair of colliders: a pair without the geoms that touch at home, and one for each two touching geoms."""
    touching = []
    leaves = [rules.trees.leaves(collider).items() for collider in (pair.a, pair.b)]
    for (node, first), (other, second) in product(*leaves):
        a, b = plan.pieces[first], plan.pieces[second]
        touch = home.between(a, b, max(pair.margin, _NEAR))
        if touch is not None:
            directions = _directions(plan, a, touch.direction), _directions(plan, b, touch.direction)
            margin, geoms = touch.distance - _DEEPER, (a.geom, b.geom)
            touching.append(Pair(pair.a, pair.b, margin, ((node, other),), geoms, directions))
    rest = rules.trees.without(*pair.starts[0], [part.starts[0] for part in touching])
    return [*([replace(pair, starts=tuple(rest))] if rest else []), *touching]


def _directions(plan: Plan, piece: Piece, direction: np.ndarray) -> np.ndarray:
    """Return `direction` and the piece's axes, with both signs, in the frame of the piece's body, shape (8, 3).

    `direction` is given in the world frame, with the body in its home pose.
    """
    found = np.vstack([plan.scene.home.xmat[piece.body].reshape(3, 3).T @ direction, matrix(piece.quat).T])
    return np.concatenate([found, -found])
