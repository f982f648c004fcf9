"""Reading arms from models, judged by MuJoCo's forward kinematics; and what is refused."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.errors import ArmError, UnknownNameError
from sceniris_gym.reach.arm import SerialArm
from tests.reach.arms import ASSETS, MODELS, hinge, link, model, site, slide, tcp_poses


def forward(arm: SerialArm, q: np.ndarray) -> np.ndarray:
    """Multiply the transforms as the Arm's docstring says, shape (4, 4)."""
    pose = np.eye(4)
    for i in range(len(arm.joints) + 1):
        step = np.eye(4)
        step[:3, :3] = Rotation.from_quat(arm.link_quat[i], scalar_first=True).as_matrix()
        step[:3, 3] = arm.link_pos[i]
        pose = pose @ step
        if i < len(arm.joints):
            step, by = np.eye(4), (q[i] - arm.ref[i]) * arm.axis[i]
            if arm.slide[i]:
                step[:3, 3] = by
            else:
                step[:3, :3] = Rotation.from_rotvec(by).as_matrix()
            pose = pose @ step
    return pose


def drawn(arm: SerialArm, num: int) -> np.ndarray:
    """Draw joints within limits."""
    lower, upper = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    return np.random.default_rng(7).uniform(lower, upper, (num, len(arm.joints)))


@pytest.mark.parametrize("name", MODELS)
def test_the_chain_is_that_of_mujoco(name: str):
    """Its product of transforms is the TCP's pose in the base's frame, wherever the base stands."""
    mjm, base = MODELS[name]()
    arm = SerialArm.from_model(mjm, base)
    joints = drawn(arm, 50)
    assert np.abs(np.array([forward(arm, q) for q in joints]) - tcp_poses(mjm, arm, joints)).max() < 1e-12


@pytest.mark.parametrize("name", ["panda", "ur5e", "heron"])
def test_arms_of_the_assets_fit_a_map(name: str):
    """Upright, the TCP on the last joint's axis, fingers left out, home as in the keyframe."""
    mjm, base = MODELS[name]()
    arm = SerialArm.from_model(mjm, base)
    n = 7 if name == "panda" else 6
    assert arm.joints == tuple(f"joint{i}" for i in range(1, n + 1))
    assert arm.vertical
    assert arm.no_map is None
    np.testing.assert_array_equal(arm.axis_xy, [0.0, 0.0])
    np.testing.assert_array_equal(arm.home, mjm.key("home").qpos[:n])
    assert arm.turns_freely(0) == arm.turns_freely(-1) == (name == "ur5e")


def test_limits_come_from_the_model():
    """Of hinges and slides; a hinge without has none."""
    mjm, base = MODELS["endless"]()
    arm = SerialArm.from_model(mjm, base)
    np.testing.assert_array_equal(arm.lower, [-np.inf, -2.5, 0.0, -np.inf])
    np.testing.assert_array_equal(arm.upper, [np.inf, 2.5, 0.3, np.inf])
    np.testing.assert_array_equal(arm.slide, [False, False, True, False])
    assert arm.turns_freely(0)
    assert arm.turns_freely(-1)
    np.testing.assert_array_equal(arm.qposadr, [7, 8, 9, 10])


def test_home_without_a_keyframe_is_the_reference_within_limits():
    """`qpos0`, clamped."""
    arm = SerialArm.from_model(
        model(chain=link(hinge(range="-2 -1", ref="0.5") + link(hinge(ref="0.3") + site()))), "base"
    )
    np.testing.assert_array_equal(arm.ref, [0.5, 0.3])
    np.testing.assert_array_equal(arm.home, [-1.0, 0.3])


def test_the_hash_names_kinematics_alone():
    """It survives being attached under other names and moved; a link, a limit or the TCP changes it."""
    alone = SerialArm.from_model(mujoco.MjModel.from_xml_path(str(ASSETS / "panda.xml")), "panda")
    spec = mujoco.MjSpec()
    frame = spec.worldbody.add_frame(pos=[0.3, -1.0, 0.8], quat=[0.3, 0.1, 0.0, 0.9])
    spec.attach(mujoco.MjSpec.from_file(str(ASSETS / "panda.xml")), prefix="robot/", frame=frame)
    attached = SerialArm.from_model(spec.compile(), "robot/panda", "robot/tcp")
    assert attached.hash == alone.hash
    assert len(alone.hash) == 16
    changes = {
        "link": lambda mjm: mjm.body_pos.__setitem__((mjm.body("link5").id, 1), 0.385),
        "limit": lambda mjm: mjm.jnt_range.__setitem__((3, 0), -3.0),
        "tcp": lambda mjm: mjm.site_pos.__setitem__((mjm.site("tcp").id, 2), 0.11),
    }
    for change in changes.values():
        mjm, base = MODELS["panda"]()
        change(mjm)
        assert SerialArm.from_model(mjm, base).hash != alone.hash


def test_a_first_joint_beside_the_base_is_upright_too():
    """Its axis meets the base's plane somewhere else."""
    mjm = model(chain=link(hinge("0 0 -1", pos="0.05 0 0") + link(hinge("0 1 0") + site()), pos="0.1 0.2 0.3"))
    arm = SerialArm.from_model(mjm, "base")
    assert arm.vertical
    np.testing.assert_allclose(arm.axis_xy, [0.15, 0.2], atol=1e-12)


