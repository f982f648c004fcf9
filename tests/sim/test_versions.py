"""What differs between versions of MuJoCo and MuJoCo-Warp is found with the oldest and with the newest."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.sim.versions import (
    OverflowType,
    actuator_controls,
    actuator_outputs,
    fields_of_data,
    keyframe_plastic,
    silence_iterations,
)

MODEL = """<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="a"/><position joint="a" gear="3"/></actuator><keyframe><key name="k"/></keyframe></mujoco>"""


@pytest.mark.oldest
def test_actuators_have_one_control_and_one_output_each():
    """As plain motors and position actuators have in all versions."""
    mjm = mujoco.MjModel.from_xml_string(MODEL)
    addresses, numbers = actuator_controls(mjm)
    np.testing.assert_array_equal(addresses, [0, 1])
    np.testing.assert_array_equal(numbers, [1, 1])
    np.testing.assert_array_equal(actuator_outputs(mjm), [0, 1])
    assert mjm.actuator_gear[actuator_outputs(mjm)[1], 0] == 3.0
    assert keyframe_plastic(mjm, 0).size == 0


@pytest.mark.oldest
def test_overflows_have_names_and_warnings_of_iterations_can_be_silenced():
    """Those about contacts and constraints stay."""
    with wp.ScopedDevice("cpu"):
        m = mjw.put_model(mujoco.MjModel.from_xml_string(MODEL))
    silence_iterations(m)
    assert m.opt.warn_overflow
    for name in ("NEFC", "BROADPHASE", "NARROWPHASE", "CCD"):
        assert int(m.opt.warn_overflow) & OverflowType[name] or m.opt.warn_overflow is True
    assert not int(m.opt.warn_overflow) & int(getattr(OverflowType, "ITERATIONS", 0))


@pytest.mark.oldest
def test_fields_of_data_are_those_that_there_are():
    """In the order in which they were asked for."""
    assert fields_of_data("qvel", "nothing", "qpos") == ("qvel", "qpos")
