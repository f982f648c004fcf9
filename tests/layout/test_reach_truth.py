"""Verdicts of placing on whole objects, against exact inverse kinematics of all their grasps."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.loader import shipped
from sceniris_gym.errors import ArmError
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.grasped import arm_mjcf
from tests.layout.scenes import box_mjcf, compile_on_cpu
from tests.oracle.exact_ik import ExactIk

N = 150


def scene(robot: str, **words: object) -> CompiledScene:
    """An arm that is turned, and a mug that lies anywhere on the floor around it. Nothing is tried twice."""
    return compile_on_cpu(
        {
            "floor": {"size": [2.2, 2.2]},
            "robot": {"asset": robot, "base": [0.1, 0.2, 0.0], "yaw": 130.0},
            "objects": {"mug": {"asset": "mug", "on": "floor", "clearance": 0.0, **words}},
            "attempts": 1,
            "restarts": 0,
        },
        bank=1,
    )


def grasp_poses(compiled: CompiledScene, plain: CompiledScene, qpos: np.ndarray) -> np.ndarray:
    """All grasps of the mug in each layout, in the frame of the arm's base by MuJoCo C, (nworld, ngrasp, 4, 4)."""
    assert compiled.reaching is not None
    mjm, data = plain.mjm, mujoco.MjData(plain.mjm)
    found = []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(mjm, data)
        base = _matrix(data.xpos[plain.scene.bodies["robot"]], data.xquat[plain.scene.bodies["robot"]])
        mug = _matrix(data.xpos[plain.scene.bodies["mug"]], data.xquat[plain.scene.bodies["mug"]])
        grasps = compiled.reaching.targets[0].grasp_set.grasps
        found.append([np.linalg.inv(base) @ mug @ _matrix(g.pos, g.quat) for g in grasps])
    return np.array(found)


def _matrix(pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    frame, mat = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(mat, np.asarray(quat, float))
    frame[:3, :3], frame[:3, 3] = mat.reshape(3, 3), pos
    return frame


@pytest.mark.parametrize(("robot", "tier"), [("ur5e", "map"), ("heron", "ik")])
def test_a_mug_is_accepted_where_any_of_its_grasps_is_reached(robot: str, tier: str):
    """The first candidate of each world, with the word and without: the same pose, accepted where the truth says so."""
    asked, plain = scene(robot, reachable=tier), scene(robot)
    generators = [LayoutGenerator(compiled, N, seed=100) for compiled in (asked, plain)]
    for generator in generators:
        generator.generate()
    there = generators[1].layouts.status.numpy() == LayoutStatus.VALID  # and not on the arm's foot
    poses = grasp_poses(asked, plain, generators[1].layouts.qpos.numpy()[there])
    exact = ExactIk(mujoco.MjModel.from_xml_path(str(shipped("assets", ".xml")[robot])), robot)
    truth = exact.reachable(poses.reshape(-1, 4, 4))[0].reshape(len(poses), -1).any(axis=1)
    accepted = (generators[0].layouts.status.numpy() == LayoutStatus.VALID)[there]
    assert 0.2 < truth.mean() < 0.9
    assert not (accepted & ~truth).any()
    assert (truth & ~accepted).sum() <= 2
    if tier == "map":
        same = generators[0].layouts.qpos.numpy()[there][accepted], generators[1].layouts.qpos.numpy()[there][accepted]
        assert (same[0] == same[1]).all()


def test_an_arm_on_a_cart_reaches_from_wherever_the_cart_is_drawn():
    """The cart is an object with drawn joints, the robot a body on it; MuJoCo C puts the TCP at the mug's grasps."""
    spec = mujoco.MjSpec()
    cart = spec.worldbody.add_body(name="cart")
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for name, kind, axis in (("x", slide, [1, 0, 0]), ("y", slide, [0, 1, 0]), ("turn", hinge, [0, 0, 1])):
        cart.add_joint(name=name, type=kind, axis=axis)
    cart.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.05, 0.02, 0], pos=[0, 0, 0.05])
    frame = cart.add_frame(pos=[0, 0, 0.1])
    spec.attach(mujoco.MjSpec.from_file(str(shipped("assets", ".xml")["heron"])), prefix="arm/", frame=frame)
    drive = {"x": {"range": [-0.5, 0.5]}, "y": {"range": [-0.5, 0.5]}, "turn": {"range": [-3, 3]}}
    objects = {"cart": {"kind": "static", "joints": drive}, "mug": {"asset": "mug", "on": "floor", "reachable": "ik"}}
    words = {"model": spec, "floor": {"size": [2.2, 2.2]}, "robot": {"in_model": "arm/heron"}, "objects": objects}
    with pytest.raises(ArmError, match=r"has 9 joints.* `robot: \{in_model: arm/heron\}`"):
        compile_on_cpu({**words, "robot": {"in_model": "cart", "tcp": "arm/tcp"}, "objects": {"mug": objects["mug"]}})
    compiled = compile_on_cpu(words, bank=4)
    assert compiled.reaching is not None
    table, (arm,) = make_table(compiled, 30, 0), (one.arm for one in compiled.reaching.arms)
    assert np.ptp(table.qpos[:, compiled.mjm.joint("x").qposadr[0]]) > 0.5
    data = mujoco.MjData(compiled.mjm)
    for qpos, joints, grasp in zip(table.qpos, table.grasp_qpos[:, 0], table.grasp[:, 0], strict=True):
        data.qpos[:] = qpos
        data.qpos[arm.qposadr] = joints
        mujoco.mj_kinematics(compiled.mjm, data)
        mug, wanted = data.body(compiled.scene.bodies["mug"]), compiled.reaching.targets[0].grasp_set.grasps[grasp]
        at = mug.xpos + mug.xmat.reshape(3, 3) @ wanted.pos
        assert np.linalg.norm(data.site("arm/tcp").xpos - at) < 0.001


