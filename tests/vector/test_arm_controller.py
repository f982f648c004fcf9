"""An arm as tasks drive it: how the tool moves with joints, against plain MuJoCo, and whether it does as it is told."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector import arm_controller
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.driving import Drive

SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "panda", "base": [0.1, -0.2, 0.3], "yaw": 35, "joints": {"joint*": {"noise": 0.3}}},
    "objects": {"block": {"asset": "block", "on": "floor", "region": {"box": [[-0.9, -0.9], [-0.7, -0.7]]}}},
}


@pytest.fixture(scope="module")
def arm_scene() -> CompiledScene:
    """Return a CompiledScene with a Panda whose base is turned."""
    return compile_scene(SceneConfig.load(SCENE, {"bank": 8}), "cpu")


@pytest.fixture
def driven(arm_scene: CompiledScene) -> tuple[SceneVectorEnv, Any]:
    """Return an environment of four arms, and its task."""
    envs = SceneVectorEnv(Drive, 4, scene=arm_scene, autoreset_mode="Disabled")
    envs.reset(seed=1)
    return envs, envs.task


def drive(envs: SceneVectorEnv, action: torch.Tensor) -> None:
    """Step with actions of fewer numbers than there are controls, shape (4, n)."""
    envs.step(torch.nn.functional.pad(action, (0, 8 - action.shape[1])))


def test_the_jacobian_is_mujocos_in_the_base_frame(driven):
    """Column by column, against mj_jacSite."""
    envs, _ = driven
    mjm = envs.compiled.mjm
    found = envs.state.jacobian("panda/tcp", "panda")
    assert found.shape == (4, 6, 9)
    dofs = [int(mjm.joint(f"panda/joint{i}").dofadr[0]) for i in range(1, 8)]
    for i in range(4):
        data = mujoco.MjData(mjm)
        data.qpos[:] = envs.batch.data.qpos.numpy()[i]
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_comPos(mjm, data)
        jacobian = np.zeros((6, mjm.nv))
        mujoco.mj_jacSite(mjm, data, jacobian[:3], jacobian[3:], mjm.site("panda/tcp").id)
        base = data.body("panda").xmat.reshape(3, 3)
        expected = np.concatenate([base.T @ jacobian[:3], base.T @ jacobian[3:]])[:, dofs]
        np.testing.assert_allclose(found[i, :, :7].numpy(), expected, atol=1e-5)


def test_joint_targets_lead_by_what_full_speed_takes_and_no_more(driven):
    """The joint then moves at its published speed, and stops within a few steps of an action of zero."""
    envs, task = driven
    s, arm = envs.state, task.arm
    task.move = lambda s, action: arm.move_joints(s, action[:, :7])
    action = torch.zeros(4, 7)
    action[:, 0] = 1.0
    for _ in range(25):
        drive(envs, action)
        assert ((arm.targets(s) - arm.qpos(s)).abs() <= arm.lead + 1e-6).all()
    assert (arm.qvel(s)[:, 0] > 1.6).all()
    for _ in range(15):
        drive(envs, torch.zeros(4, 7))
    assert (arm.qvel(s).abs() < 0.05).all()
    torch.testing.assert_close(arm.qpos(s), arm.targets(s), rtol=0, atol=2e-3)


def test_targets_stay_within_the_joints_limits(driven):
    """However long a joint is driven against its end."""
    envs, task = driven
    s, arm = envs.state, task.arm
    task.move = lambda s, action: arm.move_joints(s, action[:, :7])
    for _ in range(120):
        drive(envs, torch.ones(4, 7))
    high = torch.tensor(envs.compiled.mjm.actuator_ctrlrange[:7, 1], dtype=torch.float32)
    assert (arm.targets(s) <= high + 1e-6).all()
    assert (arm.targets(s) > high - 0.3).all()


def test_a_tool_goes_along_the_axes_of_the_base_and_looks_down(driven):
    """To a point 10 cm aside, turned by half a radian, and there it stays."""
    envs, task = driven
    s, arm = envs.state, task.arm
    task.move = lambda s, action: arm.move_tool(s, action[:, :4])
    for _ in range(40):  # stand up straight first: the start has noise
        drive(envs, torch.zeros(4, 4))
    goal = arm.tool_target.clone()
    goal[:, :3] = torch.tensor([0.45, 0.1, 0.3])
    goal[:, 3] = torch.tensor([0.5, -0.5, 0.0, 0.25])
    step = torch.tensor([arm_controller.TOOL_STEP] * 3 + [arm_controller.TURN_STEP])
    for _ in range(120):
        drive(envs, ((goal - arm.tool_target) / step).clamp(-1.0, 1.0))
    tool = arm.tool(s)
    torch.testing.assert_close(tool[:, :3], goal[:, :3], rtol=0, atol=2e-3)
    half = 0.5 * goal[:, 3]
    down = torch.stack([0 * half, half.cos(), half.sin(), 0 * half], dim=1)
    assert ((tool[:, 3:] * down).sum(dim=1).abs() > 0.9999).all()


def test_a_tool_does_not_go_below_what_it_is_told(driven):
    """The target stops there, and rises at once when it is told to."""
    envs, task = driven
    arm = task.arm
    task.move = lambda s, action: arm.move_tool(s, action[:, :4], lowest=0.25)
    action = torch.zeros(4, 4)
    action[:, 2] = -1.0
    for _ in range(80):
        drive(envs, action)
    assert (arm.tool_target[:, 2] >= 0.25).all()
    assert (arm.tool(envs.state)[:, 2] < 0.27).all()


def test_the_gripper_closes_and_opens(driven):
    """From -1 to 1; the width is the distance between the fingers."""
    envs, task = driven
    arm = task.arm
    task.move = lambda s, action: arm.grip(s, action[:, 0])
    for command, width in ((-1.0, 0.0), (0.0, 0.04), (1.0, 0.08)):
        for _ in range(40):
            drive(envs, torch.full((4, 1), command))
        torch.testing.assert_close(arm.width(envs.state), torch.full((4,), width), rtol=0, atol=2e-3)


def test_a_start_concerns_the_masked_worlds_alone(driven):
    """Tool targets of the others stay what they were."""
    envs, task = driven
    task.arm.tool_target.fill_(9.0)
    task.arm.start(envs.state, torch.tensor([True, False, False, True]))
    torch.testing.assert_close(task.arm.tool_target[[0, 3], :3], task.arm.tool(envs.state)[[0, 3], :3])
    assert (task.arm.tool_target[1:3] == 9.0).all()


def test_an_arm_that_is_not_there_is_named(driven):
    """With the arms that are."""
    envs, _ = driven
    with pytest.raises(UnknownNameError, match=r"unknown arm 'ur5e'.*panda"):
        arm_controller.ArmController(envs.state, "ur5e")
