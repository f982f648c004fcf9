"""ClutterExtract-v0: which layouts it has, what it observes and rewards, and a script that extracts."""

from __future__ import annotations

import importlib
import math
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
import torch
from torch import Tensor

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.arm_controller import TOOL_STEP, YAW_STEP
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated, values
from tests.versions import since_4

ENV_ID = "sceniris_gym/ClutterExtract-v0"
module = importlib.import_module("sceniris_gym.envs.clutter_extract")
ClutterExtract = module.ClutterExtract
SIZES: dict[str, Any] = {"sim_config": {"nconmax": 128, "njmax": 384, "nvmax": 81}}


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("clutter_extract", {"bank": 8}), "cpu")


@pytest.fixture
def envs(compiled: CompiledScene) -> SceneVectorEnv:
    """Return two worlds after a reset, which nobody resets again."""
    made = SceneVectorEnv(ClutterExtract, 2, scene=compiled, autoreset_mode="Disabled", **SIZES)
    made.reset(seed=5)
    return made


def test_the_docstring_lists_what_is_observed(compiled):
    """Names, shapes and sizes."""
    made = gymnasium.make_vec(ENV_ID, num_envs=1, scene=compiled)
    assert isinstance(made, SceneVectorEnv)
    assert made.max_episode_steps == 200
    hints = [("touching", (2,)), ("held", (1,)), ("moved", (11,)), ("target_velocity", (6,))]
    check_stated(ClutterExtract, made, [*hints, ("others_velocity", (11, 6)), ("clear_side", (7,))])


def test_more_things_than_slots_are_refused():
    """A thing without a slot would neither be seen, nor counted where it is moved."""
    with pytest.raises(ArgumentError, match=r"should have at most 11 objects present, got up to 12"):
        gymnasium.make_vec(ENV_ID, num_envs=1, overrides={"groups.around.count": [3, 8], "bank": 8})


def test_two_of_five_to_eleven_others_are_within_3_cm(compiled):
    """In every layout; more than 95% of them are fresh, and the auditor finds nothing wrong with any."""
    table = make_table(compiled, 256, 9)
    assert table.valid.mean() > 0.95
    present = table.present[:, [list(compiled.config.objects).index(name) for name in module.OTHERS]]
    assert set(present.sum(axis=1)) == {5, 6, 7, 8, 9, 10, 11}
    assert present[:, : len(module.CLOSE)].sum(axis=1).min() == 2
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(table[:24], settled=24)
    assert (report.colliding, report.misplaced, report.relation_violations) == (0, [], 0)


def test_the_grasp_that_is_clear_closes_where_there_is_more_room(compiled):
    """The grasp found by the generator's inverse kinematics and collisions agrees with the task's own distances.

    In about a seventh of the layouts both pairs of sides are free, of which the generator takes either.
    """
    made = SceneVectorEnv(ClutterExtract, 256, scene=compiled, **SIZES)
    made.reset(seed=77)
    task: Any = made.task
    grasp = made.state.grasp("target")
    w, x, y, z = grasp[:, 3:].unbind(dim=1)
    closing = torch.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z)], dim=1)  # its y axis
    room = torch.stack([task.clear[:, 0].cos(), task.clear[:, 0].sin()], dim=1)
    assert ((closing * room).sum(dim=1).abs() > math.sqrt(0.5)).float().mean() > 0.87


def test_slots_hold_those_that_are_present_the_nearest_first(compiled):
    """Against the poses by name; what is left over is 0, and never where absent things are parked."""
    made = SceneVectorEnv(ClutterExtract, 16, scene=compiled, **SIZES)
    observation, _ = made.reset(seed=3)
    s, target = made.state, made.state.pose("target")
    present = s.present(module.OTHERS)
    for i in range(16):
        names = [name for name, there in zip(module.OTHERS, present[i].tolist(), strict=True) if there]
        way = {name: (s.pose(name)[i, :3] - target[i, :3]) for name in names}
        names.sort(key=lambda name: float(way[name][:2].norm()))
        assert values(made, observation, "others_present")[i].tolist() == [1.0] * len(names) + [0.0] * (11 - len(names))
        told = values(made, observation, "target_to_others")[i]
        torch.testing.assert_close(told[: len(names)], torch.stack([way[name] for name in names]))
        kinds = values(made, observation, "others_kind")[i]
        assert [tuple(module.KINDS)[j] for j in kinds[: len(names)].argmax(dim=1).tolist()] == [
            name.split("_")[0] for name in names
        ]
        for name in ("target_to_others", "others_from_tool", "others_kind", "others_up"):
            assert not values(made, observation, name)[i, len(names) :].any()


