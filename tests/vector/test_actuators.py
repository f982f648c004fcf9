"""Targets of joints by the forces of MuJoCo C, and hands that it closes and opens by the controls that were found."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArmError
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.vector.actuators import Fingers, PositionActuators
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.state import State
from tests.vector.workshop import CONTROLS, HANDS, JOINTS, joints_of, mjcf, mujocos, state_of, tensor

CPU = torch.device("cpu")
DRIVEN = [name for name, hand in HANDS.items() if hand.actuators]


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


@pytest.mark.parametrize(("gear", "kv", "rate"), [(1, 10, 3.0), (2, 10, 20.0), (-3, 5, 6.1), (1, 0, 15.0)])
def test_a_joint_approaches_a_goal_at_the_rate_that_was_asked_for(gear, kv, rate):
    """In MuJoCo C: with the gain in each control step of 0.02 s, the way left falls as exp(-rate t)."""
    mjm = mujoco.MjModel.from_xml_string(PULLED.format(gear=gear, kv=kv, own="", force="", damping=5))
    gain, data = PositionActuators(mjm, [0], CPU, "here").gains(rate, 0.02)[0], mujoco.MjData(mjm)
    for _ in range(10):
        data.ctrl[0] = gear * (data.qpos[0] + gain * (0.5 - data.qpos[0]))
        mujoco.mj_step(mjm, data, 20)
    assert -np.log((0.5 - data.qpos[0]) / 0.5) / 0.2 == pytest.approx(rate, rel=0.04)


@pytest.mark.parametrize(
    ("name", "actuators", "message"),
    [
        (
            "j",
            "",
            "here: joint 'j' should have one separate position actuator, but has none. Add <position joint='j'",
        ),
        ("j", '<motor joint="j"/><velocity joint="j"/>', "but has none"),
        ("j", '<intvelocity joint="j" actrange="-1 1"/>', "but has none"),
        ("j", '<position tendon="both"/>', "but has none"),
        ("j", '<position name="x" joint="j"/><position joint="j"/>', "but has 2: 'x', 1. Keep one of them"),
        (
            "",
            "",
            "the unnamed joint of body 'arm' should have one separate position actuator, but has none. Name the joint",
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


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> SceneModel:
    """Return a scene of a user's model with an arm for each kind of hand."""
    path = tmp_path_factory.mktemp("workshop") / "workshop.xml"
    path.write_text(mjcf({f"base of {hand}": (hand, f"0 {i} 0", 20.0 * i) for i, hand in enumerate(HANDS)}))
    robots = {f"arm_{i}": {"in_model": f"base of {hand}"} for i, hand in enumerate(HANDS)}
    return build_model(SceneConfig.load({"model": str(path), "robots": robots}))


def found(scene: SceneModel, hand: str) -> Fingers | None:
    """Return the fingers of an arm, by the kind of its hand."""
    mjm, begin = scene.mjm, f"base of {hand}:"
    return Fingers.find(scene, mjm.site(f"{begin}point").id, [mjm.joint(f"{begin}{name}").id for name in JOINTS])


def settled(scene: SceneModel, ctrl: np.ndarray) -> mujoco.MjData:
    """Return where MuJoCo C comes to rest by these controls, from the start pose."""
    data = mujoco.MjData(scene.mjm)
    data.qpos[:], data.ctrl[:] = scene.home_qpos, ctrl
    mujoco.mj_step(scene.mjm, data, 600)
    return data


def gap(data: mujoco.MjData, hand: str) -> float:
    """Return the distance between the centres of the fingers [m]."""
    ends = [data.geom(f"base of {hand}:{finger}").xpos for finger in ("thumb", "index")]
    return float(np.linalg.norm(ends[1] - ends[0]))


@pytest.mark.parametrize("hand", DRIVEN)
def test_controls_close_and_open_the_hand(scene, hand):
    """As far as it goes: two actuators, tendons of both kinds, either side of an equality, and a motor."""
    fingers = found(scene, hand)
    assert fingers is not None
    for values, expected in zip((fingers.closed, fingers.opened), HANDS[hand].gaps, strict=True):
        ctrl = scene.home_ctrl.copy()
        ctrl[fingers.controls] = values
        # a motor presses on: limits of joints are soft
        assert gap(settled(scene, ctrl), hand) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("hand", DRIVEN)
def test_controls_are_those_of_actuators_whose_transmission_has_a_finger(scene, hand):
    """By MuJoCo's own tables, and all of them."""
    mjm, fingers = scene.mjm, found(scene, hand)
    assert fingers is not None
    begin = f"base of {hand}:"
    joints = {mjm.joint(f"{begin}{name}").id for name in "pq"}
    tendons = {i for i in range(mjm.ntendon) if mjm.tendon(i).name in (f"{begin}t", f"{begin}cord")}
    own = {int(mujoco.mjtTrn.mjTRN_TENDON): tendons}
    own |= {int(kind): joints for kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)}
    expected = [i for i in range(mjm.nu) if mjm.actuator_trnid[i, 0] in own[int(mjm.actuator_trntype[i])]]
    assert fingers.controls == expected


