"""Poses that a task gives to objects: where MuJoCo C has the bodies after it, and what stays as it is."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.sim.versions import SLEEPING
from sceniris_gym.vector.task import Task
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.workshop import mujocos, state_of, tensor

STATE = ("qpos", "qvel", "ctrl", "mocap_pos", "mocap_quat", "xpos")
BLOCK = {"asset": "block", "on": "floor"}
SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "heron", "base": [0.1, -0.2, 0.3], "pitch": 20, "yaw": 35},
    "objects": {"block": BLOCK, "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor"}, "chest": BLOCK}
    | {"mark": {"kind": "marker", "on": "floor"}, "table": {"asset": "table", "kind": "static"}},
}


def world_pose(base: tuple[np.ndarray, np.ndarray], pose: np.ndarray) -> np.ndarray:
    """Return a pose in the world frame that is given in the frame of a base, by MuJoCo's own functions."""
    pos, quat = np.zeros(3), np.zeros(4)
    mujoco.mju_mulPose(pos, quat, *base, pose[:3].astype(float), pose[3:] / np.linalg.norm(pose[3:]))
    return np.array([*pos, *quat])


def arrays(s: Any) -> dict[str, np.ndarray]:
    """Copy the state of the worlds to the host."""
    return {name: getattr(s.data, name).numpy().copy() for name in STATE}


@pytest.mark.parametrize("drawn", [False, True])
@pytest.mark.parametrize("name", ["block", "mark"])
def test_the_body_is_where_it_was_put_in_the_masked_worlds_alone(name, drawn):
    """In the frame of a base that is tilted, or drawn; quaternions of any length will do."""
    s = state_of(SCENE | {"robot": {"asset": "heron", "on": "floor"}} if drawn else SCENE, 3)
    if drawn:  # turned and moved as by a layout
        base = s.mjm.body_mocapid[s.scene.bodies["robot"]]
        quats, places = s.data.mocap_quat.numpy(), s.data.mocap_pos.numpy()
        quats[:, base], places[:, base] = [[1, 0, 0, 0], [0.6, 0, 0, 0.8], [0, 0, 0, 1]], [[0.5, 0.1, 0.2]]
        s.data.mocap_quat.assign(quats)
        s.data.mocap_pos.assign(places)
        s._batch.update()
    s.data.qvel.fill_(2.0)
    before = arrays(s)
    pose = np.random.default_rng(0).normal(size=(3, 7)).astype(np.float32)
    s.put_pose(name, torch.tensor(pose), torch.tensor([True, False, True]))
    after, body = arrays(s), s.scene.bodies[name]
    for world in (0, 2):
        data = mujocos(s, world)
        root = data.body(s.scene.bodies["robot"])
        expected = world_pose((root.xpos, root.xquat), pose[world])
        np.testing.assert_allclose(data.xpos[body], expected[:3], atol=2e-6)
        assert abs(data.xquat[body] @ expected[3:]) == pytest.approx(1.0, abs=1e-6)
        np.testing.assert_allclose(s.pose(name)[world, :3], pose[world, :3], atol=2e-6)
        np.testing.assert_allclose(s.data.xpos.numpy()[world, body], data.xpos[body], atol=1e-6)
    own = np.isin(s.mjm.dof_bodyid, s.scene.subtree(name))
    assert (after["qvel"][[0, 2]][:, own] == 0.0).all()
    assert (after["qvel"][:, ~own] == 2.0).all()
    for array, values in before.items():
        np.testing.assert_array_equal(after[array][1], values[1], err_msg=array)
    others = np.delete(np.arange(s.mjm.nbody), s.scene.subtree(name))
    np.testing.assert_array_equal(after["xpos"][:, others], before["xpos"][:, others])


def test_worlds_with_a_nan_or_without_a_rotation_stay_as_they_are():
    """As with `put_joints`."""
    s = state_of(SCENE, 3)
    before, pose = arrays(s), torch.zeros(3, 7)
    pose[0, 3], pose[0, 0], pose[1, 4] = 1.0, torch.nan, torch.inf
    s.put_pose("block", pose, torch.ones(3, dtype=torch.bool))
    for array, values in arrays(s).items():
        np.testing.assert_array_equal(values, before[array], err_msg=array)


MODEL = """
<mujoco><worldbody>
  <body name="red cup" pos="0 0 .1"><freejoint/><geom size=".03"/>
    <body name="lid"><joint type="slide" axis="0 0 1" range="0 .1"/><geom size=".01" pos="0 0 .05"/></body></body>
  <body name="ball" pos="1 0 .1"><freejoint/><geom size=".03"/></body>
  <body name="target" mocap="true"><geom size=".03" contype="0" conaffinity="0"/></body>
  <body name="wall" pos="2 0 0"><geom type="box" size=".1 .1 .1"/></body>
</worldbody></mujoco>
"""


