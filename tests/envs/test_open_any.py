"""OpenAny-v0: what it observes and rewards, and a script that opens drawers, doors and lids."""

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
from sceniris_gym.vector import rotations
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated

module = importlib.import_module("sceniris_gym.envs.open_any")
NUM = 12


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("open_any", {"bank": 8}), "cpu")


def test_the_docstring_lists_what_is_observed(compiled: CompiledScene):
    """Names, shapes and sizes, and how many units each split has."""
    envs = gymnasium.make_vec("sceniris_gym/OpenAny-v0", num_envs=1, scene=compiled)
    assert isinstance(envs, SceneVectorEnv)
    assert envs.max_episode_steps == 250
    check_stated(module.OpenAny, envs, [("position", (1,)), ("touching", (2,))])
    group = compiled.config.groups["unit"]
    assert [np.count_nonzero(group.weights_in(split)) for split in ("train", "eval")] == [19, 5]


def test_turned_by_half_a_turn_a_gripper_is_the_same():
    """The way between two poses is the shorter one of two, by SciPy's rotations."""
    from scipy.spatial.transform import Rotation

    generator = np.random.default_rng(0)
    one, other = (Rotation.random(50, random_state=generator) for _ in range(2))
    flips = [Rotation.from_euler("z", angle) for angle in (0.0, np.pi)]
    ways = np.stack([(other * flip * one.inv()).magnitude() for flip in flips]).min(axis=0)
    poses = [
        torch.tensor(np.hstack([np.zeros((50, 3)), turn.as_quat(scalar_first=True)]), dtype=torch.float32)
        for turn in (one, other)
    ]
    found = module.between(*poses)[:, 3:].norm(dim=1).numpy()
    np.testing.assert_allclose(found, 2.0 * np.sin(0.5 * ways), atol=1e-5)


def openings(envs: SceneVectorEnv) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the axis of each world's opening, a point of it in the base frame, and whether it is a hinge."""
    scene, members = envs.compiled.scene, envs.compiled.config.variants["unit"]
    axes, points, hinges = [], [], []
    for variant in envs.state.variant("unit").tolist():
        joint = scene.joints(members[variant])["opening"]
        body = scene.mjm.jnt_bodyid[joint]
        axes.append(scene.mjm.jnt_axis[joint])
        points.append(scene.mjm.body_pos[body] + scene.mjm.jnt_pos[joint])
        hinges.append(scene.mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE)
    root = envs.state.pose("unit")
    found = (torch.tensor(np.array(each), dtype=torch.float32) for each in (axes, points))
    axis, point = (rotations.rotate(root[:, 3:], each) for each in found)
    return axis, root[:, :3] + point, torch.tensor(hinges)


def further(pose: torch.Tensor, envs: SceneVectorEnv, metres: float, angle: float) -> torch.Tensor:
    """Return where poses would be with each world's joint further open."""
    axis, point, hinge = openings(envs)
    turn = rotations.of_vector(angle * axis)
    swung = point + rotations.rotate(turn, pose[:, :3] - point)
    place = torch.where(hinge[:, None], swung, pose[:, :3] + metres * axis)
    quat = torch.where(hinge[:, None], rotations.multiply(turn, pose[:, 3:]), pose[:, 3:])
    return torch.cat([place, quat], dim=1)


def touched(envs: SceneVectorEnv) -> np.ndarray:
    """Return whether each finger touches the part that opens, by the contacts of the simulation, shape (NUM, 2)."""
    scene, mjm, contact = envs.compiled.scene, envs.compiled.sim_mjm, envs.batch.data.contact
    members = envs.compiled.config.variants["unit"]
    found = np.zeros((NUM, 2))
    number = int(envs.batch.data.nacon.numpy()[0])
    for geoms, world in zip(contact.geom.numpy()[:number], contact.worldid.numpy()[:number], strict=True):
        joint = scene.joints(members[int(envs.state.variant("unit")[world])])["opening"]
        bodies = {mjm.body(mjm.geom_bodyid[geom]).name for geom in geoms}
        for finger, name in enumerate(module.FINGERS):
            if bodies == {name, mjm.body(mjm.jnt_bodyid[scene.sim_joint(joint)]).name}:
                found[world, finger] = 1.0
    return found


@pytest.mark.slow
def test_a_script_opens_what_is_there(compiled: CompiledScene):
    """Before the handle, to it, close, and along the joint: most worlds end open, and rewards grow."""
    envs = SceneVectorEnv(module.OpenAny, NUM, scene=compiled, autoreset_mode="Disabled")
    envs.reset(seed=0)
    task: Any = envs.task
    rewards, opened = [], torch.zeros(NUM, dtype=torch.bool)

    def go(steps: int, gripper: float, back: float = 0.0, ahead: tuple[float, float] = (0.0, 0.0)) -> None:
        nonlocal opened
        total = torch.zeros(NUM)
        for _ in range(steps):
            wanted = further(task.grasp(envs.state), envs, *ahead)
            approach = rotations.axes(wanted[:, 3:])[:, 3:]
            wanted[:, :3] -= back * approach
            way = module.between(task.arm.tool(envs.state), wanted)
            action = torch.full((NUM, 7), gripper)
            action[:, :6] = (way * torch.tensor([10.0] * 3 + [3.0] * 3)).clamp(-1.0, 1.0)
            total += envs.step(action)[1]
            opened |= task.success(envs.state)
        rewards.append(total / steps)

    go(60, 1.0, back=0.1)
    go(40, 1.0)
    go(15, -1.0)
    np.testing.assert_array_equal(task.touching(envs.state).numpy(), touched(envs))
    assert task.touching(envs.state).all(dim=1).float().mean() >= 0.6
    go(90, -1.0, ahead=(0.06, 0.15))
    assert opened.float().mean() >= 0.6
    assert (rewards[-1] > rewards[0]).float().mean() >= 0.6
