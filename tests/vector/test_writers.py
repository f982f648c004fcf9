"""Joints that a task puts somewhere, and poses that it gives to objects, by MuJoCo C: at rest, and held."""

from __future__ import annotations

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.sim.rest import RestMap, rest_map
from sceniris_gym.sim.versions import SLEEPING
from sceniris_gym.vector.task import Task
from sceniris_gym.vector.vector_env import SceneVectorEnv
from sceniris_gym.vector.writers import JointWriter
from tests.vector.stepping import oracle
from tests.vector.workshop import mjcf, mujocos, state_of, tensor
from tests.versions import since_4

STATE = ("qpos", "qvel", "ctrl", "mocap_pos", "mocap_quat", "xpos")
BLOCK = {"asset": "block", "on": "floor"}
SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "heron", "base": [0.1, -0.2, 0.3], "pitch": 20, "yaw": 35},
    "objects": {"block": BLOCK, "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor"}, "chest": BLOCK}
    | {"mark": {"kind": "marker", "on": "floor"}, "table": {"asset": "table", "kind": "static"}},
}


def test_joints_that_are_put_somewhere_are_held_there(make_env):
    """The arm of one world, through gears too: the controls are those that hold the pose; other worlds keep theirs."""
    envs = make_env(2)
    envs.reset(seed=0)
    s = envs.state
    ctrl = s.ctrl.clone()
    wanted = s.qpos("arm")[:, :2] + torch.tensor([0.3, -0.2])
    s.put_joints("arm", wanted, torch.tensor([True, False]))
    assert torch.allclose(s.qpos("arm")[0, :2], wanted[0])
    assert torch.equal(s.ctrl[1], ctrl[1])
    assert torch.allclose(s.ctrl[0, :2], wanted[0] * torch.tensor([1.0, 2.0]))
    np.testing.assert_allclose(s.site("arm/tcp")[0, :3].numpy(), oracle(envs, 0).site("arm/tcp").xpos, atol=1e-6)


def test_the_weight_of_an_arm_is_borne_where_its_joints_are_put(tmp_path):
    """By MuJoCo C's forces in the worlds of the mask; the other worlds keep their controls."""
    path = tmp_path / "arm.xml"
    path.write_text(mjcf({"base": ("mimic", "0 0 0", 30.0)}).replace('gravity="0 0 0"', 'gravity="2 -3 -8"'))
    s = state_of({"model": str(path), "robot": {"in_model": "base", "tcp": "base:point"}}, 3)
    names, ctrl = ("base:swing", "base:1", "base:run"), s.ctrl.clone()
    joints, mask = [s.mjm.joint(name).id for name in names], torch.tensor([True, False, True])
    s.put_joints(tuple(joints), tensor([[0.5, -0.7, 0.1], [0.0, 0.0, 0.0], [-0.8, 1.2, -0.1]]), mask)
    assert torch.equal(s.ctrl[1], ctrl[1])
    for world in (0, 2):
        data = mujocos(s, world)
        pulls = (data.qfrc_actuator - data.qfrc_bias)[s.mjm.jnt_dofadr[joints]]
        assert (np.abs(data.qfrc_bias[s.mjm.jnt_dofadr[joints]]) > 0.1).all()
        np.testing.assert_allclose(pulls, 0.0, atol=1e-3)


ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <worldbody>
    <body><joint name="spin"/><geom size="0.1" pos="0.3 0 0" contype="0" conaffinity="0"/>
      <body pos="0.5 0 0"><joint name="out" type="slide" axis="1 0 0"/>
        <geom size="0.1" contype="0" conaffinity="0"/></body></body>
    <body pos="0 1 0"><freejoint/><geom size="0.1" contype="0" conaffinity="0"/></body>
    <body pos="0 2 0"><joint name="other"/><geom size="0.1" pos="0.3 0 0" contype="0" conaffinity="0"/></body>
  </worldbody>
  <tendon><fixed name="sum"><joint joint="spin" coef="2"/><joint joint="out" coef="-0.5"/></fixed></tendon>
  <actuator>
    <position name="other" joint="other" kp="10"/>
    <position name="geared" joint="spin" kp="10" gear="3"/>
    <position name="over both" tendon="sum" kp="20" gear="0.5"/>
    <position name="limited" joint="out" kp="10" ctrlrange="-0.1 0.1"/>
    <motor name="motor" joint="spin"/>
    <position name="filtered" joint="spin" kp="10" gear="2" timeconst="0.05"/>
    <intvelocity name="integrated" joint="out" kp="10" actrange="-0.2 0.2"/>
    <position name="filtered elsewhere" joint="other" kp="10" timeconst="0.05"/>
  </actuator>