@pytest.mark.parametrize("hand", DRIVEN)
def test_the_width_is_how_far_the_fingers_have_moved_apart(scene, hand):
    """At the ends, and for slides anywhere between, where MuJoCo has the geoms."""
    mjm, fingers = scene.mjm, found(scene, hand)
    assert fingers is not None
    joints, (closed, opened) = list(fingers.joints), HANDS[hand].gaps
    limits = np.sort(np.abs(mjm.jnt_range[joints]), axis=1)
    signs = np.sign(mjm.jnt_range[joints].sum(axis=1))
    for share in (0.0, 1.0) if hand == "tendon" else (0.0, 0.3, 1.0):
        data = mujoco.MjData(mjm)
        data.qpos[:] = scene.home_qpos
        qpos = signs * (limits[:, 0] + share * (limits[:, 1] - limits[:, 0]))
        data.qpos[mjm.jnt_qposadr[joints]] = qpos
        mujoco.mj_forward(mjm, data)
        width = ((qpos - fingers.closed_qpos) * fingers.width).sum()
        assert closed - 1e-6 <= gap(data, hand) <= opened + 1e-6
        assert width == pytest.approx(gap(data, hand) - closed, abs=1e-6)


@pytest.mark.parametrize("hand", [hand for hand in HANDS if hand not in DRIVEN])
def test_a_hand_that_nothing_opens_is_none(scene, hand):
    """Without fingers, or without actuators."""
    assert found(scene, hand) is None


def test_the_width_of_a_linkage_is_not_guessed(tmp_path):
    """The joints that are driven do not tell it if bodies of the hand are joined in a loop."""
    path = tmp_path / "arm.xml"
    loop = '<connect body1="base:thumb" body2="base:index" anchor="0 0 0"/></equality>'
    path.write_text(mjcf({"base": ("mimic", "0 0 0", 0.0)}).replace("</equality>", loop))
    s = state_of({"model": str(path), "robot": {"in_model": "base", "tcp": "base:point"}})
    arm = ArmController(s)
    assert arm.has_gripper
    with pytest.raises(
        ArmError, match=r"robot: the robot's fingers hang on linkages, so .* from State.poses or State.site"
    ):
        arm.width(s)


def test_actuators_without_a_range_and_joints_without_limits_are_no_gripper(tmp_path):
    """A drill, and a motor that may pull as hard as it likes."""
    plain = mjcf({"base": ("motor", "0 0 0", 0.0)})
    for i, (old, new) in enumerate(((' ctrlrange="-1 1"', ""), (' range="0 .03"', ""))):
        path = tmp_path / f"{i}.xml"
        assert old in plain
        path.write_text(plain.replace(old, new))
        scene = build_model(SceneConfig.load({"model": str(path), "robot": {"in_model": "base"}}))
        joints = [scene.mjm.joint(f"base:{name}").id for name in JOINTS]
        assert Fingers.find(scene, scene.mjm.site("base:point").id, joints) is None


@pytest.fixture(scope="module")
def heavy(tmp_path_factory) -> State:
    """Return worlds with an arm of hinges and a slide, under gravity that is aslant, part of which `gravcomp` bears."""
    path = tmp_path_factory.mktemp("weight") / "arm.xml"
    text = mjcf({"base": ("two actuators", "0.1 0 0", 30.0)}).replace('gravity="0 0 0"', 'gravity="2 -3 -8"')
    path.write_text(text.replace('<body name="base:quill"', '<body name="base:quill" gravcomp=".4"'))
    s = state_of({"model": str(path), "robot": {"in_model": "base", "tcp": "base:point"}})
    s.data.qpos.assign(np.random.default_rng(0).uniform(-0.2, 0.2, (2, s.mjm.nq)))
    s._batch.update()
    return s


def test_targets_bear_the_weight_of_the_arm(heavy):
    """In MuJoCo C, joints stay where they are, by the stiffness of actuators with gears and tendons."""
    arm = ArmController(heavy)
    qpos = arm.qpos(heavy).clone()
    off = arm._actuators.bearing(heavy)
    assert isinstance(off, torch.Tensor)
    assert (off[:, :3].abs() > 1e-5).all()
    arm.set_targets(heavy, arm._actuators.within_force(heavy, qpos + off, qpos, arm.qvel(heavy)))
    for world in range(2):
        data = mujocos(heavy, world)
        mujoco.mj_step(heavy.mjm, data, 2000)
        np.testing.assert_allclose(data.qpos[heavy.mjm.jnt_qposadr[list(arm.joint_ids)]], qpos[world], atol=5e-4)


def test_an_arm_whose_weight_is_borne_has_none():
    """`gravcomp` of 1 in the shipped Panda, unless a task writes it."""
    s = state_of({"robot": {"asset": "panda"}})
    assert ArmController(s)._actuators.bearing(s) == 0.0
    s = state_of({"robot": {"asset": "panda"}})
    s.model_field("body_gravcomp")[1] = 0.5
    arm = ArmController(s)
    off = arm._actuators.bearing(s)
    assert isinstance(off, torch.Tensor)
    assert not off[0].any()
    mjm = copy.copy(s.mjm)
    mjm.body_gravcomp[:] = 0.5
    arm.set_targets(s, arm.qpos(s) + off)
    data = mujocos(s, 1, mjm)
    assert np.abs(data.qfrc_bias[:7]).max() > 10.0
    dofs = s.mjm.jnt_dofadr[list(arm.joint_ids)]
    np.testing.assert_allclose((data.qfrc_actuator + data.qfrc_gravcomp - data.qfrc_bias)[dofs], 0.0, atol=2e-3)
