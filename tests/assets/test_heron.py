"""Heron: kinematics with a closed form, and a base and a wrist that do not turn all the way."""

from __future__ import annotations

import mujoco
import numpy as np

from tests.assets.geometry import load


def test_the_wrist_is_spherical_and_shoulder_and_elbow_are_parallel():
    """At any angles axes 1 and 2 meet, 2 and 3 are parallel 0.32 m apart, and 4, 5 and 6 meet 0.30 m from axis 3."""
    model, data = load("heron")
    generator = np.random.default_rng(4)
    for _ in range(20):
        data.qpos[:6] = generator.uniform(*model.jnt_range[:6].T)
        mujoco.mj_kinematics(model, data)
        anchor, axis = data.xanchor[:6], data.xaxis[:6]
        np.testing.assert_allclose(anchor[1], [0, 0, 0.24], atol=1e-9)
        np.testing.assert_allclose(axis[1], axis[2], atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(anchor[2] - anchor[1]), 0.32, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(anchor[3] - anchor[2]), 0.30, atol=1e-9)
        np.testing.assert_allclose(np.cross(anchor[3] - anchor[2], axis[3]), 0.0, atol=1e-9)
        np.testing.assert_allclose(anchor[4:], anchor[[3, 3]], atol=1e-9)
        np.testing.assert_allclose(data.site("tcp").xpos, anchor[5] + 0.18 * axis[5], atol=1e-9)


def test_base_and_wrist_have_less_than_a_full_turn():
    """Joint 1 goes to +-150 degrees, joint 6 to +-160, and commands go no further."""
    model, _ = load("heron")
    np.testing.assert_allclose(np.degrees(model.jnt_range[:6, 1]), [150, 115, 150, 170, 115, 160], atol=1e-6)
    np.testing.assert_allclose(model.jnt_range[:6, 0], -model.jnt_range[:6, 1])
    np.testing.assert_allclose(model.actuator_ctrlrange[:6], model.jnt_range[:6])
