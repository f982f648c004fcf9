"""Blocks of M and Jacobians at qpos0, against MuJoCo's own."""

from __future__ import annotations

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.sim.inertia_tables import inertia_tables
from tests.sim.test_inertia import MACHINE


def test_trees_that_a_tendon_ties_share_a_block():
    """Of the belt between two trees; a lone free body has a block of its own."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    with wp.ScopedDevice("cpu"):
        tables, size = inertia_tables(mjm)
    block = tables.dof_block.numpy()[tables.dof_place.numpy()]
    turn, far, heavy = (block[mjm.body(name).dofadr[0]] for name in ("base", "far", "heavy"))
    assert turn == far != heavy
    widths = np.bincount(block)
    assert size == (widths**2).sum()
    assert widths[heavy] == 6


def test_jacobians_of_tendons_are_those_of_mujoco():
    """Over sites and over joints: the product with a velocity is the tendon's."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    data = mujoco.MjData(mjm)
    data.qvel[:] = np.random.default_rng(0).normal(size=mjm.nv)
    mujoco.mj_forward(mjm, data)
    with wp.ScopedDevice("cpu"):
        tables, _ = inertia_tables(mjm)
    velocity = tables.tendon_jac.numpy()[:, tables.dof_place.numpy()] @ data.qvel
    np.testing.assert_allclose(velocity, data.ten_velocity, atol=1e-5)
