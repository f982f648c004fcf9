"""The truth about arms is itself judged: by MuJoCo's forward kinematics, and by a search that knows no closed form."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.solve import solve
from tests.oracle.exact_ik import POS_TOL, ROT_TOL, ExactIk

ASSETS = Path(__file__).parents[2] / "assets"
REACH = {"panda": 1.05, "ur5e": 1.1, "heron": 0.8}


@pytest.fixture(scope="module", params=REACH)
def truth(request: pytest.FixtureRequest) -> tuple[mujoco.MjModel, ExactIk]:
    """Return an arm's model and the truth about it."""
    mjm = mujoco.MjModel.from_xml_path(str(ASSETS / f"{request.param}.xml"))
    return mjm, ExactIk(mjm, request.param)


def tcp_poses(mjm: mujoco.MjModel, joints: np.ndarray) -> np.ndarray:
    """Return poses of the TCP by MuJoCo, shape (N, 4, 4)."""
    data = mujoco.MjData(mjm)
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    for pose, q in zip(poses, joints, strict=True):
        data.qpos[: len(q)] = q
        mujoco.mj_kinematics(mjm, data)
        pose[:3, :3], pose[:3, 3] = data.site("tcp").xmat.reshape(3, 3), data.site("tcp").xpos
    return poses


def somewhere(name: str, num: int, seed: int) -> np.ndarray:
    """Draw poses around an arm, shape (N, 4, 4), of which it reaches a good part."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (num, 1, 1))
    poses[:, :3, :3] = Rotation.random(num, rng=rng).as_matrix()
    poses[:, :2, 3] = rng.uniform(-0.7, 0.7, (num, 2)) * REACH[name]
    poses[:, 2, 3] = rng.uniform(0.0, REACH[name], num)
    return poses


def test_poses_of_joints_within_limits_are_found(truth: tuple[mujoco.MjModel, ExactIk]):
    """All of them, and by the closed form alone."""
    mjm, ik = truth
    lower, upper = mjm.jnt_range[: len(ik.screws.lower)].T
    joints = np.random.default_rng(11).uniform(lower, upper, (400, len(lower)))
    ok, _, exact = ik.reachable(tcp_poses(mjm, joints))
    assert ok.all()
    assert exact.all()


def test_every_yes_has_joints_that_hold(truth: tuple[mujoco.MjModel, ExactIk]):
    """Within limits and tolerances; exact ones to a micrometre."""
    mjm, ik = truth
    poses = somewhere(ik.name, 300, 12)
    ok, joints, exact = ik.reachable(poses)
    assert 0.15 < ok.mean() < 0.85
    assert (exact & ~ok).sum() == 0
    lower, upper = mjm.jnt_range[: joints.shape[1]].T
    assert ((joints[ok] >= lower - 1e-9) & (joints[ok] <= upper + 1e-9)).all()
    reached = tcp_poses(mjm, joints[ok])
    distance = np.linalg.norm((reached - poses[ok])[:, :3, 3], axis=1)
    angle = Rotation.from_matrix(np.swapaxes(reached[:, :3, :3], 1, 2) @ poses[ok][:, :3, :3]).magnitude()
    assert (distance < POS_TOL).all()
    assert (angle < ROT_TOL).all()
    assert distance[exact[ok]].max() < 1e-6
    assert angle[exact[ok]].max() < 1e-6


def test_no_search_finds_what_is_denied(truth: tuple[mujoco.MjModel, ExactIk]):
    """Hundreds of starts of damped least squares lead to none of the poses that are said to be out of reach."""
    mjm, ik = truth
    poses = somewhere(ik.name, 300, 13)
    ok, _, _ = ik.reachable(poses)
    denied = poses[~ok]
    quat = Rotation.from_matrix(denied[:, :3, :3]).as_quat(scalar_first=True)
    arm = SerialArm.from_model(mjm, ik.name)
    _, found = solve(arm, np.concatenate([denied[:, :3, 3], quat], axis=1), restarts=200, iterations=25)
    assert not found.any()


def test_the_tolerance_counts_and_ends_where_it_should():
    """Stretched out, 0.8 mm more are within reach though no joints lead there; 1.2 mm more are not."""
    mjm = mujoco.MjModel.from_xml_path(str(ASSETS / "heron.xml"))
    pose = tcp_poses(mjm, np.array([[0.3, 0.9, 0.0, 0.1, 0.0, 0.1]]))
    out = pose[0, :3, 3] - [0.0, 0.0, 0.24]
    poses = np.repeat(pose, 3, axis=0)
    poses[:, :3, 3] += np.array([[-1e-4], [0.8e-3], [1.2e-3]]) * out / np.linalg.norm(out)
    ok, _, exact = ExactIk(mjm, "heron").reachable(poses)
    assert ok.tolist() == [True, True, False]
    assert exact.tolist() == [True, False, False]