def test_bodies_of_a_model_are_put_by_either_name_and_what_they_carry_rests(tmp_path):
    """Also free and mocap bodies that are no objects; a joint inside keeps its position, at rest."""
    path = tmp_path / "cups.xml"
    path.write_text(MODEL)
    s = state_of({"model": str(path), "objects": {"cup": {"body": "red cup"}}})
    qpos = s.data.qpos.numpy()
    qpos[:, 7] = 0.04
    s.data.qpos.assign(qpos)
    s.data.qvel.fill_(1.0)
    for i, name in enumerate(("cup", "red cup", "ball", "target")):
        pose = tensor([[0.1 * i, 2.0, 3.0, 0.0, 1.0, 0.0, 0.0]] * 2)
        s.put_pose(name, pose, torch.tensor([True, False]))
        body = s.mjm.body("red cup" if name == "cup" else name).id
        np.testing.assert_allclose(mujocos(s).xpos[body], pose[0, :3], atol=1e-6)
        np.testing.assert_allclose(s.pose(name)[0], pose[0], atol=1e-6)
    np.testing.assert_array_equal(s.data.qpos.numpy()[:, 7], np.full(2, 0.04, np.float32))
    np.testing.assert_array_equal(s.data.qvel.numpy(), [[0.0] * 13, [1.0] * 13])


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("cabinet", "'cabinet' is of the kind 'fixture', which stays where the layout has it. Give"),
        ("table", "'table' is of the kind 'static', which stays where the layout has it. Give"),
        ("robot", "'robot' is a robot, of which only joints can be set, by State.put_joints. Give"),
        ("heron", "'robot' is a robot"),
        (
            "cabinet/upper_drawer",
            "'cabinet/upper_drawer' is neither free nor a mocap body; State.put_joints sets the joints",
        ),
    ],
)
def test_what_is_not_the_tasks_to_put_is_refused_by_name(name, why):
    """With the objects that can be put."""
    s = state_of(SCENE, 1)
    with pytest.raises(ArgumentError) as caught:
        s.put_pose(name, torch.zeros(1, 7), torch.ones(1, dtype=torch.bool))
    assert str(caught.value).startswith(f"scene 'scene': State.put_pose: {why}")
    assert str(caught.value).endswith("Give a free object or a marker: block, chest, mark.")
    with pytest.raises(UnknownNameError, match=r"State.put_pose: unknown body 'blok'. Did you mean 'block'\\?"):
        s.put_pose("blok", torch.zeros(1, 7), torch.ones(1, dtype=torch.bool))


class Swap(Task):
    """Put two things into the air in every reset, after they were sent to sleep."""

    action_size = 1

    def bind(self, s):
        """Make the poses that they are put to, and what is kept of those that they had."""
        self.poses = torch.tensor([[0.0, 0.3, 0.5, 1.0, 0.0, 0.0, 0.0], [0.2, 0.3, 0.5, 1.0, 0.0, 0.0, 0.0]])
        self.poses = self.poses.to(s.device).repeat(s.num_envs, 1, 1)
        self.before = torch.zeros_like(self.poses)

    def apply(self, s, action):
        """Do nothing."""

    def on_reset(self, s, mask):
        """Put the members of a group, of which one is present."""
        self.before.copy_(s.poses(("one", "two")))
        for i, name in enumerate(("one", "two")):
            s.sleep((name,), mask)
            s.put_pose(name, self.poses[:, i], mask)

    def observe(self, s):
        """Show where they are."""
        return {"policy": {"poses": s.poses(("one", "two"))}}

    def reward(self, s, action):
        """Reward nothing."""
        return {"nothing": torch.zeros(s.num_envs, device=s.device)}

    def success(self, s):
        """Achieve nothing."""
        return torch.zeros(s.num_envs, dtype=torch.bool, device=s.device)


class Asleep(Swap):
    """The same where bodies can sleep."""

    options = SLEEPING


GROUP = {"floor": {"size": [1.0, 1.0]}, "objects": {"one": BLOCK, "two": BLOCK}} | {
    "groups": {"either": {"of": ["one", "two"], "count": [1, 1]}}
}


@pytest.mark.parametrize("kind", [Swap, Asleep])
def test_absent_members_of_a_group_stay_parked_and_the_present_ones_are_awake(kind):
    """In a reset, and in the step after it: what was put in the air falls, also where it had been sent to sleep."""
    envs = SceneVectorEnv(kind, 16, scene=GROUP, overrides={"bank": 8}, device="cpu")
    obs, _ = envs.reset(seed=0)
    s, task, poses = envs.state, envs.task, obs["policy"].reshape(16, 2, 7)
    present = s.present(("one", "two"))
    assert (present.sum(dim=1) == 1).all()
    assert present.any(dim=0).all()
    np.testing.assert_allclose(poses[:, :, 2][present], 0.5, atol=1e-6)
    np.testing.assert_allclose(poses[:, 1, 0][present[:, 1]], 0.2, atol=1e-6)
    assert isinstance(task, Swap)
    torch.testing.assert_close(poses[~present], task.before[~present], rtol=0, atol=0)
    assert (poses[~present][:, 0] > 30.0).all()
    for _ in range(20):
        obs, *_ = envs.step(torch.zeros(16, 1))
    assert (obs["policy"].reshape(16, 2, 7)[:, :, 2][present] < 0.45).all()


@pytest.mark.cuda
def test_a_reset_that_puts_poses_can_be_captured_with_torch():
    """A step with its resets replays as one CUDA graph, in which nothing waits, and things are put anew each time."""
    envs = SceneVectorEnv(Swap, 8, scene=GROUP, overrides={"bank": 8}, device="cuda:0", max_episode_steps=3)
    envs.reset(seed=0)
    action = torch.zeros(8, 1, device="cuda")
    for _ in range(3):  # compiles and loads all that the capture needs
        envs.step(action)
    stream, graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()
    torch.cuda.synchronize()
    with torch.cuda.graph(graph, stream=stream):
        warp_stream = wp.stream_from_torch(torch.cuda.current_stream())
        with wp.ScopedStream(warp_stream, sync_enter=False), wp.ScopedCapture(stream=warp_stream, external=True):
            observation, *_ = envs.step(action)
    heights = []
    for _ in range(6):
        graph.replay()
        present = envs.state.present(("one", "two"))
        heights.append(observation["policy"].reshape(8, 2, 7)[:, :, 2][present])
    for k, height in enumerate(heights):
        assert ((height > 0.4999) if k % 3 == 2 else (height < 0.4995)).all()
