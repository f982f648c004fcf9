"""Differences between versions of MuJoCo and MuJoCo-Warp, found with the oldest and with the newest."""

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
    render_context,
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


@pytest.mark.oldest
def test_a_camera_is_rendered_by_its_name():
    """Of two cameras the second, which sees a sphere, where the other one looks away from it."""
    eyes = '<camera name="away" pos="0 0 2" zaxis="0 0 -1"/><camera name="at" pos="0 0 2"/>'
    mjm = mujoco.MjModel.from_xml_string(f'<mujoco><worldbody>{eyes}<geom size=".5"/></worldbody></mujoco>')
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.make_data(mjm)
        found = {}
        for name in ("at", "away"):
            context = render_context(mjm, 1, [name], cam_res=(8, 8), render_rgb=True, samples_per_pixel=1)
            for stage in (mjw.kinematics, mjw.com_pos, mjw.camlight):
                stage(m, d)
            mjw.refit_bvh(m, d, context)
            mjw.render(m, d, context)
            found[name] = context.rgb_data.numpy().reshape(8, 8).copy()
    assert found["at"][4, 4] != found["at"][0, 0]
    assert (found["away"] == found["away"][0, 0]).all()
