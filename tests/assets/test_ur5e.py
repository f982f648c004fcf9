"""The UR5e: published kinematics and limits."""

from __future__ import annotations

import mujoco
import numpy as np

from tests.assets.geometry import load, shift, turn

# Universal Robots' published table (standard Denavit-Hartenberg): d [m], a [m], alpha [rad]; and the limits [rad].
DH = [
    (0.1625, 0.0, np.pi / 2),
    (0.0, -0.425, 0.0),
    (0.0, -0.3922, 0.0),
    (0.1333, 0.0, np.pi / 2),
    (0.0997, 0.0, -np.pi / 2),
    (0.0996, 0.0, 0.0),
]
LIMITS = np.pi * np.array([2, 2, 1, 2, 2, 2])
TCP = 0.128  # m from the flange


def test_forward_kinematics_follow_the_published_table():
    """The TCP is where Rz(q) Tz(d) Tx(a) Rx(alpha) over the joints, and the gripper's length, put it, to 1e-6."""
    model, data = load("ur5e")
    generator = np.random.default_rng(3)
    for _ in range(50):
        data.qpos[:6] = generator.uniform(-LIMITS, LIMITS)
        mujoco.mj_kinematics(model, data)
        frame = np.eye(4)
        for (d, a, alpha), angle in zip(DH, data.qpos, strict=False):
            frame = frame @ turn(2, angle) @ shift(a, 0, d) @ turn(0, alpha)
        tcp = frame @ shift(0, 0, TCP)
        np.testing.assert_allclose(data.body("hand").xpos, frame[:3, 3], atol=1e-6)
        np.testing.assert_allclose(data.site("tcp").xpos, tcp[:3, 3], atol=1e-6)
        np.testing.assert_allclose(data.site("tcp").xmat.reshape(3, 3), tcp[:3, :3], atol=1e-6)


def test_joints_have_the_published_limits_and_torques():
    """Six hinges of +-360 degrees, the elbow's +-180; 150 and 28 N m; commands stay within the limits."""
    model, _ = load("ur5e")
    assert [model.joint(i).name for i in range(6)] == [f"joint{i}" for i in range(1, 7)]
    np.testing.assert_allclose(model.jnt_range[:6], np.transpose([-LIMITS, LIMITS]), atol=1e-8)
    assert [model.actuator(i).name for i in range(model.nu)] == [*(f"joint{i}" for i in range(1, 7)), "gripper"]
    np.testing.assert_allclose(model.actuator_forcerange[:6, 1], [150] * 3 + [28] * 3)
    np.testing.assert_allclose(model.actuator_ctrlrange[:6], model.jnt_range[:6])
