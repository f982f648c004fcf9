"""Joints that a task puts somewhere: at rest, and held there by their actuators."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.sim.rest import RestMap, rest_map
from sceniris_gym.vector.joint_writer import JointWriter
from tests.vector.stepping import oracle
from tests.versions import since_4


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
