"""The scripted policy for demonstrations: kinematics as in MuJoCo C, joints on the path, and what it refuses."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import pytest
import torch
from torch import Tensor

from sceniris_gym import ArmController, Bounds, SceneVectorEnv, Task
from sceniris_gym.errors import ArgumentError
from sceniris_gym.training.demonstrator import Demonstrator, forward
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation

ORANGE = {"asset": "orange", "on": "floor", "reachable": "path", "region": {"box": [[0.4, -0.2], [0.55, 0.2]]}}
SCENE = {"floor": {"size": [2, 2]}, "robot": {"asset": "panda"}, "objects": {"orange": ORANGE}, "bank": 2}


class Lift(Task):
    """Lift an orange by 10 cm with a Panda, whose joint targets the action changes."""

    action_size = 8

    def bind(self, s: State) -> None:
        """Find the arm."""
        self.arm, self.box = ArmController(s), Bounds(s, ("orange",))

    def apply(self, s: State, action: Tensor) -> None:
        """Move the joints and the gripper."""
        self.arm.move_joints(s, action[:, :7])
        self.arm.grip(s, action[:, 7])

    def observe(self, s: State) -> Observation:
        """Return the joints."""
        return {"policy": {"joints": self.arm.qpos(s), "width": self.arm.width(s)}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the height."""
        return {"height": self.box.lowest(s.poses(("orange",)))[:, 0]}

    def success(self, s: State) -> Tensor:
        """Return whether the orange is up."""
        return self.box.lowest(s.poses(("orange",)))[:, 0] > 0.1


def off_polyline(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the distance (max norm) of each point (n, j) from the nearest of many samples of a polyline (k, j)."""
    pieces = [a + np.linspace(0, 1, 400)[:, None] * (b - a) for a, b in pairwise(corners)]
    return np.abs(points[:, None] - np.concatenate(pieces)).max(axis=2).min(axis=1)


def test_joints_follow_the_path_to_the_grasp_and_lift():
    """The joints of each world stay near its polyline, and MuJoCo C finds the tool at the grasp before it closes."""
    task = Lift()
    envs = SceneVectorEnv(task, 2, scene=SCENE, device="cpu", autoreset_mode="Disabled", max_episode_steps=160)
    demonstrator, s = Demonstrator(envs, ["orange"]), envs.state
    envs.reset(seed=5)
    corners, grasp = s.path("orange")[0].numpy().copy(), s.grasp("orange").numpy().copy()
    with torch.no_grad():
        demonstrator.start()
        visited, widths = [], []
        for _ in range(160):
            action = demonstrator.act()
            assert (action.abs() <= 1.0).all()
            _, _, _, _, info = envs.step(action)
            visited.append(s.qpos("panda")[:, :7].numpy().copy())
            widths.append(task.arm.width(s).numpy().copy())
    assert info["success"].all()
    visited, widths = np.array(visited), np.array(widths)
    data, mjm = mujoco.MjData(s.mjm), s.mjm
    for world in range(2):
        last = 1 + np.flatnonzero(np.diff(widths[:, world]) > -1e-4)[-1]
        closing = np.flatnonzero(np.diff(widths[:, world]) < -1e-3)
        grasped = closing[closing < last][0]  # the first step in which the gripper closes
        assert off_polyline(visited[:grasped, world], corners[world]).max() < 0.03
        data.qpos[:7] = visited[grasped, world]
        mujoco.mj_kinematics(mjm, data)
        assert np.linalg.norm(data.site("panda/tcp").xpos - grasp[world, :3]) < 0.003
    reaching = envs.compiled.reaching
    assert reaching is not None
    random = torch.rand(20, 7) - torch.tensor([0.5] * 3 + [2.0] + [0.5] * 3)
    for qpos, pose in zip(random, forward(reaching.arms[0].arm, random), strict=True):
        data.qpos[:7] = qpos
        mujoco.mj_kinematics(mjm, data)
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, data.site("panda/tcp").xmat)
        np.testing.assert_allclose(pose[:3], data.site("panda/tcp").xpos, atol=1e-5)
        assert abs(quat @ pose[3:].numpy()) > 1 - 1e-5
    envs.close()


def test_objects_of_two_robots_are_refused():
    """One arm grasps the targets of a task."""
    robots = {side: {"asset": "panda", "base": [x, 0, 0]} for side, x in (("left", 0.0), ("right", 1.0))}
    near = {f"{side}_orange": {**ORANGE, "reachable": "map", "by": side} for side in robots}

    class Both(Lift):
        def bind(self, s: State) -> None:
            self.arm, self.box = ArmController(s, "left"), Bounds(s, ("left_orange",))

        def observe(self, s: State) -> Observation:
            return {"policy": {"joints": self.arm.qpos(s)}}

    scene = {"floor": {"size": [3, 2]}, "robots": robots, "objects": near, "bank": 2}
    envs = SceneVectorEnv(Both(), 1, scene=scene, device="cpu")
    with pytest.raises(ArgumentError, match="one robot should reach all of left_orange, right_orange"):
        Demonstrator(envs, ["left_orange", "right_orange"])
