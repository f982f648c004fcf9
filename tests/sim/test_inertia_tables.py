"""Blocks of M and Jacobians at qpos0, against MuJoCo's own."""

from __future__ import annotations

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.sim.inertia_tables import inertia_tables
from tests.sim.test_inertia import MACHINE


def test_each_tree_has_a_block_of_its_own():
    """Of degrees of freedom that follow each other, and with a square of memory."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    with wp.ScopedDevice("cpu"):
        tables = inertia_tables(mjm, 3)
    block = tables.block.numpy()
    np.testing.assert_array_equal(block[:, 0], mjm.tree_dofadr)
    np.testing.assert_array_equal(block[:, 1], mjm.tree_dofnum)
    assert tables.matrix.shape == (3, (block[:, 1] ** 2).sum())
    np.testing.assert_array_equal(block[1:, 2] - block[:-1, 2], block[:-1, 1] ** 2)


def test_jacobians_of_tendons_are_those_of_mujoco():
    """Over sites and over joints: the product with a velocity is the tendon's."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    data = mujoco.MjData(mjm)
    data.qvel[:] = np.random.default_rng(0).normal(size=mjm.nv)
    mujoco.mj_forward(mjm, data)
    with wp.ScopedDevice("cpu"):
        tables = inertia_tables(mjm, 1)
    np.testing.assert_allclose(tables.tendon_jac.numpy()[:, :, 0] @ data.qvel, data.ten_velocity, atol=1e-5)
