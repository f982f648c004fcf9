"""Pairs of colliders to keep apart, as lists for device code: one list per object, then lists for grasping arms."""

import numpy as np

from sceniris_gym.geometry.ragged import addressed, columns
from sceniris_gym.program.pack.pairs import PairRules, arm_pairs, collider_pairs
from sceniris_gym.program.plan import Plan

_ARM_LISTS = ("arm_scene", "arm_hand", "arm_target", "arm_held")
ARM_LISTS = ("arm_pairadr", "arm_pairnum", "arm_broadadr", "arm_broadnum", "arm_self", *_ARM_LISTS, "hand_before")
"""Names of the packed lists for arms in a grasp. They are fields of `Reach`."""


def pack_pairs(plan: Plan, rules: PairRules, lanes: int) -> dict[str, np.ndarray]:
    """Return the pairs of colliders to keep apart, and their margins, as lists for objects and lists for arms.

    The lists for objects are fields of `Program`. The lists for arms that grasp a target are `ARM_LISTS` of `Reach`.

    Args:
        plan: The plan.
        rules: The rules for its colliders.
        lanes: Number of lanes that share the collision test of a world.
    """
    colliders, number = rules.colliders, len(plan.objects)
    arm = arm_pairs(plan, rules)
    names, column = list(arm.itself), np.arange(len(arm.robots))
    lists = [*collider_pairs(plan, rules), *arm.itself.values(), *arm.scene, *arm.hand, *arm.target, *arm.held]
    pairs, of_lists = addressed("pair", lists)
    entries = (
        [(int(first) + i, *nodes) for i, p in enumerate(part) for nodes in p.starts]
        for part, first in zip(lists, of_lists["pairadr"], strict=True)
    )
    firsts = [sorted(rules.trees.first_nodes(part, lanes)) for part in entries]
    starts, of_starts = addressed("broad", firsts)
    hands = zip(arm.owners, firsts[len(firsts) - 3 * len(column) :], strict=False)
    before = [np.searchsorted([own[e[0] - part[0][0]] for e in part], np.arange(number + 1)) for own, part in hands]
    owners = [o.bodies for o in plan.objects] + [plan.scene.subtree(name) for name in (*names, *arm.robots * 3)]
    held = zip(arm.robots, plan.reaching.names, strict=True)
    owners += [plan.scene.subtree(robot) + plan.scene.subtree(name) for robot, name in held]
    body = [c.body for c in colliders]
    bodies = [
        (body[p.a], body[p.b], (body[p.a] in own) + 2 * (body[p.b] in own), colliders[p.b].plane)
        for own, part in zip(owners, lists, strict=True)
        for p in part
    ]
    touching = (() if p.geoms is None else np.concatenate(p.directions) for p in pairs)
    directions, of_pairs = addressed("pair_direction", touching)
    return {
        "pair_bodies": np.reshape(bodies, (-1, 4)).astype(int),
        **{f"obj_{name}": values[:number] for name, values in (of_lists | of_starts).items()},
        **{f"arm_{name}": values[number:] for name, values in (of_lists | of_starts).items()},
        "arm_self": np.array([names.index(name) for name in arm.robots], int),
        **{name: len(names) + i * len(column) + column for i, name in enumerate(_ARM_LISTS)},
        "hand_before": np.ravel(before).astype(int),
        "broad_pair": np.reshape(starts, (-1, 3)).astype(int),
        **columns("pair", pairs, a=1, b=1, margin=1),
        "pair_touch": np.array([rules.touch(p.a, p.b) if p.geoms is None else p.margin for p in pairs], float),
        **of_pairs,
        "direction": np.reshape(directions, (-1, 3)),
    }
