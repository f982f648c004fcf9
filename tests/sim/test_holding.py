"""Controls that hold a pose with gains of their own, against MuJoCo C."""

from __future__ import annotations

import copy

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.sim.holding import GAINS, launch_holding
from sceniris_gym.sim.rest import rest_map

NWORLD = 6
MASK = np.array([True, False, True, True, False, True])

SCENE = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="base" pos="0.1 0 0.3" euler="20 10 0"><joint name="turn" axis="0 0 1"/><geom size="0.1" pos="0.1 0 0"/>
      <body name="arm" pos="0.3 0 0" euler="0 0 30"><joint name="lift" axis="0 1 0"/><geom size="0.05" pos="0.1 0.1 0"/>
      </body></body>
  </worldbody>
  <actuator>
    <position name="turn" joint="turn" kp="10" gear="2"/>
    <general name="lift" joint="lift" gainprm="3" biastype="affine" biasprm="0.4 -5 -1" dyntype="filter" dynprm="0.1"
      delay="0.01" nsample="3"/>
    <motor name="motor" joint="turn"/>
  </actuator>
</mujoco>
"""
OLD_SCENE = SCENE.replace('\n      delay="0.01" nsample="3"', "")


def build() -> mujoco.MjModel:
    """Return the model, without delays where MuJoCo does not know them."""
    try:
        return mujoco.MjModel.from_xml_string(SCENE)
    except ValueError:
        return mujoco.MjModel.from_xml_string(OLD_SCENE)


def perturbed(mjm: mujoco.MjModel, seed: int) -> mujoco.MjModel:
    """Return a copy of a model with gains of its own."""
    rng, mjm = np.random.default_rng(seed), copy.copy(mjm)
    for name in GAINS:
        array = getattr(mjm, name)
        array += rng.uniform(0.1, 0.4, array.shape) * (np.abs(array) + 0.01)
    return mjm


def test_controls_follow_gains_where_they_held_the_pose():
    """No force at the present pose afterwards; a control that somebody else has set stays, and so do other worlds."""
    mjm = build()
    models = [perturbed(mjm, seed) for seed in range(NWORLD)]
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.make_data(mjm, NWORLD)
        qpos = np.random.default_rng(0).uniform(-1.0, 1.0, (NWORLD, 2)).astype(np.float32)
        d.qpos.assign(qpos)
        rest = rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")
        rest.law = wp.array(np.repeat(rest.law.numpy(), NWORLD, axis=0), dtype=wp.vec2, ndim=2)
        everywhere = wp.ones(NWORLD, dtype=wp.bool)
        held = np.stack([qpos[:, 0] * 2.0, (5.0 * qpos[:, 1] - 0.4) / 3.0, 0.0 * qpos[:, 0]], axis=1)
        d.ctrl.assign(held)
        d.act.assign(held[:, 1:2])
        launch_holding(rest, m, d, everywhere)
        np.testing.assert_allclose(d.ctrl.numpy(), held, atol=1e-6)
        for name in GAINS:
            array, rows = getattr(m, name), np.stack([getattr(each, name) for each in models])
            setattr(m, name, wp.array(rows, dtype=array.dtype))
        d.ctrl.numpy()[2, 0] = 7.0
        before = d.ctrl.numpy().copy()
        launch_holding(rest, m, d, wp.array(MASK, dtype=wp.bool))
    ctrl, act = d.ctrl.numpy(), d.act.numpy()
    np.testing.assert_array_equal(ctrl[~MASK], before[~MASK])
    assert ctrl[2, 0] == 7.0
    for world in np.flatnonzero(MASK):
        data = mujoco.MjData(models[world])
        data.qpos[:], data.ctrl[:], data.act[:] = qpos[world], ctrl[world], act[world]
        mujoco.mj_forward(models[world], data)
        assert abs(data.actuator("lift").force[0]) < 1e-5
        if world != 2:
            assert abs(data.actuator("turn").force[0]) < 1e-5
