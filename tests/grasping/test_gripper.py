"""Grippers, measured from their geometry: by MuJoCo's own distances, and by hand for one that is made here."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.grasping.gripper import Gripper, carried
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.reach.arm import SerialArm
from tests.grasping.scenes import Scene
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.versions import OLD, since_4

PADS = {"panda": ("left_pad", "right_pad"), "ur5e": ("left_pad", "right_pad"), "heron": ("left_pad", "right_pad")}
# An arm of two hinges, whose hand has a palm and two fingers of other lengths: 12 mm thick and 24 mm wide, and 10 mm
# thick and 16 mm wide. They reach 15 and 30 mm beyond the TCP, which is 40 mm before the palm.
HAND = """
<mujoco><compiler angle="radian"/><worldbody><body name="base">
  <body name="upper" pos="0 0 .3"><joint axis="0 0 1" range="-3 3"/>
    <geom type="capsule" size=".04" fromto="0 0 0 0 0 .2"/>
    <body name="hand" pos="0 0 .3" euler="0 .4 0"><joint axis="0 1 0" range="-2 2"/>
      <geom name="palm" type="box" size=".05 .08 .01" pos="0 0 .05"/><site name="tcp" pos="0 0 .1"/>
      <body name="left" pos="0 0 .1"><joint name="left" type="slide" axis="0 {left} 0" range="{range}"/>
        <geom type="box" size=".012 .006 .035" pos="0 {at} -.02"/></body>
      <body name="right" pos="0 0 .1"><joint name="right" type="slide" axis="0 -1 0" range="0 .04"/>
        <geom type="box" size=".008 .005 .045" pos="0 -.005 -.015"/></body>
</body></body></body></worldbody></mujoco>"""


def _hand(
    left: str = "1", limits: str = "0 .03", at: float = 0.006, tie: str = ""
) -> tuple[mujoco.MjModel, SerialArm, Gripper]:
    tied = HAND.replace("</mujoco>", f"<equality>{tie}</equality></mujoco>")
    mjm = mujoco.MjModel.from_xml_string(tied.format(left=left, range=limits, at=at))
    arm = SerialArm.from_model(mjm, "base")
    return mjm, arm, Gripper.from_model(mjm, arm, np.zeros(mjm.nq), extract_pieces(mjm, "physics"))


@pytest.mark.parametrize("robot", PADS)
def test_a_gripper_opens_as_wide_as_its_fingers_go_apart(robot: str):
    """MuJoCo's own distance of the two pads at the limits of their joints."""
    if OLD and robot == "heron":
        pytest.skip("MuJoCo before 4.0: mj_geomDistance says 0 of its pads, which are 88 mm apart")
    s = Scene("can", robot)
    mjm, data = s.scene.mjm, mujoco.MjData(s.scene.mjm)
    left, right = (mjm.geom(f"{robot}/{name}").id for name in PADS[robot])
    adr, fingers = s.gripper.poses(np.array([1.0, 0.0]))
    for gap, qpos in zip((s.gripper.opening, s.gripper.closed), fingers, strict=True):
        data.qpos[:] = s.scene.home_qpos
        data.qpos[adr] = qpos
        mujoco.mj_kinematics(mjm, data)
        assert gap == pytest.approx(max(mujoco.mj_geomDistance(mjm, data, left, right, 1.0, None), 0.0), abs=1e-6)


def test_a_tool_without_fingers_takes_things_of_any_width(tmp_path: Path):
    """A stick of two hinges: its TCP is asked to be where grasps are, and nothing is too wide."""
    tip = '<body pos="0.4 0 0"><joint axis="0 0 1"/><geom size="0.02"/><site name="tcp"/></body>'
    arm = write_mjcf(
        tmp_path,
        "stick",
        f'<body pos="0 0 0.5"><joint axis="0 0 1"/><geom size="0.02"/>{tip}</body>',
        '<keyframe><key name="home" qpos="0 0"/></keyframe>',
    )
    s = Scene(box_mjcf(tmp_path, "crate", 0.6, 0.6, 0.2), arm)
    assert s.gripper.opening == 1000.0
    assert len(s.gripper.qposadr) == 0
    found = s.grasp_set().grasps
    assert len(found) == 32
    assert max(g.opening for g in found) >= 0.6


