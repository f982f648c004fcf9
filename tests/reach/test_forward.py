"""Forward kinematics of many joint positions on the device, against MuJoCo's."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.forward import tcp_axes
from sceniris_gym.reach.solve import random_joints
from tests.reach.arms import MODELS, tcp_poses


@pytest.mark.parametrize("name", MODELS)
def test_positions_and_approach_axes_are_those_of_mujoco(name: str):
    """In the base's frame, wherever the base stands; to the rounding of float32."""
    mjm, base = MODELS[name]()
    arm = SerialArm.from_model(mjm, base)
    joints = random_joints(arm, 300, seed=1)
    pos, approach = tcp_axes(arm, joints, "cpu")
    expected = tcp_poses(mjm, arm, joints)
    assert pos.shape == approach.shape == (300, 3)
    assert np.linalg.norm(pos - expected[:, :3, 3], axis=1).max() < 2e-6
    assert np.linalg.norm(approach - expected[:, :3, 2], axis=1).max() < 2e-6


def test_one_row_is_answered_as_it_is_among_others():
    """Bit by bit; no rows have no answers."""
    mjm, base = MODELS["panda"]()
    arm = SerialArm.from_model(mjm, base)
    joints = random_joints(arm, 7, seed=2)
    together = tcp_axes(arm, joints, "cpu")
    for i in range(7):
        alone = tcp_axes(arm, joints[i : i + 1], "cpu")
        assert all(np.array_equal(a[0], b[i]) for a, b in zip(alone, together, strict=True))
    assert all(len(a) == 0 for a in tcp_axes(arm, joints[:0], "cpu"))