@pytest.mark.parametrize(
    ("chain", "why"),
    [
        (link(hinge("0 0.1 1") + link(hinge() + site())), "first joint is 5.71 degrees off the z axis of 'base'"),
        (link(slide() + link(hinge() + site())), "first joint is a slide"),
        (link(hinge() + link(slide() + site())), "last joint is a slide"),
        (link(hinge() + link(hinge() + site("0.02 0 0.1"))), "TCP is 20 mm off the axis of the last joint,"),
        (link(hinge() + link(hinge() + site(euler="0.1 0 0"))), "and its z axis is 5.73 degrees off"),
    ],
)
def test_arms_without_symmetry_say_why_no_map_fits(chain: str, why: str):
    """They can be used, but not with a map."""
    arm = SerialArm.from_model(model(chain=chain), "base")
    assert arm.no_map is not None
    assert why in arm.no_map


COUPLED = "<equality><joint name='geared' joint1='a' joint2='b'/></equality>"
LOOP = "<equality><connect body1='hand' body2='base' anchor='0 0 0'/></equality>"
TWO = link(hinge(name="a") + link(hinge("0 1 0", name="b") + site(), name="hand"))


@pytest.mark.parametrize(
    ("mjm", "why"),
    [
        (lambda: model(chain=link(site())), "no joint is between this body and the site 'tcp'. Put the site on a body"),
        (
            lambda: model(chain=link(hinge() * 5 + link(hinge() * 4 + site()))),
            "has 9 joints up to the site 'tcp': it should have at most 8",
        ),
        (lambda: model(chain=link('<joint type="ball" name="b"/>' + site())), "joint 'b' is a ball joint"),
        (lambda: model(chain=link(slide(range=None, name="s") + site())), "joint 's' is a slide without limits"),
        (
            lambda: model(chain=link(slide(range=None) + site(), name="rail")),
            "the unnamed joint of body 'rail' is a slide without limits",
        ),
        (lambda: model(chain=TWO, extra=COUPLED), "not serial: the equality constraint 'geared' couples its joints"),
        (lambda: model(chain=TWO, extra=LOOP), "not serial: the equality constraint 0 couples its joints"),
    ],
)
def test_what_is_no_arm_is_refused(mjm, why: str):
    """Each with its reason, and the name of what is wrong."""
    with pytest.raises(ArmError, match=why):
        SerialArm.from_model(mjm(), "base")


def driving(*joints: str) -> mujoco.MjModel:
    """Compile a cart with three joints, a pillar on it with the others, and an arm of two joints on that."""
    stand = link(TWO, name="stand", pos="0 0 0.1", euler="0.2 0 0.3")
    cart = link("".join(joints[:3]) + link("".join(joints[3:]) + stand, name="pillar"))
    return model(chain=cart, base='pos="0.3 0 0.1"')


@pytest.mark.parametrize(
    "joints",
    [
        (slide("1 0 0", None, name="x"), slide("0 1 0", None, name="y"), hinge(range=None, name="th")),
        [hinge("0 1 0", name=f"torso{i}") for i in range(7)],
    ],
)
def test_a_mobile_base_or_a_torso_is_refused_with_the_body_that_is_an_arm(joints: list[str]):
    """The body named there carries the arm, as MuJoCo moves it."""
    mjm = driving(*joints)
    why, carrier = ("slide without limits", "pillar") if len(joints) == 3 else ("9 joints", "stand")
    with pytest.raises(ArmError, match=rf"{why}.* write `robot: \{{in_model: {carrier}\}}`, a body without joints"):
        SerialArm.from_model(mjm, "base")
    arm = SerialArm.from_model(mjm, carrier)
    q = drawn(arm, 20)
    assert np.abs(np.array([forward(arm, one) for one in q]) - tcp_poses(mjm, arm, q)).max() < 1e-12


def test_a_base_without_such_a_body_is_told_that_it_needs_one():
    """All bodies of the chain have joints."""
    with pytest.raises(ArmError, match=r"in_model: BODY\}`, a body without joints that carries the arm"):
        SerialArm.from_model(model(chain=link(hinge() * 5 + link(hinge() * 4 + site()))), "base")


def test_a_site_elsewhere_is_refused():
    """The TCP is below the base."""
    other = link(hinge(name="a") + link(hinge() + site()))
    with pytest.raises(
        ArmError, match=r"arm 'aside' is not serial: the site 'tcp' is not in the body's subtree\. Put the site on"
    ):
        SerialArm.from_model(model(chain=other + '<body name="aside"/>'), "aside")


def test_constraints_between_fingers_are_none_of_the_arm():
    """Coupled fingers, and a loop within the gripper, leave the arm serial."""
    fingers = link(slide(name="f"), name="left") + link(slide(name="g"), name="right")
    chain = link(hinge() + link(hinge("0 1 0") + site() + fingers, name="hand"))
    extra = "<equality><joint joint1='f' joint2='g'/><connect body1='left' body2='right' anchor='0 0 0'/></equality>"
    assert len(SerialArm.from_model(model(chain=chain, extra=extra), "base").joints) == 2


def test_unknown_names_are_told_with_the_nearest_ones():
    """Bodies and sites."""
    mjm = model(chain=TWO)
    with pytest.raises(UnknownNameError, match=r"unknown body 'bas'\. Did you mean 'base'"):
        SerialArm.from_model(mjm, "bas")
    with pytest.raises(UnknownNameError, match=r"arm 'base': unknown site 'tpc'\. Did you mean 'tcp'"):
        SerialArm.from_model(mjm, "base", "tpc")
