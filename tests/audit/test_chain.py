"""The chain, judged by MuJoCo's forward kinematics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.chain import POSITION, ROTATION, Chain
from sceniris_gym.reach.arm import SerialArm
from tests.reach.arms import MODELS, tcp_poses

STEPS = 30  # of the search from each start
VERDICTS = {"panda": "eeaabaeb", "ur5e": "7fafeffa", "heron": "fbbaaaaa"}
"""Which poses of `around` are reached, a bit each. The product of exponentials in NumPy gave the same bits."""


@pytest.fixture(scope="module", params=MODELS)
def model_and_arm(request: pytest.FixtureRequest) -> tuple[mujoco.MjModel, SerialArm]:
    """Return a model and its arm."""
    mjm, base = MODELS[request.param]()
    return mjm, SerialArm.from_model(mjm, base)


def chain_of(mjm: mujoco.MjModel, arm: SerialArm) -> Chain:
    """Return the chain from an arm's base body to its TCP."""
    return Chain(mjm, arm.base_body, arm.tcp_site)


def test_forward_kinematics_are_those_of_mujoco(model_and_arm: tuple[mujoco.MjModel, SerialArm]):
    """Positions [m] and rotation matrices agree at random joints."""
    mjm, arm = model_and_arm
    chain = chain_of(mjm, arm)
    joints = chain.random_joints(100, seed=1)
    assert np.abs(chain.fk(joints) - tcp_poses(mjm, arm, joints)).max() < 1e-12


def test_jacobians_are_those_of_mujoco(model_and_arm: tuple[mujoco.MjModel, SerialArm]):
    """Column by column at random joints, against mj_jacSite; bases that move do not count."""
    mjm, arm = model_and_arm
    chain, data = chain_of(mjm, arm), mujoco.MjData(mjm)
    joints = chain.random_joints(20, seed=8)
    expected = np.zeros((6, mjm.nv))
    for q, found in zip(joints, chain.jacobian(joints)[1], strict=True):
        data.qpos[arm.qposadr] = q
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_comPos(mjm, data)
        mujoco.mj_jacSite(mjm, data, expected[:3], expected[3:], arm.tcp_site)
        base = data.xmat[arm.base_body].reshape(3, 3)
        moved = expected[:, mjm.jnt_dofadr[chain.joints]]
        assert np.abs(found - np.vstack([base.T @ moved[:3], base.T @ moved[3:]])).max() < 1e-12


def test_limits_are_those_of_the_model(model_and_arm: tuple[mujoco.MjModel, SerialArm]):
    """A joint without limits has none; it has no range of (0, 0)."""
    mjm, arm = model_and_arm
    chain = chain_of(mjm, arm)
    for i, lower, upper in zip(chain.joints, chain.lower, chain.upper, strict=True):
        assert (lower, upper) == (tuple(mjm.jnt_range[i]) if mjm.jnt_limited[i] else (-np.inf, np.inf))


def around(mjm: mujoco.MjModel, arm: SerialArm) -> np.ndarray:
    """Return 32 poses that an arm reaches, shape (32, 4, 4), every second one then turned and moved by some 20 cm."""
    rng, chain = np.random.default_rng(7), chain_of(mjm, arm)
    poses = tcp_poses(mjm, arm, chain.random_joints(32, seed=9))
    for pose in poses[1::2]:
        quat, rotation = rng.normal(size=4), np.zeros(9)
        mujoco.mju_quat2Mat(rotation, quat / np.linalg.norm(quat))
        pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), pose[:3, 3] + rng.normal(scale=0.15, size=3)
    return poses


@pytest.mark.parametrize("name", VERDICTS)
def test_verdicts_on_shipped_arms_stay(name: str):
    """Bit for bit, also where the search decides: it draws, damps and stops as it did."""
    mjm, base = MODELS[name]()
    arm = SerialArm.from_model(mjm, base)
    chain = chain_of(mjm, arm)
    reached = np.isfinite(chain.ik(around(mjm, arm), chain.random_joints(8), STEPS)).all(axis=1)
    assert np.packbits(reached).tobytes().hex() == VERDICTS[name]


def test_solutions_hold_in_mujoco(model_and_arm: tuple[mujoco.MjModel, SerialArm]):
    """Solutions of inverse kinematics are at the asked pose and within limits; nothing reachable is missed."""
    mjm, arm = model_and_arm
    chain = chain_of(mjm, arm)
    wanted = chain.fk(chain.random_joints(150, seed=2))
    joints = chain.ik(wanted, chain.random_joints(32, seed=3), STEPS)
    assert (joints >= chain.lower).all() and (joints <= chain.upper).all()
    reached = tcp_poses(mjm, arm, joints)
    assert np.linalg.norm((reached - wanted)[:, :3, 3], axis=1).max() < POSITION
    turn = reached[:, :3, :3] @ wanted[:, :3, :3].transpose(0, 2, 1)
    assert (turn.trace(axis1=1, axis2=2) > 1.0 + 2.0 * np.cos(ROTATION)).all()


def test_poses_out_of_reach_are_refused(model_and_arm: tuple[mujoco.MjModel, SerialArm]):
    """Ten metres away there is no solution."""
    chain = chain_of(*model_and_arm)
    wanted = chain.fk(chain.random_joints(5, seed=4))
    wanted[:, 0, 3] += 10.0
    assert np.isnan(chain.ik(wanted, chain.random_joints(2), STEPS)).all()


def test_hinges_without_limits_come_back_within_half_a_turn():
    """A hinge that may turn for ever does not."""
    mjm, base = MODELS["endless"]()
    chain = chain_of(mjm, SerialArm.from_model(mjm, base))
    assert not np.isfinite(chain.lower).all()
    wanted = chain.fk(chain.random_joints(50, seed=5))
    joints = chain.ik(wanted, np.full((1, len(chain.lower)), 20.0), STEPS)
    assert np.isfinite(joints).any()
    assert np.nanmax(np.abs(joints[:, ~np.isfinite(chain.lower)])) <= np.pi


def test_the_search_begins_at_the_starts():
    """The solution next to a start is found."""
    mjm, base = MODELS["panda"]()
    chain = chain_of(mjm, SerialArm.from_model(mjm, base))
    joints = chain.random_joints(20, seed=6)
    for q in joints:
        found = chain.ik(chain.fk(q[None]), q[None] + 0.01, STEPS)
        assert np.abs(found - q).max() < 0.1
