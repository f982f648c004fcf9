"""Robots that are looked up for a controller, and why some of them cannot be driven."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.errors import ArgumentError, ArmError, UnknownNameError
from sceniris_gym.vector.arm_controller import ArmController
from tests.vector.workshop import mjcf, state_of

SMALL = {"model": str(Path(__file__).parents[1] / "data" / "small_arm.xml")}
PLAIN = mjcf({"base": ("none", "0 0 0", 0.0)})
NAMED = {"in_model": "base", "tcp": "base:point"}
SITE, JOINT = '<site name="base:point"', '<joint name="base:turn about" axis="0 0 1"/>'
BETA = next(line.strip() for line in PLAIN.replace("</actuator>", "\n").splitlines() if "base:beta" in line)


@pytest.mark.parametrize(
    ("changes", "robot", "message"),
    [
        (
            {},
            {"in_model": "base"},
            "the robot has no tool centre point: no site 'tcp' is on its body 'base' or below it",
        ),
        (
            {SITE: '<site name="tcp"', "<worldbody>": '<worldbody><body name="other"/>'},
            {"in_model": "other"},
            "no site 'tcp' is on its body 'other' or below it. Name a site or a body of the robot: 'robot.tcp: NAME'",
        ),
        (
            {BETA: '<motor joint="base:turn about"/>'},
            NAMED,
            "joint 'base:turn about' should have one separate position actuator",
        ),
        ({BETA: "", JOINT: '<joint name="spin" type="ball"/>'}, NAMED, "'spin' between them is a ball joint."),
        (
            {},
            NAMED | {"in_model": "base:palm"},
            "from body 'base:palm' to site 'base:point' should consist of hinges and",
        ),
    ],
)
def test_a_robot_that_cannot_be_driven_is_told_why(tmp_path, changes, robot, message):
    """In one error, which says where, and what would be right."""
    text = PLAIN
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "arm.xml"
    path.write_text(text)
    s = state_of({"model": str(path), "robot": robot})
    with pytest.raises(ArmError) as caught:
        ArmController(s)
    assert str(caught.value).startswith("scene 'scene': ArmController: robot: ")
    assert message in str(caught.value)


def test_a_robot_that_is_not_there_is_told_with_those_that_are(tmp_path):
    """By the names that the user wrote."""
    path = tmp_path / "arms.xml"
    path.write_text(mjcf({"plinth": ("none", "0 0 0", 10.0), "left": ("none", "1 0.2 0", 180.0)}))
    robots = {"left": {"in_model": "plinth", "tcp": "plinth:point"}, "right": {"in_model": "left", "tcp": "left:point"}}
    s = state_of({"model": str(path), "robots": robots})
    with pytest.raises(
        UnknownNameError, match=r"^scene 'scene': ArmController: unknown robot 'panda'. Valid: left, right"
    ):
        ArmController(s, "panda")
    with pytest.raises(ArgumentError, match="name should be one of the scene's robots: left, right"):
        ArmController(s)
    s = state_of({"robot": {"asset": "panda"}})
    with pytest.raises(UnknownNameError, match=r"unknown robot 'ur5e'. Valid: panda."):
        ArmController(s, "ur5e")
    s = state_of(SMALL)
    with pytest.raises(ArmError, match=r"the scene has no robot. Name .*'robot: \{in_model: BODY, tcp: SITE\}'"):
        ArmController(s, "arm")
    s = state_of({"robot": {"asset": "panda", "in_scene": False}})
    with pytest.raises(ArmError, match="robot has 'in_scene: false', so it has no joints to drive"):
        ArmController(s, "panda")