def test_a_gripper_is_as_large_as_its_parts():
    """The longer finger's tip, the wider one's half width, the thicker one's thickness, and the palm behind them."""
    mjm, _, gripper = _hand()
    assert gripper.opening == pytest.approx(0.07)
    assert gripper.closed == pytest.approx(0.0)
    assert gripper.tip == pytest.approx(0.03)
    assert gripper.depth == pytest.approx(0.04)
    assert gripper.half_width == pytest.approx(0.012)
    assert gripper.thickness == pytest.approx(0.012)
    assert gripper.qposadr.tolist() == [mjm.joint("left").qposadr[0], mjm.joint("right").qposadr[0]]
    assert gripper.open_qpos.tolist() == [0.03, 0.04]
    assert gripper.closed_qpos.tolist() == [0.0, 0.0]


def test_which_limit_is_open_is_seen_and_not_assumed():
    """A finger whose joint counts the other way opens towards its lower limit, and the hand is the same."""
    _, _, usual = _hand()
    _, _, turned = _hand(left="-1", limits="-.03 0")
    assert turned.open_qpos.tolist() == [-0.03, 0.04]
    for name in ("opening", "closed", "tip", "depth", "half_width", "thickness"):
        assert getattr(turned, name) == pytest.approx(getattr(usual, name))


def test_fingers_that_do_not_meet_leave_a_gap():
    """One that stays a centimetre off the middle."""
    _, _, gripper = _hand(at=0.016)
    assert gripper.closed == pytest.approx(0.01)
    assert gripper.opening == pytest.approx(0.08)


@pytest.mark.parametrize(
    ("left", "limits", "tie", "opens"),
    [
        ("1", "0 .03", '<joint joint1="left" joint2="right"/>', {"right": 0.03}),
        ("-1", "-.03 0", '<joint joint1="left" joint2="right" polycoef="0 -1"/>', {"right": 0.03}),
        ("-1", "-.03 0", '<joint joint1="right" joint2="left" polycoef="0 -1"/>', {"left": -0.03}),
        ("1", "0 .03", '<joint joint1="left" joint2="right" polycoef="0 .2 10"/>', {"right": 0.04}),
        ("1", "0 .03", '<joint joint1="left" polycoef=".02"/>', {"right": 0.04}),
    ],
)
def test_a_finger_that_follows_another_one_does_so_however_far_the_gripper_opens(
    left: str, limits: str, tie: str, opens: dict[str, float]
):
    """By MuJoCo's own equality; the gap is what MuJoCo measures between the fingers so posed."""
    mjm, _, gripper = _hand(left, limits, tie=tie)
    assert gripper.qposadr.tolist() == [mjm.joint(name).qposadr[0] for name in opens]
    np.testing.assert_allclose(gripper.open_qpos, list(opens.values()), atol=1e-8)
    adr, fingers = gripper.poses(np.linspace(1.0, 0.0, 5))
    mjm.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data, gaps = mujoco.MjData(mjm), []
    for qpos in fingers:
        data.qpos[:] = 0.0
        data.qpos[mjm.joint("left").qposadr] = 0.02  # where it is held, if it is
        data.qpos[adr] = qpos
        mujoco.mj_forward(mjm, data)
        assert data.ne == 1
        assert abs(data.efc_pos[0]) < 1e-9
        ends = [mjm.body_geomadr[mjm.body(name).id] for name in ("left", "right")]
        gaps.append(max(mujoco.mj_geomDistance(mjm, data, *ends, 1.0, None), 0.0))
    assert gripper.opening == pytest.approx(gaps[0], abs=1e-6)
    assert gripper.closed == pytest.approx(gaps[-1], abs=1e-6)


# Two fingers that stay parallel: a crank on the palm with a pad at its end, which a second crank ties to the palm.
LOOPED = """
<mujoco><compiler angle="radian"/><worldbody><body name="base">
  <body name="upper" pos="0 0 .3"><joint axis="0 0 1" range="-3 3"/>
    <geom type="capsule" size=".04" fromto="0 0 0 0 0 .2"/>
    <body name="hand" pos="0 0 .3" euler="0 .4 0"><joint axis="0 1 0" range="-2 2"/>
      <geom name="palm" type="box" size=".05 .08 .01" pos="0 0 .01"/><site name="tcp" pos="0 0 .1"/>
      {fingers}
</body></body></body></worldbody><equality>{ties}{rest}</equality></mujoco>"""
FINGER = """
<body name="{n}crank" pos="0 {y} .04"><joint name="{n}crank" axis="{s} 0 0" range="-.7 .7"/>
  <geom type="box" size=".002 .002 .01" pos="0 0 .02" contype="0" conaffinity="0"/>
  <body name="{n}pad" pos="0 0 .04"><joint name="{n}pad" axis="{s} 0 0" range="-.8 .8"/>
    <geom name="{n}pad" type="box" size=".01 .005 .03" pos="0 0 .03"/></body></body>
<body name="{n}rod" pos="0 {z} .04"><joint name="{n}rod" axis="{s} 0 0" range="-.8 .8"/>
  <geom type="box" size=".002 .002 .01" pos="0 0 .02"/></body>"""


