"""Verdicts of MuJoCo C on layouts: falls in closed form, and equalities that are broken by hand."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.physics import Settling, equalities, hold, limp_joints, settle, without_log
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import MJM, auditor
from tests.commands.scenes import layout, with_row


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


ARM = """
<mujoco>
  <worldbody>
    <body name="arm">
      <joint name="servo" axis="0 1 0"/><geom size="0.05" pos="0.3 0 0"/>
      <body><joint name="torque" axis="0 1 0"/><geom size="0.05" pos="0.6 0 0"/></body>
      <body><joint name="left" type="slide"/><geom size="0.01"/></body>
      <body><joint name="right" type="slide"/><geom size="0.01"/></body>
      <body><joint name="mimic" type="slide"/><geom size="0.01"/></body>
    </body>
    <body name="ball"><freejoint/><geom size="0.05" pos="2 0 0"/></body>
  </worldbody>
  <tendon><fixed name="grip"><joint joint="left" coef="1"/><joint joint="right" coef="1"/></fixed></tendon>
  <equality><joint joint1="mimic" joint2="left"/></equality>
  <actuator>
    <position joint="servo" kp="100"/><motor joint="torque"/><position tendon="grip" kp="10"/>
  </actuator>
</mujoco>
"""


def test_joints_without_a_position_servo_are_limp_and_can_be_frozen():
    """A servo on a tendon holds its joints, an equality what it couples; a frozen joint does not move at all."""
    mjm = mujoco.MjModel.from_xml_string(ARM)
    names = [mjm.joint(j).name for j in limp_joints(mjm, range(mjm.nbody))]
    assert names == ["torque"]
    ball = mjm.body("ball").id
    assert limp_joints(mjm, {ball}) == []
    swinging = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='a'><joint type='ball'/><geom size='0.1' pos='1 0 0'/>"
        "<body name='ball' pos='1 0 0'><geom size='0.1'/></body></body>"
        "<body name='free' pos='1 0 0.2'><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    )
    table = LayoutTable.from_states(
        swinging.qpos0[None], np.zeros((1, 0, 3)), np.zeros((1, 0, 4)), present=np.ones((1, 1), bool)
    )
    free = {"free": swinging.body("free").id}
    assert settle(swinging, free, table).moved["free"][0] > 0.1
    assert settle(swinging, free, table, frozen=[0]).moved["free"][0] < 1e-3
    assert not swinging.dof_armature.any()


UNSTABLE = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body name="drawer" pos="0 0 0.5">
      <joint name="slide" type="slide" axis="0 1 0"/><geom type="box" size="0.1 0.1 0.1" mass="0.001"/>
    </body>
    <body name="box" pos="1 0 0.05"><freejoint/><geom type="box" size="0.05 0.05 0.05"/></body>
  </worldbody>
  <actuator><general joint="slide" gainprm="0" biastype="affine" biasprm="0 1e6 1e4"/></actuator>
</mujoco>
"""


def rows_of_unstable(slides: list[float]) -> tuple[mujoco.MjModel, LayoutTable]:
    """Return the model of a drawer that blows up wherever it is not at 0, and layouts with it in some places."""
    mjm = mujoco.MjModel.from_xml_string(UNSTABLE)
    qpos = np.tile(mjm.qpos0, (len(slides), 1))
    qpos[:, mjm.joint("slide").qposadr] = np.array(slides)[:, None]
    qpos[:, mjm.joint("slide").qposadr[0] + 1] = 0.5  # where no reset puts the box
    none = np.zeros((len(slides), 0, 3)), np.zeros((len(slides), 0, 4))
    return mjm, LayoutTable.from_states(qpos, *none, present=np.ones((len(slides), 1), bool))


def test_nothing_is_written_where_mujoco_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """No log in the working folder, also from threads; the handler of before is back afterwards, after errors too."""
    monkeypatch.chdir(tmp_path)
    mjm, table = rows_of_unstable([0.1] * 20)
    before = mujoco.get_mju_user_warning()
    settle(mjm, {"box": mjm.body("box").id}, table)
    assert list(tmp_path.iterdir()) == []
    heard: list[str] = []
    mujoco.set_mju_user_warning(heard.append)
    try:
        settle(mjm, {"box": mjm.body("box").id}, table)
        with pytest.raises(ZeroDivisionError), without_log():
            raise ZeroDivisionError
        assert mujoco.get_mju_user_warning() == heard.append
    finally:
        mujoco.set_mju_user_warning(before)
    assert heard == []


def test_layouts_that_mujoco_resets_are_counted_apart():
    """Unstable rows neither moved nor were fast, though MuJoCo puts the box back; the others are as ever."""
    mjm, table = rows_of_unstable([0.1, 0.0, -0.1, 0.0, 0.0])
    table.qpos[3, mjm.joint(1).qposadr[0] + 2] = 2.0
    found = settle(mjm, {"box": mjm.body("box").id}, table)
    assert list(found.warnings) == [0, 2]
    assert all("QACC at DOF 0. The simulation is unstable" in text for _, text in found.warnings.values())
    assert {kind for kind, _ in found.warnings.values()} == {"BADQACC"}
    assert np.isnan(found.moved["box"]).tolist() == [True, False, True, False, False]
    assert np.isnan(found.speed["box"]).tolist() == [True, False, True, False, False]
    assert (found.moved["box"] > 0.5).tolist() == [False, False, False, True, False]


def test_a_report_counts_unstable_layouts_by_kind(monkeypatch: pytest.MonkeyPatch):
    """By number and first message; the largest speed is that of the rows that were stepped to the end."""
    ends = np.array([np.nan, 0.0, 0.5, np.nan])
    told = {0: ("BADQACC", "at 3"), 3: ("BADQACC", "at 4")}
    motion = Settling({"gem": ends}, {"gem": 3 * ends}, told)
    monkeypatch.setattr("sceniris_gym.audit.auditor.settle", lambda *_, **__: motion)
    report = auditor().judge(layout(MJM, 4), settled=4)
    assert (report.settled, report.moved, report.fast, report.top_speed) == (4, {"gem": 1}, {"gem": 1}, 1.5)
    assert report.unstable == {"BADQACC": (2, "at 3")}


PAIR = """<mujoco><worldbody>
  <body><joint name="a" type="slide"/><geom size=".1"/></body>
  <body pos="1 0 0"><joint name="b" type="slide"/><geom size=".1"/></body>
</worldbody><equality><joint name="mirror" joint1="b" joint2="a" polycoef="0 -1"/>{}</equality></mujoco>"""


def _table(qpos: list) -> LayoutTable:
    n = len(qpos)
    return LayoutTable.from_states(np.array(qpos), np.zeros((n, 0, 3)), np.zeros((n, 0, 4)), np.ones((n, 0), bool))


def test_layouts_that_break_an_equality_are_counted_and_the_worst_is_named():
    """Rounding does not count, and neither does an inactive equality."""
    mjm = mujoco.MjModel.from_xml_string(PAIR.format('<joint name="off" joint1="a" active="false"/>'))
    found = equalities(mjm, _table([[0.1, -0.1], [0.1, -0.10001], [0.1, 0.05], [0.2, -0.21]]))
    assert found == (2, pytest.approx(0.15), "mirror")
    assert equalities(mjm, _table([[0.25, -0.25]])) == (0, 0.0, "")


def test_a_model_without_equalities_has_none_to_break():
    """Nothing is looked at."""
    mjm = mujoco.MjModel.from_xml_string(PAIR.format("").split("<equality>")[0] + "</mujoco>")
    assert equalities(mjm, _table([[0.1, 0.5]])) == (0, 0.0, "")
