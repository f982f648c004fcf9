"""Inverse kinematics on the device, judged by MuJoCo's forward kinematics in double precision."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.solve import POS_TOL, ROT_TOL, arm_view, as_vec8, forward, random_joints, solve, vec8

PANDA = Path(__file__).parents[2] / "assets" / "panda.xml"
INERTIA = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
GANTRY = f"""
<mujoco><compiler angle="radian"/><worldbody><body name="gantry">
  <body pos="0.1 0 0.9">{INERTIA}
    <joint type="slide" axis="1 0 0" range="-0.5 0.5"/>
    <joint type="slide" axis="0 1 0" range="-0.4 0.6" ref="0.1"/>
    <joint type="slide" axis="0 0 -1" range="0 0.7"/>
    <body pos="0 0 -0.1">{INERTIA}<joint axis="0 0 1" range="-3 3" ref="0.3"/>
      <body pos="0 0 -0.1">{INERTIA}<joint axis="0 1 0.2" range="-1.5 1.5" pos="0 0.02 0"/>
        <body pos="0 0 -0.1">{INERTIA}<joint axis="1 0 0" range="-2 2"/>
          <site name="tcp" pos="0 0 -0.1" quat="0 1 0 0"/>
</body></body></body></body></body></worldbody></mujoco>"""
FREE_WRIST = f"""
<mujoco><compiler angle="radian"/><worldbody><body name="scara">
  <body pos="0 0 0.4">{INERTIA}<joint axis="0 0 1" range="-2 2"/>
    <body pos="0.3 0 0">{INERTIA}<joint axis="0 0 1" range="-2.5 2.5"/>
      <body pos="0.25 0 0">{INERTIA}<joint type="slide" axis="0 0 -1" range="0 0.3"/>
        <body>{INERTIA}<joint axis="0 0 1"/><site name="tcp" pos="0 0 -0.1" quat="0 1 0 0"/>
</body></body></body></body></body></worldbody></mujoco>"""


def ur5e() -> str:
    """Return a chain with the published UR5e Denavit-Hartenberg parameters: d and a [m], alpha [rad]."""
    quarter = np.pi / 2
    rows = [
        (0.1625, 0.0, quarter),
        (0.0, -0.425, 0.0),
        (0.0, -0.3922, 0.0),
        (0.1333, 0.0, quarter),
        (0.0997, 0.0, -quarter),
        (0.0996, 0.0, 0.0),
    ]
    opened, frame = "", (0.0, 0.0, 0.0)
    for i, row in enumerate(rows):
        d, a, alpha = frame
        full = np.pi if i == 2 else 2.0 * np.pi
        turn = f"{np.cos(alpha / 2)} {np.sin(alpha / 2)} 0 0"
        opened += f'<body pos="{a} 0 {d}" quat="{turn}">{INERTIA}<joint axis="0 0 1" range="{-full} {full}"/>'
        frame = row
    site = f'<site name="tcp" pos="0 0 {frame[0]}"/>'
    return (
        '<mujoco><compiler angle="radian"/><worldbody><body name="ur">'
        f"{opened}{site}{'</body>' * 7}</worldbody></mujoco>"
    )


MODELS = {
    "panda": lambda: mujoco.MjModel.from_xml_path(str(PANDA)),
    "ur": lambda: mujoco.MjModel.from_xml_string(ur5e()),
    "gantry": lambda: mujoco.MjModel.from_xml_string(GANTRY),
    "scara": lambda: mujoco.MjModel.from_xml_string(FREE_WRIST),
}


@pytest.fixture(scope="module", params=MODELS)
def arm(request: pytest.FixtureRequest) -> tuple[mujoco.MjModel, SerialArm]:
    """Return a model and its arm."""
    mjm = MODELS[request.param]()
    return mjm, SerialArm.from_model(mjm, request.param, "tcp")


def poses(mjm: mujoco.MjModel, arm: SerialArm, joints: np.ndarray) -> np.ndarray:
    """Return the TCP's poses by MuJoCo, shape (N, 7). The base stands at the origin."""
    data = mujoco.MjData(mjm)
    site = mjm.site("tcp").id
    result = np.zeros((len(joints), 7))
    for row, q in zip(result, joints, strict=True):
        data.qpos[arm.qposadr] = q
        mujoco.mj_kinematics(mjm, data)
        row[:3] = data.site_xpos[site]
        mujoco.mju_mat2Quat(row[3:], data.site_xmat[site])
    return result