def _looped(rest: str = "") -> tuple[mujoco.MjModel, SerialArm]:
    sides = (("l", 1, 0.045, 0.06), ("r", -1, -0.045, -0.06))
    fingers = "".join(FINGER.format(n=n, s=s, y=y, z=z) for n, s, y, z in sides)
    ties = "".join(f'<connect name="{n}pin" body1="{n}rod" body2="{n}pad" anchor="0 0 .04"/>' for n in "lr")
    mjm = mujoco.MjModel.from_xml_string(LOOPED.format(fingers=fingers, ties=ties, rest=rest))
    return mjm, SerialArm.from_model(mjm, "base")


def test_fingers_in_a_loop_are_refused_unless_they_follow_one_driver_as_the_loop_does():
    """By the name of what closes it; with couplings that keep the loop all poses do, by MuJoCo's own rows."""
    mjm, arm = _looped()
    pieces = extract_pieces(mjm, "physics")
    with pytest.raises(
        NotSupportedError, match=r"arm 'base': .* break equality 'lpin' \(connect\) by .*<equality><joint>"
    ):
        Gripper.from_model(mjm, arm, np.zeros(mjm.nq), pieces)
    kept = "".join(
        f'<joint joint1="{n}pad" joint2="lcrank" polycoef="0 -1"/><joint joint1="{n}rod" joint2="lcrank"/>'
        for n in "lr"
    )
    mjm, arm = _looped(kept + '<joint joint1="rcrank" joint2="lcrank"/>')
    gripper = Gripper.from_model(mjm, arm, np.zeros(mjm.nq), pieces)
    assert [mjm.joint(j).name for j in range(mjm.njnt) if mjm.jnt_qposadr[j] in gripper.qposadr] == ["lcrank"]
    data = mujoco.MjData(mjm)
    adr, poses = gripper.poses(np.linspace(0.0, 1.0, 9))
    for qpos in poses:
        data.qpos[adr] = qpos
        mujoco.mj_forward(mjm, data)
        assert np.abs(data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]).max() < 1e-9
    assert gripper.opening == pytest.approx(2 * (0.04 + 0.04 * np.sin(0.7)))


def test_a_hand_is_what_the_last_joint_moves():
    """Bodies that MuJoCo puts elsewhere when that joint alone turns: hand and fingers, and nothing before them."""
    for robot in PADS:
        s = Scene("can", robot)
        mjm, data = s.scene.mjm, mujoco.MjData(s.scene.mjm)
        arm = robot_arm(s.scene)
        poses = []
        for angle in (0.0, 0.5):
            data.qpos[:] = s.scene.home_qpos
            data.qpos[arm.qposadr[-1]] += angle
            mujoco.mj_kinematics(mjm, data)
            poses.append(np.hstack([data.xpos, data.xmat]))
        assert carried(mjm, arm) == set(np.flatnonzero(np.abs(poses[1] - poses[0]).max(axis=1) > 1e-6))
    mjm, arm, _ = _hand()
    assert {mjm.body(body).name for body in carried(mjm, arm)} == {"hand", "left", "right"}


SWING = """
<mujoco><compiler angle="degree"/><worldbody><body name="base"><body name="hand" pos="0 0 .3">
  <joint axis="0 0 1" range="-90 90"/><geom type="box" size=".05 .05 .01"/><site name="tcp" pos="0 0 .1"/>{fingers}
</body></body></worldbody></mujoco>"""


def _swinging(headings: list[float], end: float = 0.05) -> Gripper:
    """Measure fingers that swing outwards from z by up to 60 degrees, at these headings around the palm.

    Upright, they end 5 cm above `end` [m].
    """
    finger = (
        '<body pos="0 0 0" euler="0 0 {0}"><body pos="0 .02 0"><joint axis="-1 0 0" range="0 60"/>'
        '<geom type="box" size=".005 .004 .05" pos="0 0 {1}"/></body></body>'
    )
    text = SWING.format(fingers="".join(finger.format(h, end) for h in headings))
    mjm = mujoco.MjModel.from_xml_string(text)
    arm = SerialArm.from_model(mjm, "base")
    return Gripper.from_model(mjm, arm, np.zeros(mjm.nq), extract_pieces(mjm, "physics"))


