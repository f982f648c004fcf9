"""Constraint rows of reset worlds: nothing of a broken world may come back with them."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.sim.constraints import clear_constraints

BALL = """
<mujoco><option jacobian="{jacobian}"/><worldbody><geom type="plane" size="1 1 1"/>
<body><freejoint/><geom size="0.1"/></body></worldbody></mujoco>
"""


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
def test_rows_of_masked_worlds_are_zero_and_others_stay(jacobian: str):
    """Jacobian and mass of all rows, those that only fill a tile included."""
    mjm = mujoco.MjModel.from_xml_string(BALL.format(jacobian=jacobian))
    with wp.ScopedDevice("cpu"):
        d = mjw.make_data(mjm, 3, njmax=37)
        for array in (d.efc.J, d.efc.D):
            array.fill_(float("nan"))
        clear_constraints(d, wp.array([True, False, True], dtype=wp.bool))
    for array in (d.efc.J, d.efc.D):
        assert array.size > 0
        assert not array.numpy()[[0, 2]].any()
        assert np.isnan(array.numpy()[1]).all()
