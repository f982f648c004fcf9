"""TabletopLift-v0: what it observes and rewards, and a script that lifts."""

from __future__ import annotations

import importlib
import math
from typing import Any

import gymnasium
import mujoco
import pytest
import torch
from torch import Tensor

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.arm_controller import TOOL_STEP, YAW_STEP
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated, values

ENV_ID = "sceniris_gym/TabletopLift-v0"
module = importlib.import_module("sceniris_gym.envs.tabletop_lift")
TabletopLift = module.TabletopLift


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("tabletop_lift", {"bank": 8}), "cpu")


def scripted(envs: SceneVectorEnv, observation: dict, closed: Tensor) -> Tensor:
    """Return actions that go over the grasp, down to it, close (counted in `closed`) and go up; from observations."""
    grasp, lead = values(envs, observation, "tcp_to_grasp", "critic"), values(envs, observation, "tool_lead")
    cos, sin = values(envs, observation, "turn_to_grasp", "critic").unbind(dim=1)
    turn = 0.5 * torch.atan2(sin, cos)
    turn = torch.where(values(envs, observation, "chosen")[:, 2] > 0, turn, 0.0)  # only the lemon is long
    aside = grasp[:, :2].norm(dim=1)
    closed += (closed > 0) | (grasp.norm(dim=1) < 0.008)
    height = torch.where(aside > 0.01, grasp[:, 2] + 0.08, grasp[:, 2])
    height = torch.where(closed > 0, torch.where(closed > 12, 0.04, 0.0), height)
    flat = torch.where(closed[:, None] > 0, 0.0, grasp[:, :2])
    way = torch.cat([flat, height[:, None], turn[:, None]], dim=1)
    limit, step = torch.tensor([0.04, 0.04, 0.04, 0.3]), torch.tensor([TOOL_STEP] * 3 + [YAW_STEP])
    moved = ((way.clamp(-limit, limit) - lead) / step).clamp(-1, 1)
    return torch.cat([moved, torch.where(closed > 0, -1.0, 1.0)[:, None]], dim=1)


def test_the_docstring_lists_what_is_observed(compiled):
    """Names, shapes and sizes."""
    envs = gymnasium.make_vec(ENV_ID, num_envs=1, scene=compiled)
    assert isinstance(envs, SceneVectorEnv)
    assert envs.max_episode_steps == 150
    hints = [("tcp_to_grasp", (3,)), ("turn_to_grasp", (2,)), ("touching", (2,)), ("held", (1,))]
    check_stated(TabletopLift, envs, [*hints, ("object_velocities", (5, 6))])


def test_the_turn_to_a_grasp_is_that_between_tool_and_object(compiled):
    """Twice the angle, so that half a turn of the gripper makes no difference."""
    envs = SceneVectorEnv(TabletopLift, 8, scene=compiled)
    observation, _ = envs.reset(seed=2)
    task: Any = envs.task
    cos, sin = values(envs, observation, "turn_to_grasp", "critic").unbind(dim=1)
    for i, name in enumerate(tuple(module.GRASP_HEIGHTS)[j] for j in task.chosen.argmax(dim=1).tolist()):
        data = mujoco.MjData(compiled.mjm)
        data.qpos[:] = envs.batch.data.qpos.numpy()[i]
        mujoco.mj_kinematics(compiled.mjm, data)
        along, tool = data.body(name).xmat.reshape(3, 3)[:2, 0], data.site("panda/tcp").xmat.reshape(3, 3)[:2, 0]
        turn = 2.0 * (math.atan2(along[1], along[0]) - math.atan2(tool[1], tool[0]))
        assert (float(cos[i]), float(sin[i])) == pytest.approx((math.cos(turn), math.sin(turn)), abs=1e-4)


@pytest.mark.slow
def test_a_script_lifts(compiled):
    """All chosen objects are lifted; the terms of the reward come one after the other, and success last."""
    envs = SceneVectorEnv(TabletopLift, 6, scene=compiled, autoreset_mode="Disabled")
    observation, _ = envs.reset(seed=3)
    task: Any = envs.task
    assert set(task.chosen.argmax(dim=1).tolist()) == {0, 1, 2}
    closed = torch.zeros(6, dtype=torch.long)
    seen: dict[str, list[Tensor]] = {name: [] for name in ("grasping", "lifting", "holding", "success", "up")}
    info = {}
    for _ in range(150):
        observation, _, terminated, _, info = envs.step(scripted(envs, observation, closed))
        assert not terminated.any()
        for name in ("grasping", "lifting", "holding"):
            seen[name].append(info["reward_terms"][name] > 0.005)
        seen["success"].append(info["success"])
        seen["up"].append(task.height(envs.state) >= module.LIFTED)
    assert info["success"].all()
    assert (info["reward_terms"]["lifting"] > 0.079).all()
    first = {name: torch.stack(steps).int().argmax(dim=0) for name, steps in seen.items()}
    assert (first["grasping"] < first["lifting"]).all()
    assert (first["lifting"] < first["holding"]).all()
    assert (first["success"] - first["up"] >= 25).all()
    for last in range(150):
        held = torch.stack(seen["holding"][max(last - 25, 0) : last + 1]).all(dim=0) & (last >= 25)
        assert torch.equal(seen["success"][last], held), "25 steps of 0.02 s lie between the first and the last"


