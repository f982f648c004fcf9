"""Joint equalities: MuJoCo's own residual vanishes, positions are followed, and others are refused by name."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.couplings import coupling_arrays, driven_by, follow, free_range, joint_couplings, reversed_for
from sceniris_gym.scene.model import SceneModel
from tests.layout.scenes import write_mjcf
from tests.program.scenes import pack, scene_of

JOINTS = {
    "a": 'type="hinge" axis="0 0 1" ref=".3" range="-2 2"',
    "b": 'type="slide" axis="0 0 1" ref="-.2" range="-1 1"',
    "c": 'type="hinge" axis="0 1 0"',
    "d": 'type="slide" axis="1 0 0"',
}
TIE = '<joint name="gear" joint1="right" joint2="left" polycoef="0 .5"/>'


def chain(ties: str, flags: str = "", key: str = "") -> str:
    """A model of four bodies in the world, whose joints are tied."""
    bodies = "".join(f'<body><joint name="{n}" {words}/><geom size=".1"/></body>' for n, words in JOINTS.items())
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="0 0 0">{flags}</option><worldbody>{bodies}</worldbody>'
        f"<equality>{ties}</equality>{key}</mujoco>"
    )


def model(ties: str, flags: str = "") -> mujoco.MjModel:
    """The same, compiled."""
    return mujoco.MjModel.from_xml_string(chain(ties, flags))


def placed(folder: Path, ties: str, joints: dict, home: str = "0 0") -> SceneModel:
    """A fixture of two slides, `left` and `right`, with these equalities and words for its joints."""
    body = "".join(
        f'<body name="{n}" pos="{x} 0 .1"><joint name="{n}" type="slide" axis="0 1 0" range="-.1 {high}"/>'
        '<geom type="box" size=".01 .01 .01"/></body>'
        for n, x, high in (("left", -0.1, 0.3), ("right", 0.1, 0.2))
    )
    rest = f'<equality>{ties}</equality><keyframe><key name="home" qpos="{home}"/></keyframe>'
    asset = write_mjcf(folder, "pair", f'<geom type="box" size=".01 .01 .01"/>{body}', rest)
    words = {"asset": asset, "kind": "fixture", "region": {"box": [[-0.2, -0.2, 0.2], [0.2, 0.2, 0.6]]}}
    return scene_of({"pair": {**words, "joints": joints}})


def test_following_leaves_no_residual_by_mujoco():
    """A chain in the wrong order, polynomials of all degrees, references that are not zero, and a held joint."""
    mjm = model(
        '<joint joint1="c" joint2="b" polycoef=".1 -.4 .3 .2 -.1"/><joint joint1="b" joint2="a" polycoef="-.1 .5"/>'
        '<joint joint1="d" polycoef=".7"/>'
    )
    couplings, data = joint_couplings(mjm, "here"), mujoco.MjData(mjm)
    assert [mjm.joint(c.follower).name for c in couplings] == ["b", "d", "c"]
    assert [mjm.joint(c.follower).name for c in driven_by(couplings, [mjm.joint("a").id])] == ["b", "c"]
    for x in np.linspace(-2, 2, 9):
        data.qpos[:] = [x, 5, 5, 5]
        follow(couplings, data.qpos)
        mujoco.mj_forward(mjm, data)
        assert data.ne == 3
        np.testing.assert_allclose(data.efc_pos[: data.ne], 0, atol=1e-12)


def test_the_values_over_an_interval_are_those_of_all_its_points():
    """A turning point within it counts, one beyond it does not."""
    (c,) = joint_couplings(model('<joint joint1="d" joint2="a" polycoef=".1 0 1 .2 -.4"/>'), "here")
    for low, high in ((-1.0, 2.0), (0.0, 0.5), (0.7, 0.7)):
        values = c.at(np.linspace(low, high, 20001))
        np.testing.assert_allclose(c.over(low, high), (values.min(), values.max()), atol=1e-7)
    np.testing.assert_allclose(model_held().over(-1, 1), (0.7, 0.7))


def model_held():
    """The coupling of a held joint."""
    return joint_couplings(model('<joint joint1="d" polycoef=".7"/>'), "here")[0]


def test_a_joint_is_free_as_far_as_what_follows_it():
    """Its own limits where nothing does; a joint without limits gets those of its follower."""
    mjm = model('<joint joint1="b" joint2="a" polycoef="0 2"/><joint joint1="a" joint2="c" polycoef="0 1"/>')
    couplings, home = joint_couplings(mjm, "here"), np.array([0.3, -0.2, 0, 0])
    assert free_range(mjm, couplings, 3, home) == (-np.inf, np.inf)
    assert free_range(mjm, couplings, 1, home) == (-1, 1)
    np.testing.assert_allclose(free_range(mjm, couplings, 0, home), (0.3 - 0.4, 0.3 + 0.6), atol=1e-8)
    np.testing.assert_allclose(free_range(mjm, couplings, 2, home), (-0.4, 0.6), atol=1e-8)


@pytest.mark.parametrize("disabled", ['<flag equality="disable"/>', '<flag constraint="disable"/>', "inactive"])
def test_what_mujoco_does_not_enforce_is_nobody_s_business(disabled: str):
    """Inactive equalities, and those that an option turns off; also a pair that would be a cycle."""
    off = ' active="false"' if disabled == "inactive" else ""
    ties = f'<joint joint1="a" joint2="b"{off}/><joint joint1="b" joint2="a"{off}/>'
    assert joint_couplings(model(ties, "" if off else disabled), "here") == ()


def test_a_straight_coupling_is_reversed_for_what_is_drawn_by_name():
    """Up to the driver of all, which the others still follow; one that bends, or whose driver is drawn, is not."""
    ties = '<joint joint1="b" joint2="a" polycoef=".1 -.5"/><joint joint1="c" joint2="b" polycoef=".2 2"/>'
    ties += '<joint joint1="d" joint2="a" polycoef="0 1 .1"/>'
    mjm, data = model(ties), mujoco.MjData(model(ties))
    given, ids = joint_couplings(mjm, "here"), [mjm.joint(n).id for n in "abcd"]
    found = reversed_for(mjm, given, [ids[2]])
    assert [(c.follower, c.driver) for c in found] == [(ids[1], ids[2]), (ids[0], ids[1]), (ids[3], ids[0])]
    assert found[1].limits == (-2.0, 2.0)
    for value in (-0.4, 0.0, 0.7):
        data.qpos[2] = value
        follow(found, data.qpos)
        mujoco.mj_fwdPosition(mjm, data)
        np.testing.assert_allclose(data.efc_pos[:3], 0.0, atol=1e-12)
        assert data.qpos[2] == value
    assert reversed_for(mjm, given, [ids[3]]) == given
    assert reversed_for(mjm, given, [ids[2], ids[0]]) == given


def test_joints_that_are_tied_to_the_same_first_joint_follow_it():
    """As the fingers of the Archer Y6 are: a second line of the first joint is read backwards."""
    ties = '<joint joint1="a" joint2="b" polycoef=".1 -.5"/><joint joint1="a" joint2="c" polycoef=".2 2"/>'
    mjm, data = model(ties), mujoco.MjData(model(ties))
    found, ids = joint_couplings(mjm, "here"), [mjm.joint(n).id for n in "abc"]
    assert [(c.follower, c.driver) for c in found] == [(ids[0], ids[1]), (ids[2], ids[0])]
    for value in (-0.4, 0.0, 0.7):
        data.qpos[ids[1]] = value
        follow(found, data.qpos)
        mujoco.mj_fwdPosition(mjm, data)
        np.testing.assert_allclose(data.efc_pos[:2], 0.0, atol=1e-12)
    with pytest.raises(SceneKeyError, match="joint 'a' is determined by equality 0"):
        joint_couplings(model(ties.replace(".2 2", ".2 2 1")), "here")


def test_cycles_and_joints_that_are_tied_twice_are_refused():
    """With the names of all that takes part."""
    with pytest.raises(SceneKeyError, match="here: joints follow each other by equalities: a -> c -> b"):
        joint_couplings(
            model('<joint joint1="a" joint2="c"/><joint joint1="b" joint2="a"/><joint joint1="c" joint2="b"/>'), "here"
        )
    with pytest.raises(SceneKeyError, match=r"equality 'two' \(joint\): joint 'a' is determined by equality 'one'"):
        joint_couplings(model('<joint name="one" joint1="a" joint2="c"/><joint name="two" joint1="a"/>'), "here")


def test_a_word_that_draws_a_following_joint_is_refused_and_a_pattern_passes_it_over(tmp_path: Path):
    """By name, or by a pattern that matches nothing else; the message says what to draw instead."""
    tie = '<joint name="gear" joint1="right" joint2="left"/>'
    scene = placed(tmp_path, tie, {"*": {"range": [0, 0.1]}})
    assert [scene.mjm.joint(j).name for j in scene.joint_configs("pair")] == ["pair/left"]
    assert {scene.mjm.joint(j).name for j in scene.moving_joints("pair")} == {"pair/left", "pair/right"}
    for word in ("right", "ri*"):
        with pytest.raises(SceneKeyError) as caught:
            placed(tmp_path, tie, {word: {"range": [0, 0.1]}, "left": {"value": 0.1}})
        for text in (f"objects.pair.joints.{word}", "equality 'pair/gear' (joint)", "'pair/right' follow 'pair/left'"):
            assert text in str(caught.value)
    with pytest.raises(SceneKeyError, match=r"holds joint 'pair/right' at 0.05 \(m or rad\), so it cannot be drawn"):
        placed(tmp_path, '<joint joint1="right" polycoef=".05"/>', {"right": {"value": 0}})


def test_a_mimic_that_is_drawn_by_its_name_drives_the_other(tmp_path: Path):
    """Its range is what is asked for; a pattern that names the other one passes that over."""
    tie = '<joint name="gear" joint1="right" joint2="left" polycoef="0 .5"/>'
    scene = placed(tmp_path, tie, {"right": {"range": [0, 0.1]}, "*": {"value": 0.3}}, home=".1 .05")
    assert [scene.mjm.joint(j).name for j in scene.joint_configs("pair")] == ["pair/right"]
    assert {scene.mjm.joint(j).name for j in scene.moving_joints("pair")} == {"pair/left", "pair/right"}
    np.testing.assert_allclose(scene.home_qpos, [0.1, 0.05])
    with pytest.raises(SceneKeyError, match=r"makes 'pair/right' follow 'pair/left'"):
        placed(tmp_path, tie.replace(".5", ".5 .1"), {"right": {"range": [0, 0.1]}})


def test_a_joint_of_the_robot_has_the_name_that_a_scene_file_has_for_it(tmp_path: Path):
    """Not the name in the model, which begins with the name of the arm's file."""
    arm = (Path(__file__).parents[1] / "data" / "six_axes.xml").read_text()
    tie = '<equality><joint joint1="right" joint2="left"/></equality>'
    (tmp_path / "lab.xml").write_text(arm.replace("</mujoco>", f"{tie}</mujoco>"))
    for joints, says in (
        ({"axis1": {"range": [0, 9]}}, r"inside the limits of 'robot/axis1'"),
        (
            {"right": {"range": [0, 0.01]}, "left": {"range": [0, 0.01]}},
            r"makes 'robot/right' follow 'robot/left'.*\. Draw 'robot/left' instead",
        ),
    ):
        robot = {"asset": str(tmp_path / "lab.xml"), "joints": joints}
        with pytest.raises(SceneKeyError, match=says):
            build_model(SceneConfig.load({"robot": robot, "objects": {}}))


