"""Updates of fields that follow from others, against MuJoCo C."""

from __future__ import annotations

import copy

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.sim.derived import (
    FOLLOWERS,
    CameraReferences,
    Follower,
    HoldingControls,
    LightReferences,
    SubtreeMasses,
)
from sceniris_gym.sim.rest import rest_map

NWORLD = 6
MASK = np.array([True, False, True, True, False, True])

SCENE = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <light name="sun" pos="0 0 3" dir="0.1 0 -1"/>
    <camera name="room" pos="0 -1 1" xyaxes="1 0 0 0 0.6 0.8"/>
    <body name="base" pos="0.1 0 0.3" euler="20 10 0"><joint name="turn" axis="0 0 1"/><geom size="0.1" pos="0.1 0 0"/>
      <camera name="hand" pos="0.02 0 0.1" euler="10 30 0" mode="trackcom"/>
      <body name="arm" pos="0.3 0 0" euler="0 0 30"><joint name="lift" axis="0 1 0"/><geom size="0.05" pos="0.1 0.1 0"/>
        <light name="torch" pos="0 0 0.1" dir="1 0 -0.2" mode="targetbodycom" target="base"/></body>
      <body name="hollow" pos="0 0 0.5"/></body>
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


def perturbed(mjm: mujoco.MjModel, fields: tuple[str, ...], seed: int) -> mujoco.MjModel:
    """Return a copy of a model in which all sources differ."""
    rng, mjm = np.random.default_rng(seed), copy.copy(mjm)
    for name in fields:
        array = getattr(mjm, name)
        array += rng.uniform(0.1, 0.4, array.shape) * (np.abs(array) + 0.01 * (name != "body_mass"))
        if name.endswith("quat"):
            array /= np.linalg.norm(array, axis=-1, keepdims=True)
    return mjm


def follow(kind: type[Follower], mjm: mujoco.MjModel, models: list[mujoco.MjModel]) -> tuple[mjw.Model, mjw.Data]:
    """Return a Model with the sources of a model in each world, and the outputs brought up to date in some."""
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.make_data(mjm, NWORLD)
        for name in kind.SOURCES + kind.OUTPUTS:
            array = getattr(m, name)
            rows = np.stack([getattr(each, name) for each in (models if name in kind.SOURCES else [mjm] * NWORLD)])
            setattr(m, name, wp.array(rows.reshape(NWORLD, *array.numpy().shape[1:]), dtype=array.dtype))
        kind(mjm, m, d, rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")).launch(wp.array(MASK, dtype=wp.bool))
    return m, d


@pytest.mark.parametrize("kind", [SubtreeMasses, CameraReferences, LightReferences])
def test_outputs_are_those_of_mujoco(kind: type[Follower]):
    """Of masked worlds; the others keep theirs."""
    mjm = build()
    models = [perturbed(mjm, kind.SOURCES, seed) for seed in range(NWORLD)]
    m, _ = follow(kind, mjm, models)
    for world, model in enumerate(models):
        expected = model if MASK[world] else mjm
        mujoco.mj_setConst(model, mujoco.MjData(model))
        for name in kind.OUTPUTS:
            found, wanted = getattr(m, name).numpy()[world], getattr(expected, name)
            np.testing.assert_allclose(found, wanted.reshape(found.shape), rtol=1e-5, atol=1e-6, err_msg=name)


def test_controls_follow_gains_where_they_held_the_pose():
    """No force at the present pose afterwards; a control that somebody else has set stays, and so do other worlds."""
    mjm = build()
    models = [perturbed(mjm, HoldingControls.SOURCES, seed) for seed in range(NWORLD)]
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.make_data(mjm, NWORLD)
        qpos = np.random.default_rng(0).uniform(-1.0, 1.0, (NWORLD, 2)).astype(np.float32)
        d.qpos.assign(qpos)
        rest = rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")
        follower = HoldingControls(mjm, m, d, rest)
        everywhere = wp.ones(NWORLD, dtype=wp.bool)
        held = np.stack([qpos[:, 0] * 2.0, (5.0 * qpos[:, 1] - 0.4) / 3.0, 0.0 * qpos[:, 0]], axis=1)
        d.ctrl.assign(held)
        d.act.assign(held[:, 1:2])
        follower.launch(everywhere)
        np.testing.assert_allclose(d.ctrl.numpy(), held, atol=1e-6)
        for name in HoldingControls.SOURCES:
            array, rows = getattr(m, name), np.stack([getattr(each, name) for each in models])
            setattr(m, name, wp.array(rows, dtype=array.dtype))
        d.ctrl.numpy()[2, 0] = 7.0
        before = d.ctrl.numpy().copy()
        follower.launch(wp.array(MASK, dtype=wp.bool))
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


def test_every_follower_names_fields_of_the_model():
    """Of mujoco_warp's, so that each can have a row for each world."""
    m = mjw.put_model(build())
    for kind in FOLLOWERS:
        assert all(hasattr(m, name) for name in kind.OUTPUTS)
