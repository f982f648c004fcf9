"""Blocks of M and Jacobians at qpos0, against MuJoCo's own."""

from __future__ import annotations

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.sim.derived_tables import derived_tables
from tests.sim.test_derived import MACHINE


def test_each_tree_has_a_block_of_its_own():
    """Of degrees of freedom that follow each other, in rows as long as the largest one needs."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    with wp.ScopedDevice("cpu"):
        tables = derived_tables(mjm, 3)
    for i, (first, end) in enumerate(tables.dof_block.numpy()):
        np.testing.assert_array_equal(np.arange(first, end), np.flatnonzero(mjm.dof_treeid == mjm.dof_treeid[i]))
    assert tables.inverse.shape == (3, 2, mjm.nv, mjm.tree_dofnum.max())


def test_jacobians_of_tendons_are_those_of_mujoco():
    """Over sites and over joints: the product with a velocity is the tendon's."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    data = mujoco.MjData(mjm)
    data.qvel[:] = np.random.default_rng(0).normal(size=mjm.nv)
    mujoco.mj_forward(mjm, data)
    with wp.ScopedDevice("cpu"):
        tables = derived_tables(mjm, 1)
    first = 2 * mjm.nbody + mjm.nv
    np.testing.assert_allclose(
        tables.jacobian.numpy()[first : first + mjm.ntendon, :, 0] @ data.qvel, data.ten_velocity, atol=1e-5
    )