def test_the_start_pose_keeps_equalities_that_its_keyframe_breaks(tmp_path: Path):
    """Followers take the positions of their drivers, in the scene's keyframe too, and in that of an own model."""
    scene = placed(tmp_path, '<joint joint1="right" joint2="left" polycoef=".01 .5"/>', {}, home=".1 .2")
    np.testing.assert_allclose(scene.home_qpos, [0.1, 0.06])
    np.testing.assert_allclose(scene.mjm.key("home").qpos, scene.home_qpos)
    key = '<keyframe><key name="home" qpos=".4 .5 .6 .7"/></keyframe>'
    (tmp_path / "own.xml").write_text(chain('<joint joint1="d" joint2="c"/>', key=key))
    own = scene_of({}, model=str(tmp_path / "own.xml"))
    np.testing.assert_allclose(own.home_qpos, [0.4, 0.5, 0.6, 0.6])
    np.testing.assert_allclose(own.mjm.key("home").qpos, own.home_qpos)
    assert build_model(own.config).hash == own.hash


def test_a_follower_passes_through_what_its_driver_is_drawn_from(tmp_path: Path):
    """Intervals and choices; noise ends where the follower meets its limit."""
    for words, low, high in (
        ({"range": [-0.1, 0.3]}, -0.05, 0.15),
        ({"choice": [0.0, 0.2]}, 0.0, 0.1),
        ({"value": 0.2}, 0.1, 0.1),
    ):
        (o,) = build_plan(placed(tmp_path, TIE, {"left": words})).objects
        (follower,) = o.followers
        np.testing.assert_allclose(o.spans[follower.adr], (low, high), atol=1e-12)
    steep = TIE.replace(".5", "4")
    (o,) = build_plan(placed(tmp_path, steep, {"*": {"noise": 0.2}})).objects
    np.testing.assert_allclose(o.joint_ranges[0].intervals, [(-0.025, 0.05)], atol=1e-8)
    assert build_plan(placed(tmp_path, steep, {})).objects[0].followers == ()


def test_the_device_gets_addresses_and_numbers_of_each_object_s_followers(tmp_path: Path):
    """Lists of length 0 for what has none."""
    packed = pack(placed(tmp_path, TIE, {"left": {"noise": 0.1}}))
    assert packed.listed("pair", "follow", "follow_qposadr") == [1]
    assert packed.listed("pair", "follow", "follow_driveradr") == [0]
    np.testing.assert_allclose(packed["follow_coef"], [[0, 0, 0.5, 0, 0, 0]])
    assert coupling_arrays(())["follow_coef"].shape == (0, 6)
