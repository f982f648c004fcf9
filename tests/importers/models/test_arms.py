"""Arms in models: which chain of joints is one, where its fingers begin, and where its tool centre point is."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.importers.models.arms import find_arms
from tests.importers.models.models import FINGERS, HEAD, TABLE, arm, posed


def test_an_arm_ends_where_its_fingers_begin_and_a_head_is_no_arm():
    """Its chain has six joints, the fingers are the two bodies on slides, and the tip is a centimetre below theirs."""
    mjm = mujoco.MjModel.from_xml_string(arm(FINGERS, HEAD))
    (found,) = find_arms(mjm)
    assert (mjm.body(found.base).name, mjm.body(found.hand).name, len(found.joints)) == ("base", "hand", 6)
    assert {mjm.body(b).name for b in found.fingers} == {"left", "right"}
    tcp = found.tcp(posed(mjm))
    assert tcp.body == "hand"
    assert tcp.turns == (0.0, 0.0, 0.0)
    assert tcp.offset == pytest.approx((0.0, 0.0, 0.07), abs=1e-4)


def test_a_site_that_is_named_for_it_is_the_tool_centre_point():
    """It is turned where the fingers point elsewhere than its z axis."""
    site = '<site name="grip_site" pos="0 0 0.06" euler="0 -90 0"/><site name="mark"/>'
    mjm = mujoco.MjModel.from_xml_string(arm(site + FINGERS))
    tcp = find_arms(mjm)[0].tcp(posed(mjm))
    assert (tcp.site, tcp.pitch) == ("grip_site", 90.0)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_without_fingers_the_last_body_points_along_the_last_joint(axis: str):
    """Whichever way its frame is turned; the arm is upright, so that the tool points up."""
    euler = {"x": "90 0 0", "y": "0 -90 0", "z": "180 0 0"}[axis]
    tool = f'<body name="tool" euler="{euler}"><geom size="0.01"/></body>'
    mjm = mujoco.MjModel.from_xml_string(arm(tool))
    data = posed(mjm)
    (found,) = find_arms(mjm)
    tcp = found.tcp(data)
    assert tcp.body == "tool"
    roll, pitch, _ = np.radians(tcp.turns)
    x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    assert data.body("tool").xmat.reshape(3, 3) @ y @ x @ [0, 0, 1] == pytest.approx([0, 0, 1], abs=1e-6)


def test_things_and_hands_without_an_arm_are_no_arms():
    """Neither are free bodies, nor a chain of three joints."""
    assert find_arms(mujoco.MjModel.from_xml_string(TABLE)) == []
    assert find_arms(mujoco.MjModel.from_xml_string(arm("", depth=3))) == []
