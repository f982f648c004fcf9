"""The weight of arms against MuJoCo C's dynamics."""

from __future__ import annotations

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


def test_the_sag_of_hinges_and_slides_is_mujocos(state):
    """The force of gravity less `qfrc_gravcomp`, times the compliance of each joint."""
    arm = ArmController(state)
    compliance = np.array([0.5, 2.0, 3.0, 1.0])
    found = ArmWeight(state, arm.joint_ids, compliance).sag().numpy()
    dofs = state.mjm.jnt_dofadr[list(arm.joint_ids)]
    for world in range(2):
        data = mujocos(state, world)
        load = (data.qfrc_gravcomp - data.qfrc_bias)[dofs]
        assert (np.abs(load[:3]) > 0.05).all()
        np.testing.assert_allclose(found[world], compliance * load, atol=1e-5)


def test_joints_sag_from_their_targets_by_the_weight(state):
    """In MuJoCo C, at rest, by the compliances of actuators with gears and tendons; fingers move a little."""
    arm, data = ArmController(state), mujocos(state)
    qpos = arm.qpos(state).clone()
    arm.set_targets(state, qpos - arm._weight.sag())
    data.ctrl[:] = state.ctrl[0].numpy()
    mujoco.mj_step(state.mjm, data, 2000)
    np.testing.assert_allclose(data.qpos[state.mjm.jnt_qposadr[list(arm.joint_ids)]], qpos[0], atol=5e-4)


def test_an_arm_whose_weight_is_borne_has_none():
    """`gravcomp` of 1 in the shipped Panda."""
    s = state_of({"robot": {"asset": "panda"}})
    arm = ArmController(s)
    assert not arm._weight.acts
    assert not arm._weight.sag().any()
