"""What MuJoCo C says of layouts: depths that are known, and falls in closed form."""

import mujoco
import numpy as np
import pytest

from sceniris_gym.tools.audit.physics import hold, settle
from tests.tools.audit.judging import MJM, auditor
from tests.tools.scenes import layout, with_row


def test_penetration_is_what_mujoco_measures():
    """A crate 3 mm in the floor is 3 mm deep."""
    rows = with_row(layout(MJM, 3), 1, layout(MJM, crate=(0.3, 0, -0.003, 0.5)))
    found = auditor().judge(rows).penetration
    assert found.depth == pytest.approx(0.003, abs=1e-6)
    assert found.row == 1
    assert set(found.owners or ()) == {"world", "crate"}


def test_settling_counts_what_moves_and_what_is_fast():
    """A gem that falls off is counted, objects that rest are not."""
    rows = with_row(layout(MJM, 3), 2, layout(MJM, gem=(0.4, -0.3, 0.3, 0)))
    report = auditor().judge(rows, settled=3)
    assert report.settled == 3
    assert report.moved == {"gem": 1, "can": 0, "crate": 0}
    assert report.fast == {"gem": 1, "can": 0, "crate": 0}
    assert report.top_speed > 2.0


def test_what_falls_falls_as_galileo_found():
    """A can in the air, after half a second and after less: where it is, and how fast it gets."""
    rows = layout(MJM, 2, can=(-0.3, 0.0, 3.0, 0.0))
    for seconds in (0.5, 0.2):
        found = settle(MJM, {"can": MJM.body("can").id}, rows, seconds)
        np.testing.assert_allclose(found.moved["can"], 9.81 * seconds**2 / 2, rtol=0.02)
        np.testing.assert_allclose(found.speed["can"], 9.81 * seconds, rtol=0.02)


SERVOS = """
<mujoco>
  <worldbody>
    <body><joint name="hinge" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/></body>
  </worldbody>
  <actuator>
    <position name="plain" joint="hinge" kp="10"/>
    <position name="geared" joint="hinge" kp="5" gear="-3"/>
    <general name="offset" joint="hinge" gainprm="4" biastype="affine" biasprm="1 -2 0"/>
    <position name="limited" joint="hinge" kp="10" ctrlrange="-0.1 0.1"/>
    <motor name="motor" joint="hinge"/>
  </actuator>
  <keyframe><key ctrl="9 9 9 9 0.7"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize("angle", [-1.2, 0.0, 0.8])
def test_servos_pull_nowhere_and_motors_do_what_the_keyframe_says(angle: float):
    """MuJoCo's own forces at the joint's position; a servo with a short range pulls as little as it may."""
    mjm = mujoco.MjModel.from_xml_string(SERVOS)
    data = mujoco.MjData(mjm)
    data.qpos[:] = angle
    hold(mjm, data)
    mujoco.mj_forward(mjm, data)
    for name in ("plain", "geared", "offset"):
        assert data.actuator(name).force[0] == pytest.approx(0.0, abs=1e-12)
    assert data.actuator("limited").ctrl[0] == pytest.approx(np.clip(angle, -0.1, 0.1))
    assert data.actuator("motor").force[0] == pytest.approx(0.7)
