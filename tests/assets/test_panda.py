"""The Panda: published kinematics and limits, fingers that do not sink into what they grip."""

from __future__ import annotations

from importlib.resources import files

import mujoco
import numpy as np

from tests.assets.geometry import load, shift, turn

# Franka's published table (Craig's convention): a [m], d [m], alpha [rad]; and the limits [rad].
DH = [
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
]
LOWER = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
UPPER = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
HOME = [0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4]


def flange(q: np.ndarray) -> np.ndarray:
    """The frame of joint 7, 4 x 4: the product of Rx(alpha) Tx(a) Rz(q) Tz(d) over the joints (Craig, eq. 3.6)."""
    frame = np.eye(4)
    for (a, d, alpha), angle in zip(DH, q, strict=True):
        frame = frame @ turn(0, alpha) @ shift(a, 0, 0) @ turn(2, angle) @ shift(0, 0, d)
    return frame


def test_forward_kinematics_follow_the_published_table():
    """Joint 7 and the TCP are where the table, the flange and the gripper's turn of -45 degrees put them, to 1e-6."""
    model, data = load("panda")
    generator = np.random.default_rng(3)
    for _ in range(50):
        data.qpos[:7] = generator.uniform(LOWER, UPPER)
        mujoco.mj_kinematics(model, data)
        seventh = flange(data.qpos[:7])
        np.testing.assert_allclose(data.body("link7").xpos, seventh[:3, 3], atol=1e-6)
        tcp = seventh @ shift(0, 0, 0.107) @ turn(2, -np.pi / 4) @ shift(0, 0, 0.1034)
        np.testing.assert_allclose(data.site("tcp").xpos, tcp[:3, 3], atol=1e-6)
        np.testing.assert_allclose(data.site("tcp").xmat.reshape(3, 3), tcp[:3, :3], atol=1e-6)


def test_joints_have_the_published_limits_and_torques():
    """Seven hinges with Franka's limits, 87 and 12 N m; two fingers of 0.04 m; commands stay within the limits."""
    model, _ = load("panda")
    assert [model.joint(i).name for i in range(model.njnt)] == [
        *(f"joint{i}" for i in range(1, 8)),
        "finger_joint1",
        "finger_joint2",
    ]
    np.testing.assert_allclose(model.jnt_range[:7], np.transpose([LOWER, UPPER]), atol=1e-9)
    np.testing.assert_allclose(model.jnt_range[7:], [[0, 0.04], [0, 0.04]], atol=1e-9)
    assert [model.actuator(i).name for i in range(model.nu)] == [*(f"joint{i}" for i in range(1, 8)), "gripper"]
    np.testing.assert_allclose(model.actuator_forcerange[:7, 1], [87] * 4 + [12] * 3)
    np.testing.assert_allclose(model.actuator_ctrlrange[:7], model.jnt_range[:7])


def test_the_start_pose_is_the_usual_one():
    """`home` has the arm bent over its workspace and the gripper open, and is commanded."""
    model, _ = load("panda")
    np.testing.assert_allclose(model.key("home").qpos, [*HOME, 0.04, 0.04], atol=1e-6)
    np.testing.assert_allclose(model.key("home").ctrl, [*HOME, 0.04], atol=1e-6)


def test_fingers_do_not_sink_into_what_they_grip():
    """At 5 ms a step they close on a light box off their middle: slower than 0.5 m/s, never 4 mm deep in it."""
    spec = mujoco.MjSpec.from_file(str(files("sceniris_gym.assets") / "panda.xml"))
    spec.delete(spec.keys[0])
    model, data = load("panda")
    hand = data.body("hand").xmat.reshape(3, 3)
    box = spec.worldbody.add_body(
        name="box", pos=data.site("tcp").xpos + 0.008 * hand[:, 1], quat=data.body("hand").xquat, gravcomp=1
    )
    box.add_freejoint()
    box.add_geom(name="box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.08, 0.016, 0.016], mass=0.14)
    spec.option.timestep, spec.option.integrator = 0.005, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    grip = spec.compile()
    state = mujoco.MjData(grip)
    state.qpos[:9], state.ctrl[:] = model.key("home").qpos, [*HOME, 0.0]
    for _ in range(100):
        mujoco.mj_step(grip, state)
        assert np.abs(state.qvel[7:9]).max() < 0.5
        assert all(contact.dist > -0.004 for contact in state.contact)
    np.testing.assert_allclose(state.qpos[7:9].sum(), 0.032, atol=5e-4)
