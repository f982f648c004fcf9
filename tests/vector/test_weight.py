"""The weight of arms against MuJoCo C's dynamics."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest

from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.weight import ArmWeight
from tests.vector.workshop import mjcf, mujocos, state_of


@pytest.fixture(scope="module")
def state(tmp_path_factory):
    """Return worlds with an arm of hinges and a slide, under gravity that is aslant, part of which `gravcomp` bears."""
    path = tmp_path_factory.mktemp("weight") / "arm.xml"
    text = mjcf({"base": ("two actuators", "0.1 0 0", 30.0)}).replace('gravity="0 0 0"', 'gravity="2 -3 -8"')
    path.write_text(text.replace('<body name="base:quill"', '<body name="base:quill" gravcomp=".4"'))
    s = state_of({"model": str(path), "robot": {"in_model": "base", "tcp": "base:point"}})
    s.data.qpos.assign(np.random.default_rng(0).uniform(-0.2, 0.2, (2, s.mjm.nq)))
    s._batch.update()
    return s


def loads_of(s, arm, data) -> np.ndarray:
    """Return MuJoCo's loads of gravity, less what `gravcomp` bears, on the joints of an arm at rest."""
    return (data.qfrc_gravcomp - data.qfrc_bias)[s.mjm.jnt_dofadr[list(arm.joint_ids)]]


def test_the_loads_of_hinges_and_slides_are_mujocos(state):
    """The force of gravity less `qfrc_gravcomp`."""
    arm = ArmController(state)
    found = ArmWeight(state, arm.joint_ids).loads().numpy()
    for world in range(2):
        load = loads_of(state, arm, mujocos(state, world))
        assert (np.abs(load[:3]) > 0.05).all()
        np.testing.assert_allclose(found[world], load, atol=1e-5)


def test_joints_are_where_their_targets_without_loads_are(state):
    """In MuJoCo C, at rest, by the stiffness of actuators with gears and tendons; fingers move a little."""
    arm, data = ArmController(state), mujocos(state)
    qpos, still = arm.qpos(state).clone(), arm.qvel(state)
    loads = arm._weight.loads()
    arm.set_targets(state, arm._actuators.within_force(state, qpos, qpos, still, loads))
    data.ctrl[:] = state.ctrl[0].numpy()
    mujoco.mj_step(state.mjm, data, 2000)
    np.testing.assert_allclose(data.qpos[state.mjm.jnt_qposadr[list(arm.joint_ids)]], qpos[0], atol=5e-4)


def test_an_arm_whose_weight_is_borne_has_none():
    """`gravcomp` of 1 in the shipped Panda, unless a task writes it."""
    s = state_of({"robot": {"asset": "panda"}})
    arm = ArmController(s)
    assert not arm._weight.acts
    assert not arm._weight.loads().any()
    s = state_of({"robot": {"asset": "panda"}})
    s.model_field("body_gravcomp")[1] = 0.5
    arm = ArmController(s)
    assert arm._weight.acts
    mjm = copy.copy(s.mjm)
    mjm.body_gravcomp[:] = 0.5
    found = arm._weight.loads().numpy()
    assert not found[0].any()
    np.testing.assert_allclose(found[1], loads_of(s, arm, mujocos(s, 1, mjm)), atol=1e-4)