def test_the_tool_sees_things_along_its_own_axes(envs):
    """Against MuJoCo's own rotations, of the peg and of the nearest thing, for a tool that is turned."""
    for _ in range(20):
        envs.step(torch.tensor([[0.3, 0.0, 0.0, 1.0, 0.0], [0.0, 0.3, 0.0, -0.6, 0.0]]))
    task: Any = envs.task
    observed, tool = task.observe(envs.state)["policy"], task.arm.tool(envs.state)
    for world in range(2):
        for name, told in (("target", "target_from_tool"), (nearest(envs, world), "others_from_tool")):
            seen = np.zeros(3)
            away = (envs.state.pose(name)[world, :3] - tool[world, :3]).double().numpy()
            back = np.zeros(4)
            mujoco.mju_negQuat(back, tool[world, 3:].double().numpy())
            mujoco.mju_rotVecQuat(seen, away, back)
            np.testing.assert_allclose(observed[told][world].reshape(-1)[:3].numpy(), seen, atol=1e-5)


def place(envs: SceneVectorEnv, name: str, world: int, shift: list[float], quat: list[float] | None = None) -> None:
    """Move an object in one world by `shift` [m], and turn it to `quat` (wxyz)."""
    qpos, address = envs.batch.data.qpos.numpy(), envs.compiled.mjm.joint(f"{name}/free").qposadr[0]
    qpos[world, address : address + 3] += shift
    if quat is not None:
        qpos[world, address + 3 : address + 7] = quat
    envs.batch.data.qpos.assign(qpos)
    envs.batch.update()


