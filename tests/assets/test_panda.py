"""The arm: published kinematics and limits, a gripper that closes, a start pose that holds."""

from __future__ import annotations

from importlib.resources import files

import mujoco
import numpy as np
import pytest

from tests.assets.geometry import VISUAL, geoms, load

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


def turn(axis: int, angle: float) -> np.ndarray:
    """A rotation about x (0) or z (2), as a 4 x 4 transform."""
    matrix = np.eye(4)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix[[i, j], [i, j]] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix


def shift(x: float, y: float, z: float) -> np.ndarray:
    """A translation as a 4 x 4 transform."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


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


def test_the_start_pose_holds_without_touching_itself():
    """From `home`, the arm moves by less than 1e-3 rad in 1 s and has no contact."""
    model, data = load("panda")
    np.testing.assert_allclose(model.key("home").qpos, [*HOME, 0.04, 0.04], atol=1e-6)
    np.testing.assert_allclose(model.key("home").ctrl, [*HOME, 0.04], atol=1e-6)
    assert data.ncon == 0
    mujoco.mj_step(model, data, nstep=500)
    np.testing.assert_allclose(data.qpos, model.key("home").qpos, atol=1e-3)
    assert data.ncon == 0


@pytest.mark.parametrize("integrator", ["mjINT_EULER", "mjINT_IMPLICITFAST"])
def test_the_arm_follows_its_commands(integrator):
    """A step of 0.2 rad on every joint is reached within 1 s to 0.01 rad, without shaking, under both integrators."""
    model, data = load("panda")
    model.opt.integrator = getattr(mujoco.mjtIntegrator, integrator)
    data.ctrl[:7] += 0.2
    mujoco.mj_step(model, data, nstep=500)
    np.testing.assert_allclose(data.qpos[:7], data.ctrl[:7], atol=0.01)
    assert np.abs(data.qvel).max() < 0.05


def test_the_gripper_closes_evenly_and_holds_a_cube():
    """Fingers meet when told to close; a 40 mm cube of 0.2 kg between them is held against gravity."""
    model, data = load("panda")
    data.ctrl[7] = 0.0
    mujoco.mj_step(model, data, nstep=500)
    np.testing.assert_allclose(data.qpos[7:], 0.0, atol=1e-3)

    spec = mujoco.MjSpec.from_file(str(files("sceniris_gym.assets") / "panda.xml"))
    model, data = load("panda")
    cube = spec.worldbody.add_body(name="cube", pos=data.site("tcp").xpos, quat=data.body("hand").xquat)
    cube.add_freejoint()
    cube.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02] * 3, mass=0.2)
    spec.delete(spec.keys[0])
    grip = spec.compile()
    state = mujoco.MjData(grip)
    state.qpos[:9], state.ctrl[:] = model.key("home").qpos, [*HOME, 0.0]
    start = data.site("tcp").xpos.copy()
    # Gravity sets in once the fingers have closed.
    grip.opt.gravity[2] = 0.0
    mujoco.mj_step(grip, state, nstep=300)
    grip.opt.gravity[2] = -9.81
    mujoco.mj_step(grip, state, nstep=1000)
    assert np.linalg.norm(state.body("cube").xpos - start) < 0.002


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


def test_links_have_plausible_masses_and_dressed_shapes():
    """Each link weighs 0.4 to 4 kg, the whole arm 15 to 20 kg; every body of the arm is visible."""
    model, _ = load("panda")
    links = [model.body(name).mass[0] for name in ("panda", *(f"link{i}" for i in range(1, 8)), "hand")]
    assert min(links) > 0.4
    assert max(links) < 4.0
    assert 15.0 < model.body_mass.sum() < 20.0
    assert {int(model.geom_bodyid[g]) for g in geoms(model, VISUAL)} == set(range(1, model.nbody))