@pytest.mark.parametrize("tier", ["ik", "clear"])
def test_joints_of_an_unnamed_root_body_belong_to_the_arm(tmp_path: Path, tier: str):
    """A rail moves the whole arm, whose root is named by its place; MuJoCo C and the audit find the TCP at the can."""
    file = Path(arm_mjcf(tmp_path))
    root = '<body pos="0.1 0.2 0.01"><joint name="rail" type="slide" axis="0 1 0" range="-0.6 0.6"/>'
    bench = '<geom name="bench" type="box" size="0.8 0.8 0.1" pos="0 0 -0.1"/>'
    text = file.read_text().replace('<body name="picker">', bench + root).replace('qpos="', 'qpos="0 ')
    file.write_text(text)
    can = {"asset": box_mjcf(tmp_path, "can", 0.04, 0.04, 0.1), "on": "bench", "reachable": tier}
    words = {"model": str(file), "robot": {"in_model": "body_1"}, "objects": {"can": can}}
    compiled = compile_on_cpu(words, bank=4)
    assert compiled.reaching is not None
    (arm,), table = (one.arm for one in compiled.reaching.arms), make_table(compiled, 60, 0)
    assert (arm.joints[0], len(arm.joints)) == ("rail", 7)
    assert table.valid.all()
    assert np.ptp(table.grasp_qpos[:, 0, 0]) > 0.5
    data = mujoco.MjData(compiled.mjm)
    for row, (joints, grasp) in enumerate(zip(table.grasp_qpos[:, 0], table.grasp[:, 0], strict=True)):
        table.put(data, row)
        data.qpos[arm.qposadr] = joints
        mujoco.mj_kinematics(compiled.mjm, data)
        can, wanted = data.body(compiled.scene.bodies["can"]), compiled.reaching.targets[0].grasp_set.grasps[grasp]
        at = can.xpos + can.xmat.reshape(3, 3) @ wanted.pos
        assert np.linalg.norm(data.site(compiled.scene.tcps["robot"]).xpos - at) < 0.001
    assert not judge_reach(compiled, table, reach_claims(compiled, table))
