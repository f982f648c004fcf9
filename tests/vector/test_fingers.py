"""Fingers, whatever moves them: MuJoCo C closes and opens hands by the controls that were found."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArmError
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.fingers import Fingers
from tests.vector.workshop import HANDS, JOINTS, mjcf, state_of

DRIVEN = [name for name, hand in HANDS.items() if hand.actuators]


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
        ArmError, match=r"robot: the robot's fingers hang on linkages, so .* by State.poses or State.site"
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
