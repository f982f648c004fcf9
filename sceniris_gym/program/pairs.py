"""Which colliders an object is kept apart from when it is placed, and by how much; the same for an arm in a grasp."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import mujoco
import numpy as np

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.geometry.colliders import Colliders
from sceniris_gym.grasping.gripper import carried
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.scene.model import SceneModel


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
    ordered = {body for o in plan.objects for body in o.bodies}
    standing = {body: 0.0 for body in range(mjm.nbody) if body not in ordered}
    for name, part in scene.config.objects.items():
        for body in scene.subtree(name):
            if part.kind == "marker":
                standing.pop(body, None)
            elif body in standing:
                standing[body] = part.clearance
    touching = _touching_at_home(scene, plan)

    result = []
    for o in plan.objects:
        clearance = o.config.clearance if o.config is not None else 0.0
        own = [c for c, body in enumerate(bodies) if body in o.bodies]
        others = [c for c, body in enumerate(bodies) if body in standing]
        pairs = []
        if o.config is None or o.config.kind != "marker":
            pairs = [
                (a, b, max(clearance, standing[bodies[b]]) if o.kind != ObjectKind.STATIC else 0.0)
                for a, b in product(own, others)
                if _may_meet(mjm, bodies[a], bodies[b])
            ]
            if o.joint_ranges:
                pairs += _among(mjm, colliders, o.bodies, touching)
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
    carries = carried(mjm, robot_arm(scene))
    hand = [c for c in moving if bodies[c] in carries]
    arm = [c for c in moving if c not in hand]

    def apart(own: list[int], others: Iterable[int]) -> list[tuple[int, int, float]]:
        return [(a, b, 0.0) for a, b in product(own, others) if _may_meet(mjm, bodies[a], bodies[b])]

    whole, alone, touched = [], [], []
    for name in targets:
        target = [c for c, body in enumerate(bodies) if body in scene.subtree(name)]
        others = [c for c, body in enumerate(bodies) if body not in markers.union(robot) and c not in target]
        whole.append(apart(moving, others) + apart(arm, target))
        alone.append(apart(hand, others))
        touched.append(apart(hand, target))
    lists = [_among(mjm, colliders, robot, _touching_at_home(scene, plan)), *whole, *alone, *touched]
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


def _among(
    mjm: mujoco.MjModel, colliders: Colliders, bodies: list[int], touching: set[frozenset[int]]
) -> list[tuple[int, int, float]]:
    """Pairs within one object, except neighbours and what touches at home."""
    own = [c for c, body in enumerate(colliders.body) if body in bodies]
    pairs = [(a, b, colliders.body[a], colliders.body[b]) for a, b in product(own, own) if a < b]
    return [
        (a, b, 0.0)
        for a, b, body_a, body_b in pairs
        if _may_meet(mjm, body_a, body_b)
        and not _are_neighbours(mjm, body_a, body_b)
        and frozenset((body_a, body_b)) not in touching
    ]


def _may_meet(mjm: mujoco.MjModel, a: int, b: int) -> bool:
    """Whether two bodies can touch at all, and no `exclude` rules it out."""
    fixed = mjm.body_weldid[a] == 0 and mjm.body_weldid[b] == 0 and not _is_mocap(mjm, a) and not _is_mocap(mjm, b)
    excluded = (int(s) for s in mjm.exclude_signature)
    return not fixed and (min(a, b) << 16) + max(a, b) not in excluded


def _is_mocap(mjm: mujoco.MjModel, body: int) -> bool:
    return mjm.body_mocapid[mjm.body_rootid[body]] >= 0


def _are_neighbours(mjm: mujoco.MjModel, a: int, b: int) -> bool:
    """Whether MuJoCo filters the pair as parent and child, or as parts of one rigid body."""
    wa, wb = mjm.body_weldid[a], mjm.body_weldid[b]
    pa, pb = mjm.body_weldid[mjm.body_parentid[wa]], mjm.body_weldid[mjm.body_parentid[wb]]
    return wa == wb or (wa != 0 and wa == pb) or (wb != 0 and wb == pa)


def _touching_at_home(scene: SceneModel, plan: Plan) -> set[frozenset[int]]:
    """Pairs of bodies that are in contact in the start pose of the model: those cannot be kept apart."""
    data = mujoco.MjData(scene.mjm)
    data.qpos[:] = plan.home.qpos
    mujoco.mj_kinematics(scene.mjm, data)
    mujoco.mj_collision(scene.mjm, data)
    return {frozenset(int(b) for b in scene.mjm.geom_bodyid[c.geom]) for c in data.contact}


def _planes_last(pairs: list[tuple[int, int, float]], planes: list[int]) -> list[tuple[int, int, float]]:
    """The same pairs as the collision test takes them: a plane comes second, and two planes never meet."""
    turned = [(b, a, margin) if planes[a] >= 0 else (a, b, margin) for a, b, margin in pairs]
    return [p for p in turned if planes[p[0]] < 0]