def hold(envs: SceneVectorEnv, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Put the target 12 cm over the table in all worlds, and say that both fingers touch it."""
    task: Any = envs.task
    monkeypatch.setattr(task, "touching", lambda s: torch.ones(s.num_envs, 2))
    for world in range(envs.num_envs):
        place(envs, "target", world, [0.0, 0.0, 0.12])
    return task


def alignment(envs: SceneVectorEnv) -> list[float]:
    """Return the squared cosine between the axis along which the fingers close and the one with more room."""
    task: Any = envs.task
    shares = []
    for quat, angle in zip(task.arm.tool(envs.state)[:, 3:].tolist(), task.clear[:, 0].tolist(), strict=True):
        closing = np.zeros(3)
        mujoco.mju_rotVecQuat(closing, [0.0, 1.0, 0.0], quat)
        shares.append(float(closing[0] * math.cos(angle) + closing[1] * math.sin(angle)) ** 2)
    return shares


def nearest(envs: SceneVectorEnv, world: int) -> str:
    """Return the name of the thing in the first slot."""
    task: Any = envs.task
    return module.OTHERS[int(task.slots[world, 0])]


def test_success_takes_half_a_second(envs, monkeypatch):
    """25 steps, 26 moments, in which `held` goes to 1; something that is moved meanwhile ends it."""
    task = hold(envs, monkeypatch)
    for steps in range(26):
        assert not task.success(envs.state).any()
        task.reward(envs.state, torch.zeros(2, 5))
        held = task.observe(envs.state)["critic"]["held"]
        torch.testing.assert_close(held, torch.full((2, 1), steps * envs.state.dt / 0.5))
    assert task.success(envs.state).all()
    place(envs, nearest(envs, 0), 0, [0.0, 0.021, 0.0])
    place(envs, nearest(envs, 1), 1, [0.0, 0.019, 0.0])
    assert task.success(envs.state).tolist() == [False, True]


def test_what_is_toppled_is_no_success(envs, monkeypatch):
    """A thing that is tilted by 0.55 rad where it was, and not one that is tilted by 0.45 rad."""
    task = hold(envs, monkeypatch)
    task.held.fill_(40.0)
    for world, angle in enumerate((0.55, 0.45)):
        place(envs, nearest(envs, world), world, [0.0, 0.0, 0.0], [math.cos(angle / 2), math.sin(angle / 2), 0.0, 0.0])
    assert task.success(envs.state).tolist() == [False, True]


def reach_for(envs: SceneVectorEnv, monkeypatch: pytest.MonkeyPatch, over: float) -> None:
    """Say that the tool is at the grasp, or `over` it [m], turned as it is."""
    task: Any = envs.task
    turned = task.arm.tool(envs.state)[:, 3:].clone()
    raised = torch.tensor([0.0, 0.0, module.GRASP_HEIGHT + over])
    monkeypatch.setattr(task.arm, "tool", lambda s: torch.cat([s.pose("target")[:, :3] + raised, turned], dim=1))


def test_fingers_that_press_on_the_peg_do_not_grasp_it(envs, monkeypatch):
    """Both touch it there as well, with the tips on its top: that is worth less than a third of a grasp."""
    task = hold(envs, monkeypatch)
    terms = {}
    for over in (0.0, 0.034):
        reach_for(envs, monkeypatch, over)
        terms[over] = task.reward(envs.state, torch.zeros(2, 5))
    assert (terms[0.034]["grasping"] < 0.3 * terms[0.0]["grasping"]).all()


def test_terms_of_the_reward(envs, monkeypatch):
    """Lifting and holding count less, the more else was moved."""
    task = hold(envs, monkeypatch)
    reach_for(envs, monkeypatch, 0.0)
    place(envs, nearest(envs, 0), 0, [0.01, 0.0, 0.0])
    place(envs, nearest(envs, 1), 1, [0.05, 0.0, 0.0])
    terms = task.reward(envs.state, torch.ones(2, 5))
    assert terms["reaching"].tolist() == pytest.approx([0.02, 0.02], rel=1e-3)
    assert terms["aligning"].tolist() == pytest.approx([0.02 * share for share in alignment(envs)], rel=1e-3)
    assert terms["grasping"].tolist() == pytest.approx([0.04, 0.04], rel=1e-3)
    assert terms["lifting"].tolist() == pytest.approx([0.08 * 0.6, 0.08 * 0.2], rel=1e-3)
    assert terms["holding"].tolist() == pytest.approx([0.1 * 0.6, 0.1 * 0.2], rel=1e-3)
    assert terms["disturbing"].tolist() == pytest.approx([-0.005, -0.01], rel=1e-3)
    assert terms["effort"].tolist() == pytest.approx([-0.001, -0.001])
    place(envs, "target", 0, [0.0, 0.0, -1.0])
    assert task.terminated(envs.state).tolist() == [True, False]


def scripted(envs: SceneVectorEnv, down: Tensor, closed: Tensor) -> Tensor:
    """Return actions that go over the clear grasp, down to it, close (counted in `closed`) and go up."""
    task: Any = envs.task
    s = envs.state
    grasp, tool, lead = s.grasp("target"), task.arm.tool(s), task.arm.tool_lead(s)
    away = s.pose("target")[:, :3] - tool[:, :3] + torch.tensor([0.0, 0.0, module.GRASP_HEIGHT])
    yaws = [torch.atan2(2 * (q[:, 0] * q[:, 3] + q[:, 1] * q[:, 2]), 1 - 2 * (q[:, 2] ** 2 + q[:, 3] ** 2))
            for q in (grasp[:, 3:], tool[:, 3:])]  # fmt: skip
    twice = 2 * (yaws[0] - yaws[1])
    turn = 0.5 * torch.atan2(twice.sin(), twice.cos())
    down |= (away[:, :2].norm(dim=1) < 0.006) & (turn.abs() < 0.05)
    closed += (closed > 0) | (down & (away.norm(dim=1) < 0.008))
    height = torch.where(down, away[:, 2].clamp(-0.02, 0.02), away[:, 2] + 0.12)
    up = (0.15 - task.height(s)).clamp(-0.02, 0.03)
    height = torch.where(closed > 0, torch.where(closed > 10, up, 0.0), height)
    held = closed[:, None] > 0
    way = torch.cat(
        [torch.where(held, 0.0, away[:, :2]), height[:, None], torch.where(held, 0.0, turn[:, None])], dim=1
    )
    limit, step = torch.tensor([0.04, 0.04, 0.04, 0.3]), torch.tensor([TOOL_STEP] * 3 + [YAW_STEP])
    moved = ((way.clamp(-limit, limit) - lead) / step).clamp(-1, 1)
    return torch.cat([moved, torch.where(held, -1.0, 0.3)], dim=1)  # opened no wider than it has to be


@since_4("batches have no sleeping bodies")
def test_what_nothing_touches_sleeps(compiled):
    """The arm alone is awake, also in worlds that are reset later; a thing that is pushed wakes up."""
    made = SceneVectorEnv(ClutterExtract, 2, scene=compiled, autoreset_mode="Disabled", **SIZES)
    made.reset(seed=5)
    awake = made.batch.data.nv_awake
    for _ in range(3):
        made.step(torch.zeros(2, 5))
    assert awake.numpy().tolist() == [9, 9]
    qvel, dof = made.batch.data.qvel.numpy(), compiled.mjm.joint("target/free").dofadr[0]
    qvel[1, dof + 5] = 2.0  # it turns on the spot
    made.batch.data.qvel.assign(qvel)
    before = made.state.pose("target").clone()
    made.step(torch.zeros(2, 5))
    assert awake.numpy().tolist() == [9, 15]
    assert torch.equal(before[0], made.state.pose("target")[0])
    assert not torch.equal(before[1], made.state.pose("target")[1])
    made.reset(options={"reset_mask": torch.tensor([False, True])})
    made.step(torch.zeros(2, 5))
    assert awake.numpy().tolist() == [9, 9]


@pytest.mark.slow
def test_a_script_extracts(compiled):
    """By the grasp that the layout has: most worlds succeed at the last step, and their reward grows on the way."""
    made = SceneVectorEnv(ClutterExtract, 8, scene=compiled, autoreset_mode="Disabled", **SIZES)
    made.reset(seed=4)
    down, closed = torch.zeros(8, dtype=torch.bool), torch.zeros(8, dtype=torch.long)
    rewards, info = [], {}
    for _ in range(150):
        _, reward, terminated, _, info = made.step(scripted(made, down, closed))
        assert not terminated.any()
        rewards.append(reward)
    done = info["success"]
    assert done.sum() >= 6
    fifths = torch.stack(rewards).reshape(5, 30, 8).sum(dim=1)[:, done]
    assert (fifths[1:4] > fifths[:3]).all()
    assert fifths[4].min() > 3.5