@pytest.mark.parametrize(("headings", "across"), [([0, 180], 2.0), ([0, 120, 240], 1.5)], ids=["two", "three"])
def test_fingers_that_swing_out_of_reach_of_the_tcp_are_measured_at_their_tips(headings: list[float], across: float):
    """Open, they end 5 cm before the TCP: by the extents of bars at 60 degrees, and of their projections on y."""
    gripper = _swinging(headings)
    low = 0.02 - 0.004 * np.cos(np.radians(60))  # where a bar begins, from the middle of the palm
    assert gripper.opening == pytest.approx(across * low, abs=0.02)
    assert gripper.opening > 0.02
    assert gripper.open_qpos == pytest.approx(np.full(len(headings), np.radians(60)))


def test_fingers_that_swing_end_where_they_reach_farthest():
    """Upright, 1 cm beyond the TCP. Open, they end before it."""
    assert _swinging([0, 180], end=0.06).tip == pytest.approx(0.01, abs=1e-4)


def test_one_jaw_has_as_much_room_on_its_other_side():
    """Upright it stands 16 mm from the middle."""
    gripper = _swinging([0])
    assert gripper.closed == pytest.approx(2.0 * 0.016, abs=1e-6)


ONE_JAW = """
<geom name="fixed" type="box" size=".005 .003 .05" pos="0 .012 .06"/>
<body name="jaw" pos="0 -.012 0"><joint name="jaw" axis="1 0 0" range="-4 60"/>
  <geom name="jaw" type="box" size=".005 .003 .05" pos="0 0 .06"/></body>"""


@pytest.mark.parametrize("joints", [["left"], ["left", "right"]])
def test_fingers_without_collisions_take_objects_of_any_width(joints: list[str]):
    """They touch no object, so that one jaw is measured as two fingers are, and as a tool without fingers."""
    spec = mujoco.MjSpec.from_string(HAND.format(left="1", range="0 .03", at=0.006))
    for name in ("left", "right"):
        spec.body(name).geoms[0].contype = spec.body(name).geoms[0].conaffinity = 0
        if name not in joints:
            spec.delete(spec.joint(name))
    mjm = spec.compile()
    gripper = Gripper.from_model(mjm, SerialArm.from_model(mjm, "base"), mjm.qpos0, extract_pieces(mjm, "physics"))
    assert (gripper.opening, gripper.closed, gripper.tip, gripper.middle) == (1000.0, 1000.0, 0.0, (0.0, 0.0))


def test_a_jaw_that_closes_on_the_hand_opens_as_far_as_the_tips_are_apart():
    """The corners at the end of the jaw, by MuJoCo's own poses, and the inner face of the fixed bar."""
    mjm = mujoco.MjModel.from_xml_string(SWING.format(fingers=ONE_JAW))
    arm, data = SerialArm.from_model(mjm, "base"), mujoco.MjData(mjm)
    gripper = Gripper.from_model(mjm, arm, np.zeros(mjm.nq), extract_pieces(mjm, "physics"))
    for gap, qpos in ((gripper.opening, gripper.open_qpos), (gripper.closed, gripper.closed_qpos)):
        data.qpos[gripper.qposadr] = qpos
        mujoco.mj_kinematics(mjm, data)
        ends = [data.geom("jaw").xmat.reshape(3, 3) @ [0, y, 0.05] + data.geom("jaw").xpos for y in (-0.003, 0.003)]
        assert gap == pytest.approx(0.012 - 0.003 - max(end[1] for end in ends), abs=1e-9)
    assert gripper.open_qpos == pytest.approx(np.radians(60))
    assert gripper.middle == pytest.approx((0.009 - 0.005, -0.5))


