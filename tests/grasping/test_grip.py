"""Grips: the opening that a box of known width needs, the shift that centres it, and grasps that close on nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.grasping.grip import INSIDE, Fingers
from sceniris_gym.program.plan import build_plan
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.program.starts import plan_grips, plan_starts
from sceniris_gym.scene.build import build_model
from tests.grasping.scenes import Scene, rotation
from tests.grasping.test_gripper import ONE_JAW
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.layout.starting import SCENE

WIDTH = 0.05


@pytest.fixture(scope="module")
def closing(tmp_path_factory: pytest.TempPathFactory):
    """A Panda's fingers, and a cube with its grasps."""
    cube = box_mjcf(tmp_path_factory.mktemp("grip"), "cube", WIDTH, WIDTH, WIDTH)
    objects = {"cube": {"asset": cube, "on": "floor", "reachable": "clear"}}
    model = build_model(SceneConfig.load({**SCENE, "objects": objects, "start": [{"robot": "grasp", "of": "cube"}]}))
    plan = build_plan(model)
    one, target = plan.reaching.arms[0], plan.reaching.targets[0]
    return plan, Fingers([model.mjm], one.arm, one.gripper, model.home), target.grasp_set.grasps, model.subtree("cube")


def test_fingers_close_until_they_are_a_little_inside(closing):
    """Each finger of the Panda slides by half of the gap, 40 mm in all; faces across are 50 mm apart."""
    _, fingers, grasps, bodies = closing
    straight = [grasp for grasp in grasps if grasp.name in ("top 0", "top 90", "top 180", "top 270")]
    assert len(straight) == 4
    for grip, grasp in zip(fingers.grips(bodies, straight), straight, strict=True):
        assert grip.fits
        assert grip.share * 0.08 == pytest.approx(WIDTH - 2.0 * INSIDE, abs=2e-5)
        np.testing.assert_allclose(grip.pos, grasp.pos, atol=1e-5)


@pytest.mark.parametrize("off", [0.004, -0.003])
def test_a_thing_off_the_middle_is_centred(closing, off: float):
    """The TCP moves along the closing axis to midway between the contacts."""
    _, fingers, grasps, bodies = closing
    (grasp,) = (grasp for grasp in grasps if grasp.name == "top 0")
    axis = np.array([0.0, 1.0, 0.0])
    (grip,) = fingers.grips(bodies, [grasp._replace(pos=grasp.pos + off * axis)])
    assert grip.fits
    np.testing.assert_allclose(grip.pos, grasp.pos, atol=2e-5)


def test_a_grasp_beside_the_thing_does_not_fit(closing):
    """The fingers meet each other before they touch it."""
    _, fingers, grasps, bodies = closing
    (grip,) = fingers.grips(bodies, [grasps[0]._replace(pos=grasps[0].pos + [0.0, 0.0, 0.2])])
    assert not grip.fits


def test_only_things_that_a_start_holds_are_measured(closing):
    """All grasps of all reach targets have an entry."""
    plan, _, grasps, _ = closing
    grips = plan_grips(plan)
    assert len(grips) == len(grasps)
    assert sum(grip.fits for grip in grips) > len(grasps) // 2


def test_a_jaw_presses_a_thing_against_the_hand(tmp_path: Path):
    """The fixed bar of the hand is 9 mm from the TCP. Before the grasp, the thing is 5 mm from this bar, then at it."""
    turn, bend = '<joint name="turn" axis="0 0 1" range="-90 90"/>', '<joint axis="0 1 0" range="-90 90"/>'
    hand = f'<geom type="box" size=".03 .03 .01"/><site name="tcp" pos="0 0 .1"/>{ONE_JAW}'
    arm = write_mjcf(
        tmp_path, "hobby", f'<body pos="0 0 .3">{turn}<geom size=".02"/><body name="hand">{bend}{hand}</body></body>'
    )
    s = Scene(box_mjcf(tmp_path, "cube", 0.02, 0.02, 0.03), arm)
    (grasp,) = (grasp for grasp in s.grasp_set().grasps if grasp.name == "top 0")
    fingers = Fingers([s.scene.mjm], robot_arm(s.scene), s.gripper, s.scene.home)
    (grip,) = fingers.grips(s.scene.subtree("thing"), [grasp])
    assert grip.fits
    across = rotation(grasp.quat)[:, 1]
    assert -grasp.pos @ across == pytest.approx(0.009 - 0.005 - 0.01, abs=1e-6)
    assert -grip.pos @ across == pytest.approx(0.009 - 0.01 + INSIDE, abs=2e-5)


def test_a_thing_that_slips_is_refused_with_its_motion_and_may_stand(tmp_path: Path):
    """A block of 30 kg is too heavy for the hand in the air, but stands between its fingers."""
    block = {"asset": box_mjcf(tmp_path, "block", 0.04, 0.04, 0.08, 'mass="30"'), "on": "floor", "reachable": "ik"}
    start = {"robot": "grasp", "of": "block"}
    scene = {"floor": {"size": [2, 2]}, "robot": {"asset": "panda"}, "objects": {"block": block}}
    assert any(grip.fits > 0.0 for grip in plan_grips(build_plan(build_model({**scene, "start": [start]}))))
    told = r"upright in the air .*: in the best it moves by \d+\.\d mm \(limit 1\)\. It can be lifted by 0 m"
    plan = build_plan(build_model({**scene, "start": [{**start, "lift": [0.1, 0.2]}]}))
    with pytest.raises(SceneKeyError, match=told):
        plan_starts(plan, plan_grips(plan))