</mujoco>
"""


def make_data(mjm: mujoco.MjModel, nworld: int) -> mjw.Data:
    """Return data on the CPU."""
    with wp.ScopedDevice("cpu"):
        return mjw.make_data(mjm, nworld)


def at_rest(mjm: mujoco.MjModel) -> RestMap:
    """Return what holds a pose, with zeros at home."""
    return rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")


def written(names: list[str], values: list[list[float]], mask: list[bool]) -> tuple[mujoco.MjModel, dict[str, Tensor]]:
    """Put joints of worlds whose state is all sevens; return the model and the state."""
    mjm = mujoco.MjModel.from_xml_string(ARM)
    d = make_data(mjm, len(mask))
    state = {name: wp.to_torch(getattr(d, name)).fill_(7.0) for name in ("qpos", "qvel", "ctrl", "act")}
    writer = JointWriter(mjm, d, at_rest(mjm), [mjm.joint(name).id for name in names])
    writer.write(torch.tensor(values), torch.tensor(mask))
    return mjm, state


def test_actuators_of_the_written_joints_exert_nothing():
    """MuJoCo's own forces, over a gear and a tendon; one with a short range goes as far as it may."""
    mjm, state = written(["spin", "out"], [[0.4, -0.3], [1.0, 0.05]], [True, True])
    data = mujoco.MjData(mjm)
    for world in range(2):
        for name in state:
            getattr(data, name)[:] = state[name][world]
        data.qpos[3:7] = [1.0, 0.0, 0.0, 0.0]
        mujoco.mj_forward(mjm, data)
        for name in ("geared", "over both", "filtered"):
            assert data.actuator(name).force[0] == pytest.approx(0.0, abs=2e-5)
        assert data.actuator("limited").ctrl[0] == pytest.approx(-0.1 if world == 0 else 0.05)
        assert data.act_dot[0] == pytest.approx(0.0, abs=1e-4)
        assert data.act[1] == pytest.approx(-0.2 if world == 0 else 0.05)
        assert (data.joint("spin").qvel[0], data.joint("out").qvel[0]) == (0.0, 0.0)


def test_all_else_stays_as_it_is():
    """Worlds without a mask, other joints, and controls that the written joints have nothing to do with."""
    mjm, state = written(["spin"], [[0.4], [0.5], [torch.nan]], [True, False, False])
    kept = {"qpos": np.ones(mjm.nq, bool), "qvel": np.ones(mjm.nv, bool), "ctrl": np.ones(mjm.nu, bool)}
    kept["act"] = np.array([False, True, True])
    kept["qpos"][mjm.joint("spin").qposadr[0]] = kept["qvel"][mjm.joint("spin").dofadr[0]] = False
    for name in ("geared", "over both", "filtered"):
        kept["ctrl"][mjm.actuator(name).id] = False
    for name, values in state.items():
        assert (values[1:] == 7.0).all()
        np.testing.assert_array_equal(values[0].numpy() == 7.0, kept[name], err_msg=name)


DELAYED = """
<mujoco>
  <worldbody>
    <body><joint name="one"/><geom size="0.1" pos="0.3 0 0"/></body>
    <body pos="0 2 0"><joint name="two"/><geom size="0.1" pos="0.3 0 0"/></body>
  </worldbody>
  <actuator>
    <position joint="two" kp="10" delay="0.01" nsample="3"/>
    <position joint="one" kp="10" gear="2" delay="0.02" nsample="12"/>
  </actuator>
</mujoco>
"""


@since_4("mj_readCtrl has other arguments")
def test_delayed_actuators_read_the_new_control_from_the_past():
    """All that a delayed actuator remembers is the control that holds the joint; others remember what they did."""
    mjm = mujoco.MjModel.from_xml_string(DELAYED)
    data = mujoco.MjData(mjm)
    d = make_data(mjm, 2)
    history, ctrl = wp.to_torch(d.history), wp.to_torch(d.ctrl)
    history.copy_(torch.tensor(data.history, dtype=torch.float32))
    before, writer = history.clone(), JointWriter(mjm, d, at_rest(mjm), [mjm.joint("one").id])
    writer.write(torch.tensor([[0.4], [0.5]]), torch.tensor([True, False]))
    assert torch.equal(history[1], before[1])
    data.history[:], data.ctrl[:] = history[0].numpy(), ctrl[0].numpy()
    read = np.zeros((2, 1))
    for i in range(2):
        mujoco.mj_readCtrl(mjm, data, i, 0.0, read[i], -1)
    np.testing.assert_allclose(read[:, 0], [0.0, 0.8], atol=1e-6)
    assert (history[0] != before[0]).sum() == 12


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
        ("cabinet", "'cabinet' is of the kind 'fixture', which keeps its pose in the layout. Give"),
        ("table", "'table' is of the kind 'static', which keeps its pose in the layout. Give"),
        ("robot", "'robot' is a robot (set its joints with State.put_joints). Give"),
        ("heron", "'robot' is a robot"),
        (
            "cabinet/upper_drawer",
            "'cabinet/upper_drawer' is not a free or mocap body (set its joints with State.put_joints)",
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