def test_fingers_that_cross_open_as_far_as_their_tips_are_apart():
    """As scissors do: boxes around whole fingers always overlap. The corners at both ends, by MuJoCo's own poses."""
    finger = (
        '<body pos="0 {0} .06"><joint axis="{1} 0 0" range="0 40"/><geom name="{1}" type="box" size=".005 .003 .05"/>'
    )
    fingers = "".join(f"{finger}</body>".format(side * 0.004, -side) for side in (1, -1))
    mjm = mujoco.MjModel.from_xml_string(SWING.format(fingers=fingers))
    arm, data = SerialArm.from_model(mjm, "base"), mujoco.MjData(mjm)
    gripper = Gripper.from_model(mjm, arm, np.zeros(mjm.nq), extract_pieces(mjm, "physics"))
    for gap, qpos in ((gripper.opening, gripper.open_qpos), (gripper.closed, gripper.closed_qpos)):
        data.qpos[gripper.qposadr] = qpos
        mujoco.mj_kinematics(mjm, data)
        geoms = [data.geom(name) for name in ("-1", "1")]
        left, right = ([(g.xmat.reshape(3, 3) @ [0, y, 0.05] + g.xpos)[1] for y in (-0.003, 0.003)] for g in geoms)
        assert gap == pytest.approx(min(left) - max(right), abs=1e-9)
    assert gripper.opening > 0.06


def test_a_finger_that_is_part_of_the_hand_is_no_palm():
    """A heel of the fixed finger, which ends 1 cm behind the TCP, leaves as much room for an object."""
    depths = []
    for heel in ("", '<geom type="box" size=".005 .003 .02" pos="0 .012 .07"/>'):
        mjm = mujoco.MjModel.from_xml_string(SWING.format(fingers=heel + ONE_JAW))
        arm = SerialArm.from_model(mjm, "base")
        depths.append(Gripper.from_model(mjm, arm, np.zeros(mjm.nq), extract_pieces(mjm, "physics")).depth)
    assert depths[0] == depths[1] > 0.03


@pytest.mark.parametrize(("joint", "least"), [("left", 0.004), ("right", 0.0)])
@pytest.mark.parametrize("gear", [1.0, -2.0])
def test_a_gripper_opens_and_closes_as_far_as_its_controls_reach(joint: str, least: float, gear: float):
    """From MuJoCo C's steady states at both ends of the control range, with the other finger coupled to this one."""
    low, high = sorted((gear * least, gear * 0.022))
    drive = f'<position joint="{joint}" gear="{gear}" kp="500" kv="50" ctrlrange="{low} {high}"/>'
    tie = f'<joint joint1="right" joint2="left"/></equality><actuator>{drive}</actuator><equality>'
    mjm, _, gripper = _hand(tie=tie)
    mjm.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    mjm.opt.gravity[:], mjm.opt.disableflags = 0.0, int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    ends = []
    for control in (low, high):
        data = mujoco.MjData(mjm)
        data.ctrl[:] = control
        mujoco.mj_step(mjm, data, 2000)
        ends.append(data.qpos.copy())
    ends.sort(key=lambda qpos: qpos[-1])
    for end, share in zip(ends, (0.0, 1.0), strict=True):
        adr, poses = gripper.poses(np.array([share]))
        np.testing.assert_allclose(poses[0], end[adr], atol=1e-4)
    _, _, free = _hand(tie='<joint joint1="right" joint2="left"/>')
    assert gripper.opening == pytest.approx(free.opening - 2.0 * (0.03 - 0.022), abs=1e-4)


def test_springs_hold_fingers_back_from_their_limits():
    """As in MuJoCo C's steady states, with the controls at both limits of a joint with a spring."""
    drives = "".join(f'<position joint="{name}" kp="500" kv="50"/>' for name in ("left", "right"))
    spring, tie = '0 .03" stiffness="150" springref=".004', f"</equality><actuator>{drives}</actuator><equality>"
    mjm, _, gripper = _hand(limits=spring, tie=tie)
    mjm.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    mjm.opt.gravity[:], mjm.opt.disableflags = 0.0, int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    adr, poses = gripper.poses(np.array([0.0, 1.0]))
    for control, qpos in zip(mjm.jnt_range[[mjm.joint("left").id, mjm.joint("right").id]].T, poses, strict=True):
        data = mujoco.MjData(mjm)
        data.ctrl[:] = control
        mujoco.mj_step(mjm, data, 2000)
        np.testing.assert_allclose(qpos, data.qpos[adr], atol=1e-5)


@since_4("actuators have one control each")
def test_actuators_with_several_controls_leave_an_opening_as_it_is():
    """A `<pid>` of a finger, whose controls are a position and a speed."""
    _, _, found = _hand(tie='</equality><actuator><pid joint="left" kp="10" ctrlrange="0 .01"/></actuator><equality>')
    assert found.opening == _hand()[2].opening
