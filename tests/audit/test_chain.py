"""The chain, judged by MuJoCo's forward kinematics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.chain import POSITION, ROTATION, Chain
from sceniris_gym.reach.arm import SerialArm
from tests.reach.arms import MODELS, tcp_poses

STEPS = 30  # of the search from each start


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
