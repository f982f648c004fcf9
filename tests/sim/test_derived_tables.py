"""Blocks of M and Jacobians at qpos0, against MuJoCo's own."""

from __future__ import annotations

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.sim.derived_tables import derived_tables
from tests.sim.test_derived import MACHINE


def test_each_tree_has_a_block_of_its_own():
    """Of degrees of freedom that follow each other, and with a square of memory."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    with wp.ScopedDevice("cpu"):
        tables = derived_tables(mjm, 3)
    row = tables.dof_row.numpy()
    places = [row[i] + j for i in range(mjm.nv) for j in np.flatnonzero(mjm.dof_treeid == mjm.dof_treeid[i])]
    np.testing.assert_array_equal(places, np.arange((mjm.tree_dofnum**2).sum()))
    assert tables.inverse.shape == (3, 2, len(places))


def test_jacobians_of_tendons_are_those_of_mujoco():
    """Over sites and over joints: the product with a velocity is the tendon's."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    data = mujoco.MjData(mjm)
    data.qvel[:] = np.random.default_rng(0).normal(size=mjm.nv)
    mujoco.mj_forward(mjm, data)
    with wp.ScopedDevice("cpu"):
        tables = derived_tables(mjm, 1)
    np.testing.assert_allclose(tables.moment.numpy()[: mjm.ntendon, :, 0] @ data.qvel, data.ten_velocity, atol=1e-5)