def distances(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances [m] and angles [rad] between poses."""
    half = np.minimum(np.linalg.norm(a[:, 3:] - b[:, 3:], axis=1), np.linalg.norm(a[:, 3:] + b[:, 3:], axis=1))
    return np.linalg.norm(a[:, :3] - b[:, :3], axis=1), 4.0 * np.arcsin(half / 2.0)


@wp.kernel(enable_backward=False, module="unique")
def run_forward(view: Any, joints: wp.array[vec8], pos: wp.array[wp.vec3], quat: wp.array[wp.vec4]):
    """Forward kinematics of a batch."""
    i = wp.tid()
    at, turn = forward(view, joints[i])
    pos[i] = at
    quat[i] = turn


def test_forward_kinematics_are_those_of_mujoco(arm: tuple[mujoco.MjModel, SerialArm]):
    """Poses on the device agree with mj_kinematics to the rounding of float32."""
    mjm, own = arm
    joints = random_joints(own, 200, seed=1)
    pos, quat = wp.zeros(200, dtype=wp.vec3), wp.zeros(200, dtype=wp.vec4)
    wp.launch(run_forward, dim=200, inputs=[arm_view(own, "cpu"), wp.array(as_vec8(joints), dtype=vec8), pos, quat])
    far, turned = distances(np.hstack([pos.numpy(), quat.numpy()]), poses(mjm, own, joints))
    assert far.max() < 2e-6
    assert turned.max() < 2e-6


def test_every_pose_of_random_joints_is_found_and_true(arm: tuple[mujoco.MjModel, SerialArm]):
    """Of 3,000 reachable poses all get joints: exactly within limits, and at the pose by MuJoCo's own account."""
    mjm, own = arm
    asked = poses(mjm, own, random_joints(own, 3000, seed=2))
    joints, ok = solve(own, asked)
    assert ok.mean() > 0.999
    assert (joints.astype(float) >= own.lower).all()
    assert (joints.astype(float) <= own.upper).all()
    far, turned = distances(poses(mjm, own, joints.astype(float)), asked)
    assert far[ok].max() <= POS_TOL
    assert turned[ok].max() <= ROT_TOL
    assert np.median(far[ok]) < 1e-5


@pytest.mark.cuda
def test_a_gpu_finds_them_too(arm: tuple[mujoco.MjModel, SerialArm]):
    """The same poses, solved on a GPU, hold by MuJoCo's account."""
    mjm, own = arm
    asked = poses(mjm, own, random_joints(own, 3000, seed=2))
    joints, ok = solve(own, asked, "cuda:0")
    assert ok.mean() > 0.999
    assert ((joints >= own.lower) & (joints <= own.upper)).all()
    far, turned = distances(poses(mjm, own, joints.astype(float)), asked)
    assert far[ok].max() <= POS_TOL
    assert turned[ok].max() <= ROT_TOL


def test_poses_at_the_limits_are_found(arm: tuple[mujoco.MjModel, SerialArm]):
    """Joints that must stand at their limits to reach a pose are put there, and no further."""
    mjm, own = arm
    rng = np.random.default_rng(3)
    joints = random_joints(own, 400, seed=3)
    limit = np.where(rng.random(joints.shape) < 0.5, own.lower, own.upper)
    at_limit = (rng.random(joints.shape) < 0.4) & np.isfinite(limit)
    asked = poses(mjm, own, np.where(at_limit, limit, joints))
    found, ok = solve(own, asked)
    assert ok.mean() > 0.97
    assert ((found >= own.lower) & (found <= own.upper)).all()


def test_what_is_out_of_reach_is_not_found(arm: tuple[mujoco.MjModel, SerialArm]):
    """Poses far away are refused, and the joints that come back for them are within limits all the same."""
    mjm, own = arm
    asked = poses(mjm, own, random_joints(own, 50, seed=4))
    asked[:, :3] += [5.0, 0.0, 0.0]
    joints, ok = solve(own, asked)
    assert not ok.any()
    assert ((joints >= own.lower) & (joints <= own.upper)).all()


def test_given_starts_are_used(arm: tuple[mujoco.MjModel, SerialArm]):
    """A start that is a solution comes back as it was given."""
    mjm, own = arm
    joints = random_joints(own, 1, seed=5)
    found, ok = solve(own, poses(mjm, own, joints), starts=joints)
    assert ok.all()
    assert np.abs(found - joints).max() < 1e-4


def test_hinges_without_limits_come_back_within_half_a_turn():
    """Joints that turn freely are wrapped to [-pi, pi]."""
    mjm = MODELS["scara"]()
    own = SerialArm.from_model(mjm, "scara", "tcp")
    joints = random_joints(own, 100, seed=6)
    found, ok = solve(own, poses(mjm, own, joints), starts=joints[:1] + [0.0, 0.0, 0.0, 40.0])
    assert ok.any()
    assert np.abs(found[:, 3]).max() <= np.pi + 1e-6
