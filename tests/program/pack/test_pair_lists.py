"""Pairs as flat lists: those of objects and then those of arms, each with its margins and first nodes."""

from __future__ import annotations

from pathlib import Path

from sceniris_gym.program.pack.pairs import PairRules, arm_pairs, collider_pairs
from tests.layout.scenes import box_mjcf
from tests.program.scenes import pack, scene_of


def test_pairs_are_those_of_objects_and_then_those_of_the_arm(tmp_path: Path):
    """Every list at its address, with its margins; entries to begin with belong to the pairs of their own list."""
    cube = {"asset": box_mjcf(tmp_path, "cube", 0.05, 0.05, 0.05), "on": "floor"}
    objects = {"a": {**cube, "clearance": 0.02, "reachable": "ik"}, "b": cube}
    for lanes in (1, 32):
        packed = pack(scene_of(objects, robot={"asset": "panda"}), lanes)
        rules = PairRules(packed.scene, packed.colliders)
        expected = [("obj", i, p) for i, p in enumerate(collider_pairs(packed.plan, rules))]
        assert len(packed["obj_pairadr"]) == len(packed["obj_broadadr"]) == len(expected) == 2
        arm = arm_pairs(packed.plan, rules)
        itself = [arm.itself["robot"]]
        named = {"arm_self": itself, "arm_scene": arm.scene, "arm_hand": arm.hand, "arm_target": arm.target}
        named["arm_held"] = arm.held
        expected += [("arm", packed[name][i], p) for name, lists in named.items() for i, p in enumerate(lists)]
        assert len(packed["arm_pairadr"]) == len(packed["arm_broadadr"]) == 5
        rows = list(zip(packed["pair_a"], packed["pair_b"], packed["pair_margin"], strict=True))
        for of, i, pairs in expected:
            adr, num = packed[f"{of}_pairadr"][i], packed[f"{of}_pairnum"][i]
            assert rows[adr : adr + num] == [(p.a, p.b, p.margin) for p in pairs]
            start = packed["broad_pair"][packed[f"{of}_broadadr"][i] :][: packed[f"{of}_broadnum"][i]]
            assert set(start[:, 0]) == set(range(adr, adr + num))
            assert len(start) == num if lanes == 1 else len(start) >= min(num, lanes)
