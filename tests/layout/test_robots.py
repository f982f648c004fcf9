"""Several robots, robots whose base is drawn, and robots that are not in the scene: judged by exact IK and MuJoCo C."""

from __future__ import annotations

from fnmatch import fnmatch
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.config.loader import shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.geometry.rotations import pose_matrix
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.solve import POS_TOL
from sceniris_gym.scene.layout_table import LayoutTable
from tests.layout.grasped import taken
from tests.oracle.exact_ik import ExactIk

N = 200
CAN = {"asset": "can", "on": "floor"}
MUG = {"asset": "mug", "on": "floor"}
LEFT = {"asset": "panda", "base": [-0.1, 0.6, 0.0], "yaw": -90.0}
RIGHT = {"asset": "ur5e", "base": [0.1, -0.6, 0.0], "yaw": 90.0}


def compiled(objects: dict[str, Any], **words: Any) -> CompiledScene:
    """Return a compiled scene with a floor."""
    return compile_scene({"floor": {"size": [1.8, 1.8]}, "objects": objects, "bank": 1, **words}, "cpu")


def poses_from_base(scene: CompiledScene, table: LayoutTable) -> dict[str, np.ndarray]:
    """Return the TCP that each target was accepted for in the frame of its own arm's base, by MuJoCo C, (N, 4, 4)."""
    assert scene.reaching is not None
    data, found = mujoco.MjData(scene.mjm), {name: [] for name in scene.reaching.names}
    for row in range(len(table)):
        table.put(data, row)
        mujoco.mj_kinematics(scene.mjm, data)
        for k, target in enumerate(scene.reaching.targets):
            base = scene.scene.bodies[scene.reaching.arm_of(target).robot]
            grasp = target.grasp_set.grasps[table.grasp[row, k]]
            tcp = pose_matrix(data.xpos[grasp.body], data.xquat[grasp.body]) @ pose_matrix(grasp.pos, grasp.quat)
            found[target.name].append(np.linalg.inv(pose_matrix(data.xpos[base], data.xquat[base])) @ tcp)
    return {name: np.array(poses) for name, poses in found.items()}


def missed(robot: str, poses: np.ndarray) -> int:
    """Return how many of the poses a shipped arm does not reach, by exact inverse kinematics."""
    exact = ExactIk(mujoco.MjModel.from_xml_path(str(shipped("assets", ".xml")[robot])), robot)
    return int((~exact.reachable(poses)[0]).sum())


def penetrating(scene: CompiledScene, table: LayoutTable) -> int:
    """Return in how many layouts the audit finds what collides, or stands where it should not."""
    report = Auditor(scene.mjm, scene.config, scene.scene.bodies).judge(table, settled=20)
    return report.colliding + len(report.misplaced) + report.relation_violations


@pytest.mark.parametrize("tier", ["map", "ik"])
def test_each_target_is_reached_by_the_arm_that_it_names(tier: str):
    """Exact IK of that arm has joints for the grasp; those of the stage bring its own TCP there."""
    objects = {
        "can": {**CAN, "reachable": {"by": "left", "tier": tier}},
        "mug": {**MUG, "reachable": {"by": "right", "tier": tier}},
    }
    scene = compiled(objects, robots={"left": LEFT, "right": RIGHT})
    table = make_table(scene, N, 0)
    poses = poses_from_base(scene, table)
    assert table.valid.all()
    assert missed("panda", poses["can"]) <= (1 if tier == "map" else 0)
    assert missed("ur5e", poses["mug"]) <= (1 if tier == "map" else 0)
    assert penetrating(scene, table) == 0
    if tier == "ik":
        assert np.isnan(table.grasp_qpos[:, :, -1]).tolist() == [[False, True]] * N  # seven joints, and six
        assert judge_reach(scene, table, reach_claims(scene, table)) == []


@pytest.mark.parametrize("tier", ["ik", "clear"])
def test_with_clear_no_arm_hits_the_other_one(tier: str):
    """In grasps and pre-grasps of either arm MuJoCo C finds no contact but the hand's; `ik` alone allows some."""
    between = {"region": {"box": [[-0.35, -0.25], [0.35, 0.25]]}}
    objects = {
        "can": {**CAN, **between, "reachable": {"by": "left", "tier": tier}},
        "mug": {**MUG, **between, "reachable": {"by": "right", "tier": tier}},
    }
    near = {"left": {**LEFT, "base": [-0.1, 0.45, 0.0]}, "right": {**RIGHT, "base": [0.1, -0.45, 0.0]}}
    scene = compiled(objects, robots=near)
    generator = LayoutGenerator(scene, N, seed=1)
    generator.generate()
    found = list(taken(scene, generator.layouts, "grasp_qpos"))
    assert {t.name for t in found} == {"can", "mug"}
    assert len(found) == 2 * N
    assert max(t.far for t in found) <= POS_TOL
    assert not any(t.itself for t in found)
    assert any(t.others for t in found) == (tier == "ik")
    if tier == "clear":
        before = list(taken(scene, generator.layouts, "pregrasp_qpos"))
        assert len(before) == 2 * N
        assert not any(t.itself or t.others for t in before)


