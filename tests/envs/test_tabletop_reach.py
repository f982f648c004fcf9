"""TabletopReach-v0: what it observes and rewards, and a script that reaches."""

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
from tests.envs.reaching import ScriptedArm
from tests.envs.stated import check_stated, values

ENV_ID = "sceniris_gym/TabletopReach-v0"
module = importlib.import_module("sceniris_gym.envs.tabletop_reach")
TabletopReach = module.TabletopReach


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("tabletop_reach", {"bank": 8}), "cpu")


def test_the_docstring_lists_what_is_observed(compiled):
    """Names, shapes and sizes."""
    envs = gymnasium.make_vec(ENV_ID, num_envs=1, scene=compiled)
    assert isinstance(envs, SceneVectorEnv)
    assert envs.max_episode_steps == 100
    check_stated(TabletopReach, envs, [("tcp_to_target", (3,)), ("object_velocities", (5, 3))])


def test_heights_are_those_of_the_assets(compiled):
    """The highest vertex of what is seen of an object, over its underside."""
    mjm = compiled.mjm
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    for name, height in module.HEIGHTS.items():
        body = mjm.body(name).id
        tops = []
        for geom in np.flatnonzero((mjm.geom_bodyid == body) & (mjm.geom_group == 2)):
            mesh = mjm.geom_dataid[geom]
            first, number = mjm.mesh_vertadr[mesh], mjm.mesh_vertnum[mesh]
            vertices = mjm.mesh_vert[first : first + number] @ data.geom_xmat[geom].reshape(3, 3).T
            tops.append((vertices + data.geom_xpos[geom] - data.xpos[body])[:, 2].max())
        assert max(tops) == pytest.approx(height, abs=1.5e-3)


def test_every_object_is_chosen_now_and_then_and_the_target_is_over_it(compiled):
    """The target is 5 cm over the top of the chosen one, as the tool sees it; masked resets leave others alone."""
    envs = SceneVectorEnv(TabletopReach, 64, scene=compiled)
    observation, _ = envs.reset(seed=1)
    chosen = values(envs, observation, "chosen")
    assert (chosen.sum(dim=1) == 1).all()
    assert (chosen.sum(dim=0) >= 4).all()
    objects, target = values(envs, observation, "tcp_to_objects"), values(envs, observation, "tcp_to_target", "critic")
    heights = torch.tensor(list(module.HEIGHTS.values()))
    expected = objects[chosen.bool()] + torch.stack([0 * heights, 0 * heights, heights + 0.05], dim=1)[chosen.argmax(1)]
    torch.testing.assert_close(target, expected, rtol=0, atol=1e-5)
    envs.reset(options={"reset_mask": torch.arange(64) < 32})
    task: Any = envs.task
    again = task.chosen
    assert torch.equal(again[32:], chosen[32:])
    assert not torch.equal(again[:32], chosen[:32])


def test_terms_of_the_reward(compiled):
    """Nearness and haste are told apart, and disturbing is what objects do, not the arm."""
    envs = SceneVectorEnv(TabletopReach, 2, scene=compiled, autoreset_mode="Disabled")
    envs.reset(seed=3)
    task: Any = envs.task
    s, idle = envs.state, torch.zeros(2, 7)
    terms = task.reward(s, idle)
    distance = task.distance(s)
    torch.testing.assert_close(terms["reaching"], 0.02 * (1 - torch.tanh(3 * distance)))
    torch.testing.assert_close(terms["hovering"], 0.04 * torch.exp(-((distance / 0.05) ** 2)))
    assert (terms["effort"] == 0).all()
    torch.testing.assert_close(task.reward(s, torch.ones(2, 7))["effort"], torch.full((2,), -0.002))
    assert (terms["disturbing"] == 0).all()
    dof = compiled.mjm.joint("can/free").dofadr[0]
    qvel = envs.batch.data.qvel.numpy()
    qvel[:, dof : dof + 3] = [[0.3, 0.0, 0.4], [0.0, 3.0, 0.0]]
    envs.batch.data.qvel.assign(qvel)
    torch.testing.assert_close(task.reward(s, idle)["disturbing"], torch.tensor([-0.01, -0.02]))


def solve_point(arm: ScriptedArm, data: mujoco.MjData, pos: np.ndarray) -> bool:
    """Bring the tool to a point, however it is turned, by damped least squares; leave the result in `data`."""
    jacobian = np.zeros((3, arm.model.nv))
    for _ in range(100):
        mujoco.mj_kinematics(arm.model, data)
        mujoco.mj_comPos(arm.model, data)
        error = pos - data.site_xpos[arm.tcp]
        if np.linalg.norm(error) < 1e-3:
            return True
        mujoco.mj_jacSite(arm.model, data, jacobian, None, arm.tcp)
        j = jacobian[:, arm.dofadr]
        dq = j.T @ np.linalg.solve(j @ j.T + 1e-3 * np.eye(3), error)
        data.qpos[arm.qposadr] = np.clip(data.qpos[arm.qposadr] + dq.clip(-0.2, 0.2), *arm.limits)
    return False


def test_a_script_reaches(compiled):
    """Joint angles from plain MuJoCo, driven to: success to the last step, and more reward on the way."""
    envs = SceneVectorEnv(TabletopReach, 12, scene=compiled, autoreset_mode="Disabled")
    observation, _ = envs.reset(seed=10)
    mjm = compiled.mjm
    arm, goals = ScriptedArm.of(mjm), []
    target = values(envs, observation, "tcp_to_target", "critic").double().numpy()
    for i in range(12):
        data = mujoco.MjData(mjm)
        data.qpos[:] = envs.batch.data.qpos.numpy()[i]
        mujoco.mj_kinematics(mjm, data)
        base = data.body("panda").xmat.reshape(3, 3)
        pos = data.site_xpos[arm.tcp] + base @ target[i]
        assert solve_point(arm, data, pos)
        goals.append(data.qpos[arm.qposadr].copy())
    goal = torch.tensor(np.array(goals), dtype=torch.float32)
    task: Any = envs.task
    rewards, info = [], {}
    for _ in range(100):
        action = ((goal - task.arm.targets(envs.state)) / JOINT_STEP).clamp(-1, 1)
        _, reward, _, _, info = envs.step(action)
        rewards.append(reward)
    reached = info["success"]
    assert reached.sum() >= 10  # a bottle may stand between
    assert (rewards[-1] > 0.055)[reached].all()
    assert (rewards[-1] > rewards[0] + 0.02)[reached].all()
