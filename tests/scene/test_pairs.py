"""Which colliders an arm in a grasp is kept apart from, against the contacts that MuJoCo C reports."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.colliders import Colliders, collect_colliders
from sceniris_gym.program.pairs import arm_pairs
from sceniris_gym.program.plan import Plan, build_plan
from sceniris_gym.scene.model import SceneModel, build_model
from tests.layout.scenes import box_mjcf


class Scene:
    """An arm, two objects to reach, one that is not, and a marker."""

    def __init__(self, folder: Path, robot: str) -> None:
        crate = box_mjcf(folder, "crate", 0.05, 0.05, 0.05)
        reached = {"asset": crate, "on": "floor", "reachable": "ik"}
        objects = {
            "first": reached,
            "other": {"asset": crate, "on": "floor"},
            "second": reached,
            "goal": {"asset": crate, "kind": "marker", "on": "floor"},
        }
        config = {"floor": {"size": [2.0, 2.0]}, "robot": {"asset": robot}, "objects": objects}
        self.model: SceneModel = build_model(SceneConfig.load(config))
        self.plan: Plan = build_plan(self.model)
        self.colliders: Colliders = collect_colliders(self.plan.pieces, False, "cpu")

    def lists(self) -> list[set[frozenset[str]]]:
        """The lists as pairs of names of bodies."""
        lists, body = arm_pairs(self.model, self.plan, self.colliders), self.colliders.body
        mjm = self.model.mjm
        return [{frozenset((mjm.body(body[a]).name, mjm.body(body[b]).name)) for a, b, _ in pairs} for pairs in lists]


@pytest.mark.parametrize("robot", ["panda", "ur5e", "heron"])
def test_self_contacts_are_those_that_mujoco_reports(tmp_path: Path, robot: str):
    """In random joint states MuJoCo finds contacts of the robot with itself between listed bodies alone."""
    scene = Scene(tmp_path, robot)
    mjm, data = scene.model.mjm, mujoco.MjData(scene.model.mjm)
    own = set(scene.model.subtree("robot"))
    joints = [j for j in range(mjm.njnt) if mjm.jnt_bodyid[j] in own]
    listed, seen = scene.lists()[0], set()
    rng = np.random.default_rng(0)
    for _ in range(400):
        data.qpos[mjm.jnt_qposadr[joints]] = rng.uniform(*mjm.jnt_range[joints].T)
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_collision(mjm, data)
        for contact in data.contact:
            pair = {int(b) for b in mjm.geom_bodyid[contact.geom]}
            if pair <= own:
                seen.add(frozenset(mjm.body(b).name for b in pair))
    assert len(seen) > 3
    assert seen <= listed


def test_the_arm_meets_all_but_its_target_and_markers(tmp_path: Path):
    """One list for each object to reach: floor and objects are in it, the object itself and the marker are not."""
    _, first, second, *_ = Scene(tmp_path, "panda").lists()
    assert {name for pair in first for name in pair if "/" not in name} == {"world", "other", "second"}
    assert {name for pair in second for name in pair if "/" not in name} == {"world", "other", "first"}


def test_the_hand_has_lists_of_its_own(tmp_path: Path):
    """They hold what the last joint carries, against the same as the whole arm."""
    _, first, second, hand, other_hand = Scene(tmp_path, "panda").lists()
    carried = {"panda/link7", "panda/hand", "panda/left_finger", "panda/right_finger"}
    assert hand == {pair for pair in first if pair & carried}
    assert other_hand == {pair for pair in second if pair & carried}


def test_a_scene_without_reach_has_no_lists(tmp_path: Path):
    """What is not asked for is not prepared."""
    scene = build_model(SceneConfig.load("mid"))
    plan = build_plan(scene)
    assert arm_pairs(scene, plan, collect_colliders(plan.pieces, False, "cpu")) == []