def test_one_of_several_names_is_the_same_robot():
    """`robot` is the short form: the layouts of both have the same bits."""
    one = compiled({"can": {**CAN, "reachable": "ik"}}, robot=LEFT)
    named = compiled({"can": {**CAN, "reachable": "ik"}}, robots={"arm": LEFT})
    tables = [make_table(scene, 32, 5) for scene in (one, named)]
    assert (tables[0].qpos == tables[1].qpos).all()
    assert (tables[0].grasp == tables[1].grasp).all()
    assert one.hash != named.hash
    assert named.slots == ("can", "arm")


@pytest.mark.parametrize(("near", "order"), [("post", ["post", "robot", "can"]), ("can", ["post", "can", "robot"])])
@pytest.mark.parametrize("tier", ["map", "ik"])
def test_targets_are_within_reach_of_the_base_that_was_drawn(near: str, order: list[str], tier: str):
    """The base is placed before its target or after it, by the same test; it is on the floor, clear of things."""
    objects = {"post": {"asset": "block", "on": "floor"}, "can": {**CAN, "reachable": tier}}
    relations = [{"near": near, "distance": {"min": 0.2, "max": 0.8}}]
    scene = compiled(objects, robot={"asset": "ur5e", "on": "floor", "relations": relations, "clearance": 0.01})
    assert list(scene.placed) == order
    table = make_table(scene, N, 0)
    poses = poses_from_base(scene, table)["can"]
    assert table.valid.all()
    assert missed("ur5e", poses) == 0
    assert penetrating(scene, table) == 0
    bases = table.mocap_pos[:, 0]
    assert len(np.unique(bases[:, 0])) == N
    assert np.abs(poses[:, :2, 3]).max() > 0.5


def test_bases_that_wait_for_each_other_are_refused():
    """Each stands near what the other one is to reach before it."""
    objects = {"can": {**CAN, "reachable": {"by": "b"}}, "mug": {**MUG, "reachable": {"by": "a"}}}
    near = [{"on": "floor", "relations": [{"near": name, "distance": {"max": 0.5}}]} for name in ("can", "mug")]
    robots = {"a": {"asset": "ur5e", **near[0]}, "b": {"asset": "ur5e", **near[1]}}
    with pytest.raises(SceneKeyError, match="relative to each other: can -> b -> mug -> a -> can"):
        compiled(objects, robots=robots)


def test_reach_without_the_robot_leaves_only_a_frame():
    """No joints, no geoms, and a point in the air is reached by the map all the same, fixed base or drawn."""
    goal = {"kind": "marker", "region": {"box": [[-0.6, -0.6, 0.1], [0.6, 0.6, 0.8]]}, "reachable": {"by": "there"}}
    robots = {"here": {**LEFT, "in_scene": False}, "there": {"asset": "ur5e", "on": "floor", "in_scene": False}}
    scene = compiled({"can": {**CAN, "reachable": {"by": "here"}}, "goal": goal}, robots=robots)
    assert (scene.mjm.njnt, scene.mjm.nu) == (1, 0)
    table = make_table(scene, N, 0)
    poses = poses_from_base(scene, table)
    assert missed("panda", poses["can"]) <= 1
    assert missed("ur5e", poses["goal"]) <= 1
    few = table[:8]
    assert len(judge_reach(scene, few, reach_claims(scene, few))) <= 1


def test_only_chosen_grasps_count():
    """Those whose names match; a name that matches none is an error that lists what there is."""
    scene = compiled({"mug": {**MUG, "reachable": {"grasp": "rim_[01]"}}}, robot=LEFT)
    assert scene.reaching is not None
    (target,) = scene.reaching.targets
    assert len(target.grasp_set.grasps) == 4
    assert all(fnmatch(g.name.removesuffix(" rolled"), "grasp_rim_[01]") for g in target.grasp_set.grasps)
    with pytest.raises(UnknownNameError, match=r"objects\.mug\.grasp: unknown grasp 'rimm\*'.*handle_top, rim_0"):
        compiled({"mug": {**MUG, "reachable": True, "grasp": "rimm*"}}, robot=LEFT)
    assert SceneConfig.load(scene.config).objects["mug"].grasp == "rim_[01]"