CAN_POSES = {
    "upright": ((1.0, 0.0, 0.0, 0.0), 0.0),
    "upside down": ((0.0, 1.0, 0.0, 0.0), 0.12),
    "on its side": ((math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0), 0.033),
}
"""Rotation wxyz of a can that lies on the table, and how high its origin is then [m]."""


def put_can(envs: SceneVectorEnv, monkeypatch: pytest.MonkeyPatch, lying: str, lifted: float) -> Any:
    """Choose the can, put it that much [m] over how it lies on the table, and say that both fingers touch it."""
    task: Any = envs.task
    task.chosen.copy_(torch.tensor([0.0, 1.0, 0.0]).expand_as(task.chosen))
    monkeypatch.setattr(task, "touching", lambda s: torch.ones(s.num_envs, 2))
    quat, origin = CAN_POSES[lying]
    qpos, address = envs.batch.data.qpos.numpy(), envs.compiled.mjm.joint("can/free").qposadr[0]
    qpos[:, address + 2] = 0.4 + origin + lifted  # the table is 0.4 m high
    qpos[:, address + 3 : address + 7] = quat
    envs.batch.data.qpos.assign(qpos)
    envs.batch.update()
    return task


@pytest.mark.parametrize("lying", CAN_POSES)
def test_what_is_lifted_is_the_lowest_point(compiled, monkeypatch, lying):
    """A can that lies on the table in any way is not up, and one that is 10 cm higher is."""
    envs = SceneVectorEnv(TabletopLift, 2, scene=compiled)
    envs.reset(seed=6)
    for lifted, up in ((0.0, False), (0.095, False), (0.105, True)):
        task = put_can(envs, monkeypatch, lying, lifted)
        terms = task.reward(envs.state, torch.zeros(2, 5))
        assert (terms["holding"] > 0).tolist() == [up, up]
        assert (task.held > 0).tolist() == [up, up]
        torch.testing.assert_close(task.height(envs.state), torch.full((2,), lifted), rtol=0, atol=1e-3)
        torch.testing.assert_close(terms["lifting"], torch.full((2,), 0.8 * min(lifted, 0.1)), rtol=0, atol=1e-3)


def test_success_takes_half_a_second(compiled, monkeypatch):
    """From the first moment that it is up to the last are 0.5 s: 25 steps, 26 moments, in which `held` goes to 1."""
    envs = SceneVectorEnv(TabletopLift, 2, scene=compiled)
    envs.reset(seed=6)
    task = put_can(envs, monkeypatch, "upright", 0.12)
    for steps in range(26):
        assert not task.success(envs.state).any()
        task.reward(envs.state, torch.zeros(2, 5))
        held = task.observe(envs.state)["critic"]["held"]
        torch.testing.assert_close(held, torch.full((2, 1), steps * envs.state.dt / 0.5))
    assert task.success(envs.state).all()
    assert (task.observe(envs.state)["critic"]["held"] == 1.0).all()


def test_an_object_that_is_dropped_is_not_held_any_more(compiled):
    """Steps of holding are counted afresh, and an episode ends where the chosen object has left the table."""
    envs = SceneVectorEnv(TabletopLift, 2, scene=compiled, autoreset_mode="Disabled")
    envs.reset(seed=5)
    task: Any = envs.task
    task.held.fill_(40.0)
    qpos = envs.batch.data.qpos.numpy()
    name = tuple(module.GRASP_HEIGHTS)[int(task.chosen[0].argmax())]
    address = compiled.mjm.joint(f"{name}/free").qposadr[0]
    qpos[0, address : address + 3] = [0.0, 0.9, 0.2]
    envs.batch.data.qpos.assign(qpos)
    assert task.success(envs.state).all()
    _, _, terminated, _, info = envs.step(torch.zeros(2, 5))
    assert terminated.tolist() == [True, False]
    assert not info["success"].any()
    assert (task.held == 0).all()


def test_other_objects_that_move_cost_something(compiled):
    """Half their speeds, and not that of the chosen one."""
    envs = SceneVectorEnv(TabletopLift, 2, scene=compiled)
    envs.reset(seed=5)
    task: Any = envs.task
    mjm = compiled.mjm
    chosen = [tuple(module.GRASP_HEIGHTS)[i] for i in task.chosen.argmax(dim=1).tolist()]
    qvel = envs.batch.data.qvel.numpy()
    for world_id, name in enumerate((chosen[0], "tin")):
        dof = mjm.joint(f"{name}/free").dofadr[0]
        qvel[world_id, dof : dof + 3] = [0.3, 0.0, 0.4]
    envs.batch.data.qvel.assign(qvel)
    torch.testing.assert_close(task.reward(envs.state, torch.zeros(2, 5))["disturbing"], torch.tensor([0.0, -0.005]))
