"""Which colliders an object is kept apart from when it is placed, and by how much; the same for an arm in a grasp.

Parts of one object may touch at home already. With `geometry: physics` such geoms stay as far apart as at home, or get
no deeper into each other; the other geoms of their bodies are kept apart. What is seen (`geometry: visual`) has no
depth, so colliders that touch at home are left alone there.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import mujoco
import numpy as np

from sceniris_gym.geometry.colliders import Colliders
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.grasping.gripper import carried
from sceniris_gym.program.checks.memory import check_memory
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.pack.descent import leaf_nodes, nodes_without
from sceniris_gym.program.pack.home_touch import HomeTouch
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.progress import tell
from sceniris_gym.scene.model import SceneModel

# What is nearer at home than this [m] touches: distances are compared with a skin of half as much.
_NEAR = 1.0e-5
# How much nearer than at home [m] geoms may come that touch there, the skin included: half of it is left for rounding.
_DEEPER = 1.0e-5
# Memory that a pair takes while a scene is compiled, measured with 500,000 of them.
_PAIR_BYTES = 600
_NO_WAYS = np.zeros((0, 3))


@dataclass(frozen=True)
class Pair:
    """Two colliders that are kept apart, or one geom of each that touch at home.

    Attributes:
        a, b: The colliders; a plane is the second.
        margin: The least distance [m]; negative: how deep they may be in each other.
        starts: Nodes of a and b that the descent of their trees begins with.
        geoms: The two geoms that touch at home, None for all other pairs.
        ways: Ways of b's geom out of a's, that are tried to prove how deep they are: unit vectors in the frame of a's
            body, and others in that of b's, shape (n, 3) each; the shortest one at home comes first.
    """

    a: int
    b: int
    margin: float
    starts: tuple[tuple[int, int], ...]
    geoms: tuple[int, int] | None = None
    ways: tuple[np.ndarray, np.ndarray] = (_NO_WAYS, _NO_WAYS)


@dataclass(frozen=True)
class ArmPairs:
    """What an arm in a grasp is kept apart from, in lists like those of `collider_pairs`.

    Attributes:
        robots: For each reach target, in placement order, the robot that is to reach it.
        itself: Each of these robots with itself, as MuJoCo would report it.
        scene: For each reach target the robot with all but markers, where the hand (what the robot's last joint
            carries) may touch the target.
        hand: The same for the hand alone, without the target.
        target: The hand with the target.
    """

    robots: list[str]
    itself: dict[str, list[Pair]]
    scene: list[list[Pair]]
    hand: list[list[Pair]]
    target: list[list[Pair]]


class PairRules:
    """Which colliders of a scene can meet, by MuJoCo's rules, and from which distance on they touch.

    Args:
        scene: The scene.
        colliders: Its colliders.
    """

    def __init__(self, scene: SceneModel, colliders: Colliders) -> None:
        self.mjm, self.colliders = scene.mjm, colliders
        self.contacts = ContactRules(scene.mjm, scene.config.geometry)
        self.is_physics = scene.config.geometry == "physics"
        self._simulated = self.contacts if self.is_physics else ContactRules(scene.mjm, "physics")
        self._fixed = ((self.mjm.body_weldid == 0) & (self.mjm.body_mocapid[self.mjm.body_rootid] < 0)).tolist()
        self._filters_parents = not scene.mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT

    def touch(self, a: int, b: int) -> float:
        """From which distance [m] on MuJoCo acts on two colliders."""
        return self.contacts.distance(self.colliders.contact_class[a], self.colliders.contact_class[b])

    def apart(self, a: int, b: int, margin: float) -> Pair:
        """The pair of two colliders, in either order, that keep a distance [m]."""
        if self.colliders.plane[a] >= 0:
            a, b = b, a
        return Pair(a, b, margin, ((self.colliders.root[a], self.colliders.root[b]),))

    def meet(self, a: int, b: int) -> bool:
        """Whether two colliders can touch at all; no two planes do.

        Fixtures are kept apart also where MuJoCo would not report them.
        """
        first, second = self.colliders.body[a], self.colliders.body[b]
        if min(self.colliders.plane[a], self.colliders.plane[b]) >= 0:
            return False
        if self._fixed[first] and self._fixed[second]:
            return False
        if self._is_explicit(a, b):
            return True
        classes = self.colliders.contact_class
        return not self.contacts.excludes(first, second) and self.contacts.meet(classes[a], classes[b])

    def meet_within(self, a: int, b: int) -> bool:
        """The same for two colliders of one object, of which MuJoCo filters neighbours."""
        first, second = self.colliders.body[a], self.colliders.body[b]
        weld, parent = self.mjm.body_weldid, self.mjm.body_parentid
        if weld[first] == weld[second] or not self.meet(a, b):
            return False
        if self._is_explicit(a, b) or not self._filters_parents:
            return True
        wa, wb = weld[first], weld[second]
        return not ((wa != 0 and wa == weld[parent[wb]]) or (wb != 0 and wb == weld[parent[wa]]))

    def geoms(self, collider: int) -> list[int]:
        """What MuJoCo collides of a collider, also where what is seen is kept apart."""
        mjm, colliders = self.mjm, self.colliders
        of_body = np.flatnonzero(mjm.geom_bodyid == colliders.body[collider]).tolist()
        if self._simulated is not self.contacts:
            return [geom for geom in of_body if self._simulated.collides(geom)]
        return [geom for geom in of_body if self.contacts.classes[geom] == colliders.contact_class[collider]]

    def _is_explicit(self, a: int, b: int) -> bool:
        classes = self.colliders.contact_class
        return self.contacts.is_explicit(classes[a], classes[b])


def collider_pairs(scene: SceneModel, plan: Plan, colliders: Colliders) -> list[list[Pair]]:
    """For each object of the plan, which colliders to keep apart when it is placed, and the least gap [m].

    Args:
        scene: The scene.
        plan: Its plan.
        colliders: Its colliders.

    Returns:
        A list for each object, of its own colliders with others.
    """
    mjm, bodies = scene.mjm, colliders.body
    rules = PairRules(scene, colliders)
    ordered = {body for o in plan.objects for body in o.bodies}
    standing = {body: 0.0 for body in range(mjm.nbody) if body not in ordered}
    robots = scene.config.all_robots
    for name, robot in robots.items():
        standing.update({body: robot.clearance for body in scene.subtree(name) if body in standing})
    for name, part in scene.config.objects.items():
        for body in scene.subtree(name):
            if part.kind == "marker":
                standing.pop(body, None)
            elif body in standing:
                standing[body] = part.clearance

    _check_room(scene, plan, colliders)
    result = []
    for i, o in enumerate(plan.objects):
        tell("pairs", i + 1, len(plan.objects))
        clearance = o.config.clearance if o.config is not None else robots[o.name].clearance
        is_static = o.kind == ObjectKind.STATIC
        own = [c for c, body in enumerate(bodies) if body in o.bodies]
        others = [c for c, body in enumerate(bodies) if body in standing]
        pairs = []
        if o.config is None or o.config.kind != "marker":
            pairs = [
                rules.apart(a, b, max(rules.touch(a, b), 0.0 if is_static else max(clearance, standing[bodies[b]])))
                for a, b in product(own, others)
                if rules.meet(a, b) and not (o.heap is not None and bodies[b] in o.heap.together)
            ]
            if o.joint_ranges:
                pairs += _among(rules, plan, o.bodies)
            standing.update(dict.fromkeys(o.bodies, clearance))
        result.append(pairs)
    return result


def _check_room(scene: SceneModel, plan: Plan, colliders: Colliders) -> None:
    """Refuse scenes of so many things that their pairs do not fit into memory."""
    number = len(colliders.body)
    own = sum(len(o.bodies) for o in plan.objects)
    pairs = own * (number - own) + own * own // 2
    cure = "Use fewer objects, or geoms of one body in place of many bodies."
    check_memory(f"{scene.config.where}: the pairs of {number} colliders", pairs * _PAIR_BYTES, "cpu", cure)


def arm_pairs(scene: SceneModel, plan: Plan, colliders: Colliders) -> ArmPairs | None:
    """Which colliders an arm in a grasp is kept apart from; None for a scene without reach targets.

    Args:
        scene: The scene.
        plan: Its plan.
        colliders: Its colliders.
    """
    targets = [o.name for o in plan.objects if o.config is not None and o.config.reachable]
    if not targets:
        return None
    mjm, bodies = scene.mjm, colliders.body
    by = [scene.config.robot_for(name) for name in targets]
    markers = {body for n, part in scene.config.objects.items() if part.kind == "marker" for body in scene.subtree(n)}
    rules = PairRules(scene, colliders)
    present = [name for name in dict.fromkeys(by) if name not in scene.apart]
    carries = {name: carried(mjm, robot_arm(scene, name)) for name in present}

    def apart(own: list[int], others: Iterable[int]) -> list[Pair]:
        return [rules.apart(a, b, rules.touch(a, b)) for a, b in product(own, others) if rules.meet(a, b)]

    whole, alone, touched = [], [], []
    for name, owner in zip(targets, by, strict=True):
        robot = scene.subtree(owner)
        moving = [c for c, body in enumerate(bodies) if body in robot and body != robot[0]]
        hand = [c for c in moving if bodies[c] in carries.get(owner, ())]
        arm = [c for c in moving if c not in hand]
        target = [c for c, body in enumerate(bodies) if body in scene.subtree(name)]
        others = [c for c, body in enumerate(bodies) if body not in markers.union(robot) and c not in target]
        whole.append(apart(moving, others) + apart(arm, target))
        alone.append(apart(hand, others))
        touched.append(apart(hand, target))
    itself = {name: _among(rules, plan, scene.subtree(name)) for name in dict.fromkeys(by)}
    return ArmPairs(by, itself, whole, alone, touched)


def _among(rules: PairRules, plan: Plan, bodies: list[int]) -> list[Pair]:
    """Pairs within one object, except neighbours."""
    own = [c for c, body in enumerate(rules.colliders.body) if body in bodies]
    pairs = [rules.apart(a, b, rules.touch(a, b)) for a, b in product(own, own) if a < b and rules.meet_within(a, b)]
    if not rules.is_physics:
        return [pair for pair in pairs if not _touch_at_home(rules, plan, pair)]
    home = HomeTouch(rules.mjm, plan.home)
    return [part for pair in pairs for part in _as_at_home(rules, plan, home, pair)]


def _touch_at_home(rules: PairRules, plan: Plan, pair: Pair) -> bool:
    """Whether two colliders touch in the start pose of the model.

    Geom by geom: all that is not placed yet is at the origin there, and more contacts than MuJoCo has room for.
    """
    near = max(pair.margin, _NEAR)
    geoms = [rules.geoms(collider) for collider in (pair.a, pair.b)]
    return any(mujoco.mj_geomDistance(rules.mjm, plan.home, g, h, near, None) < near for g, h in product(*geoms))


def _as_at_home(rules: PairRules, plan: Plan, home: HomeTouch, pair: Pair) -> list[Pair]:
    """Two colliders without those of their geoms that touch at home, and these as pairs of their own."""
    touching = []
    leaves = [leaf_nodes(rules.colliders, collider).items() for collider in (pair.a, pair.b)]
    for (node, first), (other, second) in product(*leaves):
        a, b = plan.pieces[first], plan.pieces[second]
        touch = home.between(a, b, max(pair.margin, _NEAR))
        if touch is not None:
            margin, ways = touch.distance - _DEEPER, (_ways(plan, a, touch.way), _ways(plan, b, touch.way))
            touching.append(Pair(pair.a, pair.b, margin, ((node, other),), (a.geom, b.geom), ways))
    rest = nodes_without(rules.colliders, pair.a, pair.b, [part.starts[0] for part in touching])
    return [*([replace(pair, starts=tuple(rest))] if rest else []), *touching]


def _ways(plan: Plan, piece: Piece, way: np.ndarray) -> np.ndarray:
    """Directions in the frame of a piece's body: one of the world at home, and the piece's axes, to and fro."""
    found = np.vstack([plan.home.xmat[piece.body].reshape(3, 3).T @ way, matrix(piece.quat).T])
    return np.concatenate([found, -found])
