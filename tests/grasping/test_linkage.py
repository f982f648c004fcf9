"""Grippers with closed loops, by MuJoCo C: its equalities, and its steps from the open to the closed gripper."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.reach.arm import SerialArm

# Two fingers of five bars. The rods are longer than the cranks, so the pads turn while the gripper closes. The loops
# leave a joint of each finger free, and a spring pushes the slack joint against its limit.
HAND = """
<mujoco><compiler angle="radian"/><option gravity="0 0 0"/>
<default><joint damping=".02" armature=".0005" limited="true"/><geom density="300"/></default>
<worldbody><body name="base"><geom size=".02"/>
  <body name="upper" pos="0 0 .3"><joint axis="0 0 1" range="-3 3" damping="9"/><geom size=".02"/>
    <body name="hand" pos="0 0 .3"><joint axis="0 1 0" range="-2 2" damping="9"/>
      <geom name="palm" type="box" size=".02 .06 .01" pos="0 0 .01"/><site name="tcp" pos="0 0 .11"/>
      {fingers}
</body></body></body></worldbody>
<contact>{apart}</contact><tendon><fixed name="both">{pulled}</fixed></tendon><equality>{ties}</equality>
<actuator><position {drives} kp="5" ctrlrange="-.5 .7"/></actuator></mujoco>"""
FINGER = """
<body name="{n}crank" pos="0 {y} .04"><joint name="{n}crank" axis="{s} 0 0" range="-.5 .7"/>
  <geom type="box" size=".002 .002 .01" pos="0 0 .02"/>
  <body name="{n}link" pos="0 0 .04"><joint name="{n}link" axis="{s} 0 0" range="-1 1"/><geom size=".002"/>
    <body name="{n}pad" pos="0 0 .01"><joint name="{n}slack" axis="{s} 0 0" range="0 .3"
      stiffness=".05" springref="-1"/>
      <geom name="{n}pad" type="box" size=".01 .004 .02" pos="0 0 .02"/></body></body></body>
<body name="{n}rod" pos="0 {z} .03"><joint name="{n}rod" axis="{s} 0 0" range="-1 1"/>
  <geom type="box" size=".002 .002 .01" pos="0 0 .02"/></body>"""
TIED = '<joint joint1="lcrank" joint2="rcrank"/>'


def _hand(drives: str, more: str = "") -> tuple[mujoco.MjModel, SerialArm]:
    sides = (("l", 1, 0.03, 0.045), ("r", -1, -0.03, -0.045))
    mjm = mujoco.MjModel.from_xml_string(
        HAND.format(
            fingers="".join(FINGER.format(n=n, s=s, y=y, z=z) for n, s, y, z in sides),
            apart="".join(f'<exclude body1="hand" body2="{n}{part}"/>' for n in "lr" for part in ("crank", "rod")),
            pulled="".join(f'<joint joint="{n}crank" coef=".5"/>' for n in "lr"),
            ties="".join(
                f'<connect name="{n}pin" body1="{n}rod" body2="{n}pad" anchor="0 0 .05" solref=".004 1"/>' for n in "lr"
            )
            + more,
            drives=drives,
        )
    )
    mjm.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return mjm, SerialArm.from_model(mjm, "base")


def _apart(mjm: mujoco.MjModel, data: mujoco.MjData) -> float:
    return mujoco.mj_geomDistance(mjm, data, mjm.geom("lpad").id, mjm.geom("rpad").id, 1.0, None)


@pytest.mark.parametrize(("drives", "more"), [('tendon="both"', ""), ('joint="lcrank"', TIED)], ids=["two", "one"])
def test_a_gripper_closed_by_loops_opens_as_mujoco_steps_it(drives: str, more: str):
    """Openings within 1 mm of MuJoCo C, which drives the actuator in steps; all poses keep the loops closed."""
    mjm, arm = _hand(drives, more)
    gripper = Gripper.from_model(mjm, arm, np.zeros(mjm.nq), extract_pieces(mjm, "physics"))
    assert len(gripper.qposadr) == (1 if more else 2)
    stepped, posed = mujoco.MjData(mjm), mujoco.MjData(mjm)
    adr, poses = gripper.poses(np.linspace(1.0, 0.0, 5))
    for qpos in poses:
        posed.qpos[adr] = qpos
        mujoco.mj_forward(mjm, posed)
        closing = posed.efc_pos[posed.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        assert np.abs(closing).max() < 1e-4
        stepped.ctrl[0] = posed.qpos[mjm.joint("lcrank").qposadr[0]]
        mujoco.mj_step(mjm, stepped, 600)
        assert _apart(mjm, posed) == pytest.approx(_apart(mjm, stepped), abs=1e-3)
        if qpos is poses[0]:
            assert gripper.opening == pytest.approx(_apart(mjm, stepped), abs=1e-3)
    slack = [mjm.joint(f"{n}slack").qposadr[0] for n in "lr"]
    assert np.abs(posed.qpos[slack]).max() < 1e-3
    assert gripper.closed == 0.0
    assert _apart(mjm, posed) == pytest.approx(0.0, abs=1e-3)
