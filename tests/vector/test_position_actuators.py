"""Targets of joints and the controls of their position actuators, against the forces of MuJoCo C."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArmError
from sceniris_gym.vector.position_actuators import PositionActuators
from tests.vector.workshop import CONTROLS, JOINTS, joints_of, mjcf, tensor

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def mjm() -> mujoco.MjModel:
    """Return a model with two arms, whose actuators are in another order than their joints."""
    return mujoco.MjModel.from_xml_string(mjcf({"a": ("none", "0 0 0", 0.0), "b": ("two actuators", "0 2 0", 0.0)}))


def actuators(mjm: mujoco.MjModel, plinth: str) -> PositionActuators:
    """Return the position actuators of an arm."""
    return PositionActuators(mjm, [mjm.joint(f"{plinth}:{name}").id for name in JOINTS], CPU, "here")


@pytest.mark.parametrize("plinth", ["a", "b"])
def test_a_joint_at_its_target_is_pulled_by_nothing(mjm, plinth):
    """Over gears, a tendon, a bias and a filter; and no other control is written."""
    found, wanted = actuators(mjm, plinth), [0.4, -1.2, 0.15, 0.7]
    ctrl = torch.full((2, mjm.nu), 7.0)
    found.set_targets(ctrl, tensor([wanted, wanted]))
    torch.testing.assert_close(found.targets(ctrl), tensor([wanted, wanted]))
    own = [mjm.actuator(f"{plinth}:{CONTROLS[name]}").id for name in JOINTS]
    assert (np.delete(ctrl.numpy(), own, axis=1) == 7.0).all()
    data = mujoco.MjData(mjm)
    data.qpos[joints_of(mjm, plinth)] = wanted
    data.ctrl[own] = ctrl[0, own]
    data.act[:] = ctrl[0, own[-1]]  # the filter's
    mujoco.mj_forward(mjm, data)
    np.testing.assert_allclose(data.actuator_force[own], 0.0, atol=2e-4)
    assert data.act_dot[0 if plinth == "a" else 1] == pytest.approx(0.0, abs=1e-4)


def test_targets_keep_to_the_limits_of_joints_and_of_controls(mjm):
    """Whichever are narrower; a joint without either goes anywhere."""
    found, ctrl = actuators(mjm, "a"), torch.zeros(1, mjm.nu)
    found.set_targets(ctrl, torch.full((1, 4), 9.0))
    torch.testing.assert_close(found.targets(ctrl), tensor([[np.radians(120.0), 9.0, 0.2, 2.5]]))
    found.set_targets(ctrl, torch.full((1, 4), -9.0))
    torch.testing.assert_close(found.targets(ctrl), tensor([[-np.radians(120.0), -9.0, -0.2, -2.5]]))


PULLED = """
<mujoco><option gravity="0 0 0" timestep=".001" integrator="implicitfast"/>
  <worldbody><body><joint name="j" damping="{damping}" {own}/><geom size=".1" mass="1"/></body></worldbody>
  <actuator><position joint="j" kp="200" kv="{kv}" gear="{gear}" {force}/></actuator></mujoco>
"""


@pytest.mark.parametrize(
    ("gear", "kv", "own", "force"),
    [
        (1, 10, "", 'forcerange="-20 20"'),
        (1, 0, "", 'forcerange="-20 20"'),
        (-3, 5, "", 'forcerange="-20 20"'),
        (2, 5, 'actuatorfrcrange="-10 10"', ""),
        (2, 5, 'actuatorfrcrange="-10 10"', 'forcerange="-20 20"'),
    ],
)
def test_a_target_that_leads_as_far_as_it_may_brings_full_force_and_speed_and_not_a_bit_more(gear, kv, own, force):
    """The target runs before the joint at a fixed distance; MuJoCo's speed there is the full torque over damping."""
    mjm = mujoco.MjModel.from_xml_string(PULLED.format(gear=gear, kv=kv, own=own, force=force, damping=5))
    lead = PositionActuators(mjm, [0], CPU, "here").full_leads(np.array([1.0]))[0]
    speeds = []
    for share in (0.9, 1.0, 1.5):
        data = mujoco.MjData(mjm)
        for _ in range(2000):
            data.ctrl[0] = gear * (data.qpos[0] + share * lead)
            mujoco.mj_step(mjm, data)
        speeds.append(data.qvel[0])
    torque = 10.0 if own else 20.0 * abs(gear)
    assert speeds[1] == pytest.approx(torque / 5.0, rel=0.01)
    assert speeds[0] < 0.96 * speeds[1]
    assert speeds[2] == pytest.approx(speeds[1], rel=0.01)


def test_without_a_limit_of_force_or_damping_leads_are_infinite_or_for_the_given_speed():
    """An undamped joint lags behind by what the actuator's own damping takes at that speed."""
    model = mujoco.MjModel.from_xml_string
    free = model(PULLED.format(gear=1, kv=10, own="", force="", damping=5))
    assert PositionActuators(free, [0], CPU, "here").full_leads(np.array([2.0]))[0] == np.inf
    slick = model(PULLED.format(gear=1, kv=10, own="", force='forcerange="-20 20"', damping=0))
    lead = PositionActuators(slick, [0], CPU, "here").full_leads(np.array([2.0]))[0]
    assert lead == pytest.approx(20.0 / 200.0 + 10.0 * 2.0 / 200.0)


@pytest.mark.parametrize(
    ("name", "actuators", "message"),
    [
        (
            "j",
            "",
            "here: joint 'j' should have one position actuator of its own, but has none. Add <position joint='j'",
        ),
        ("j", '<motor joint="j"/><velocity joint="j"/>', "but has none"),
        ("j", '<intvelocity joint="j" actrange="-1 1"/>', "but has none"),
        ("j", '<position tendon="both"/>', "but has none"),
        ("j", '<position name="x" joint="j"/><position joint="j"/>', "but has 2: 'x', 1. Keep one of them"),
        (
            "",
            "",
            "the unnamed joint of body 'arm' should have one position actuator of its own, but has none. Name it, ",
        ),
    ],
)
def test_a_joint_without_an_actuator_of_its_own_is_named(name, actuators, message):
    """With what it has, and what would be right."""
    label = f'name="{name}"' if name else ""
    tendon = (
        '<tendon><fixed name="both"><joint joint="j" coef="1"/><joint joint="k" coef="1"/></fixed></tendon>'
        if name
        else ""
    )
    mjm = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
      <body name="arm"><joint {label}/><geom size=".1"/>
        <body><joint name="k"/><geom size=".1"/></body></body></worldbody>{tendon}
      <actuator>{actuators}</actuator></mujoco>""")
    with pytest.raises(ArmError) as caught:
        PositionActuators(mjm, [0], CPU, "here")
    assert message in str(caught.value)
