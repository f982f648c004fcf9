"""DrawerOpenPick-v0: what it observes and rewards, and a script that pulls the drawer open."""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.arm_controller import JOINT_STEP
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.reaching import ScriptedArm, solve
from tests.envs.stated import check_stated

module = importlib.import_module("sceniris_gym.envs.drawer_open_pick")
DrawerOpenPick = module.DrawerOpenPick


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("drawer_open_pick", {"bank": 8}), "cpu")


def test_the_docstring_lists_what_is_observed(compiled):
    """Names, shapes and sizes."""
    envs = gymnasium.make_vec("sceniris_gym/DrawerOpenPick-v0", num_envs=1, scene=compiled)
    assert isinstance(envs, SceneVectorEnv)
    assert envs.max_episode_steps == 400
    hints = [("banana_velocity", (6,)), ("apple_pose", (7,)), ("touching", (2,)), ("held", (1,))]
    more = [("tcp_to_grasp", (3,)), ("turn_to_grasp", (2,)), ("facing", (1,))]
    check_stated(DrawerOpenPick, envs, [*hints, *more])


def test_picking_counts_once_the_drawer_is_open(compiled):
    """Closed, half open, and open: the terms of DrawerPick-v0 are 0 but in the last one."""
    envs = SceneVectorEnv(DrawerOpenPick, 3, scene=compiled)
    envs.reset(seed=2)
    assert not envs.state.qpos("cabinet/upper").any()
    qpos, address = envs.batch.data.qpos.numpy(), compiled.mjm.joint("cabinet/upper").qposadr[0]
    qpos[:, address] = [0.0, 0.11, 0.23]
    envs.batch.data.qpos.assign(qpos)
    envs.batch.update()
    task: Any = envs.task
    terms = task.reward(envs.state, torch.zeros(3, 8))
    assert terms["opening"].tolist() == pytest.approx([0.0, 0.03, 0.06])
    assert terms["handle"][2] == pytest.approx(0.02)
    assert (terms["handle"][:2] > 0.0).all()
    assert (terms["handle"][:2] < 0.02).all()
    assert (terms["reaching"] > 0.0).tolist() == [False, False, True]


def way_to_the_handle(envs: SceneVectorEnv, world: int) -> list[np.ndarray]:
    """Return joint angles before the handle, at it, and at five points with the drawer ever further open."""
    mjm, d = envs.compiled.mjm, envs.batch.data
    arm, data = ScriptedArm.of(mjm), mujoco.MjData(mjm)
    data.qpos[:] = d.qpos.numpy()[world]
    data.mocap_pos[:], data.mocap_quat[:] = d.mocap_pos.numpy()[world], d.mocap_quat.numpy()[world]
    mujoco.mj_kinematics(mjm, data)
    site = data.site("cabinet/grasp_upper_handle")
    pos, rotation = site.xpos.copy(), site.xmat.reshape(3, 3) @ np.diag([-1.0, -1.0, 1.0])
    found = []
    for back in (0.1, 0.0, 0.05, 0.1, 0.15, 0.2, 0.24):
        assert solve(arm, data, pos - back * rotation[:, 2], rotation, data.qpos[arm.qposadr].copy())
        found.append(data.qpos[arm.qposadr].copy())
    return found


@pytest.mark.slow
def test_a_script_pulls_the_drawer_open(compiled):
    """To the handle, close, and back: the drawer opens by 0.22 m, the reward grows, and the banana stays in it."""
    envs = SceneVectorEnv(DrawerOpenPick, 4, scene=compiled, autoreset_mode="Disabled")
    envs.reset(seed=0)
    ways = [way_to_the_handle(envs, i) for i in range(4)]
    goals = torch.tensor(np.array(ways), dtype=torch.float32).transpose(0, 1)
    rewards = []

    def go(goal: torch.Tensor, gripper: float, steps: int, speed: float) -> None:
        total = torch.zeros(4)
        for _ in range(steps):
            action = torch.full((4, 8), gripper)
            action[:, :7] = ((goal - envs.state.ctrl[:, :7]) / JOINT_STEP).clamp(-speed, speed)
            total += envs.step(action)[1]
        rewards.append(total / steps)

    go(goals[0], 1.0, 90, 1.0)
    go(goals[1], 1.0, 40, 0.3)
    go(goals[1], -1.0, 20, 0.3)
    for goal in goals[2:]:
        go(goal, -1.0, 25, 0.3)
    assert (envs.state.qpos("cabinet/upper") > module.OPEN).sum() >= 3
    assert (rewards[-1] > rewards[2] + 0.05).sum() >= 3
    assert (envs.state.pose("banana")[:, 2] > 0.25).all()
