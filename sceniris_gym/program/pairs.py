"""Which colliders an object is kept apart from when it is placed, and by how much; the same for an arm in a grasp."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import mujoco
import numpy as np

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.geometry.colliders import Colliders
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.grasping.gripper import carried
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.scene.model import SceneModel

# What is nearer at home than this [m] touches: distances are compared with a skin of half as much.
_NEAR = 1.0e-5


class PairRules:
    """Which colliders of a scene can meet, by MuJoCo's rules, and from which distance on they touch.

    Args:
        scene: The scene.
        colliders: Its colliders.
    """

    def __init__(self, scene: SceneModel, colliders: Colliders) -> None:
        self.mjm, self.colliders = scene.mjm, colliders
        self.contacts = ContactRules(scene.mjm, scene.config.geometry)
        is_physics = scene.config.geometry == "physics"
        self._simulated = self.contacts if is_physics else ContactRules(scene.mjm, "physics")
        self._filters_parents = not scene.mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT

    def touch(self, a: int, b: int) -> float:
        """From which distance [m] on MuJoCo acts on two colliders."""
        return self.contacts.distance(self.colliders.contact_class[a], self.colliders.contact_class[b])

    def meet(self, a: int, b: int) -> bool:
        """Whether two colliders can touch at all. Fixtures are kept apart also where MuJoCo would not report them."""
        first, second = self.colliders.body[a], self.colliders.body[b]
        if self._is_fixed(first) and self._is_fixed(second):
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

    def _is_fixed(self, body: int) -> bool:
        return bool(self.mjm.body_weldid[body] == 0 and self.mjm.body_mocapid[self.mjm.body_rootid[body]] < 0)


def collider_pairs(scene: SceneModel, plan: Plan, colliders: Colliders) -> list[list[tuple[int, int, float]]]:
    """For each object of the plan, which colliders to keep apart when it is placed, and the least gap [m].

    Args:
        scene: The scene.
        plan: Its plan.
        colliders: Its colliders.

    Returns:
        Per object a list of (own collider, other collider, clearance).
    """
    mjm, bodies = scene.mjm, colliders.body
    rules = PairRules(scene, colliders)
    ordered = {body for o in plan.objects for body in o.bodies}
    standing = {body: 0.0 for body in range(mjm.nbody) if body not in ordered}
    for name, part in scene.config.objects.items():
        for body in scene.subtree(name):
            if part.kind == "marker":
                standing.pop(body, None)
            elif body in standing:
                standing[body] = part.clearance

    result = []
    for o in plan.objects:
        clearance, is_static = o.config.clearance if o.config is not None else 0.0, o.kind == ObjectKind.STATIC
        own = [c for c, body in enumerate(bodies) if body in o.bodies]
        others = [c for c, body in enumerate(bodies) if body in standing]
        pairs = []
        if o.config is None or o.config.kind != "marker":
            pairs = [
                (a, b, max(rules.touch(a, b), 0.0 if is_static else max(clearance, standing[bodies[b]])))
                for a, b in product(own, others)
                if rules.meet(a, b)
            ]
            if o.joint_ranges:
                pairs += _among(rules, plan, o.bodies)
            standing.update(dict.fromkeys(o.bodies, clearance))
        result.append(_planes_last(pairs, colliders.plane))
    return result


def arm_pairs(scene: SceneModel, plan: Plan, colliders: Colliders) -> list[list[tuple[int, int, float]]]:
    """Which colliders an arm in a grasp is kept apart from; no lists for a scene without reach targets.

    Args:
        scene: The scene.
        plan: Its plan.
        colliders: Its colliders.

    Returns:
        Lists like those of `collider_pairs`: the robot against itself, as MuJoCo would report it; then for each reach
        target, in placement order, the robot against all but markers, where the hand (what the robot's last joint
        carries) may touch the target; then the same for the hand alone; then the hand against the target.
    """
    targets = [o.name for o in plan.objects if o.config is not None and o.config.reachable]
    if not targets:
        return []
    mjm, bodies = scene.mjm, colliders.body
    robot = scene.subtree(ROBOT)
    markers = {body for n, part in scene.config.objects.items() if part.kind == "marker" for body in scene.subtree(n)}
    moving = [c for c, body in enumerate(bodies) if body in robot and body != robot[0]]
    rules = PairRules(scene, colliders)
    carries = carried(mjm, robot_arm(scene))
    hand = [c for c in moving if bodies[c] in carries]
    arm = [c for c in moving if c not in hand]

    def apart(own: list[int], others: Iterable[int]) -> list[tuple[int, int, float]]:
        return [(a, b, rules.touch(a, b)) for a, b in product(own, others) if rules.meet(a, b)]

    whole, alone, touched = [], [], []
    for name in targets:
        target = [c for c, body in enumerate(bodies) if body in scene.subtree(name)]
        others = [c for c, body in enumerate(bodies) if body not in markers.union(robot) and c not in target]
        whole.append(apart(moving, others) + apart(arm, target))
        alone.append(apart(hand, others))
        touched.append(apart(hand, target))
    lists = [_among(rules, plan, robot), *whole, *alone, *touched]
    return [_planes_last(pairs, colliders.plane) for pairs in lists]


def first_nodes(
    c: Colliders, pairs: list[tuple[int, int, float]], first: int, lanes: int
) -> list[tuple[int, int, int]]:
    """Where the descent of both trees begins: (pair, node of a, node of b).

    The largest boxes are opened ahead of time, whatever the poses, until there is an entry for every lane: that saves
    the first passes of every test, in which most lanes would have nothing to do.

    Args:
        c: All colliders.
        pairs: The pairs of one object.
        first: Number of the first of them among all pairs.
        lanes: How many lanes share the work; a single one does best to start from the roots.
    """
    half, child = np.concatenate([*c.half, np.zeros((0, 3))]), np.concatenate([*c.child, np.zeros(0, int)])
    entries = [(first + i, c.root[a], c.root[b]) for i, (a, b, _) in enumerate(pairs)]
    while 0 < len(entries) < lanes:
        sizes = [max(half[node].max() if child[node] >= 0 else 0.0 for node in e[1:]) for e in entries]
        widest = int(np.argmax(sizes))
        if sizes[widest] <= 0.0:
            break
        pair, a, b = entries.pop(widest)
        if child[b] < 0 or (child[a] >= 0 and half[a].max() > half[b].max()):
            entries += [(pair, int(child[a]), b), (pair, int(child[a]) + 1, b)]
        else:
            entries += [(pair, a, int(child[b])), (pair, a, int(child[b]) + 1)]
    return entries


def _among(rules: PairRules, plan: Plan, bodies: list[int]) -> list[tuple[int, int, float]]:
    """Pairs within one object, except neighbours and what touches at home."""
    own = [c for c, body in enumerate(rules.colliders.body) if body in bodies]
    return [
        (a, b, rules.touch(a, b))
        for a, b in product(own, own)
        if a < b and rules.meet_within(a, b) and not _touch_at_home(rules, plan, a, b)
    ]


def _touch_at_home(rules: PairRules, plan: Plan, a: int, b: int) -> bool:
    """Whether two colliders touch in the start pose of the model: those cannot be kept apart.

    Geom by geom: all that is not placed yet is at the origin there, and more contacts than MuJoCo has room for.
    """
    near = max(rules.touch(a, b), _NEAR)
    geoms = [rules.geoms(collider) for collider in (a, b)]
    return any(mujoco.mj_geomDistance(rules.mjm, plan.home, g, h, near, None) < near for g, h in product(*geoms))


def _planes_last(pairs: list[tuple[int, int, float]], planes: list[int]) -> list[tuple[int, int, float]]:
    """The same pairs as the collision test takes them: a plane comes second, and two planes never meet."""
    turned = [(b, a, margin) if planes[a] >= 0 else (a, b, margin) for a, b, margin in pairs]
    return [p for p in turned if planes[p[0]] < 0]
