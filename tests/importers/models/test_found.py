"""Arms in models: their chains, fingers and tool centre points; geoms beneath bodies, and the supports of a model."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.importers.models.found import find_arms, geom_beneath, named_support, support_of, supports_of
from tests.importers.models.models import FINGERS, HEAD, TABLE, arm, posed


def test_an_arm_ends_where_its_fingers_begin_and_a_head_is_no_arm():
    """Its chain has six joints, the fingers are the two bodies on slides, and the tip is a centimetre below theirs."""
    mjm = mujoco.MjModel.from_xml_string(arm(FINGERS, HEAD))
    (found,) = find_arms(mjm, [1])
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
    tcp = find_arms(mjm, [1])[0].tcp(posed(mjm))
    assert (tcp.site, tcp.pitch) == ("grip_site", 90.0)


def test_a_site_far_from_the_fingers_is_no_tool_centre_point():
    """A flange has one, and so do wrists: no object would fit between fingers that begin 8 cm further out."""
    sites = '<site name="tcp_site" pos="0 0 -0.06"/><site name="grasp_site" pos="0 0 0.06"/>'
    mjm = mujoco.MjModel.from_xml_string(arm(sites + FINGERS))
    assert find_arms(mjm, [1])[0].tcp(posed(mjm)).site == "grasp_site"


def test_fingers_behind_the_origin_of_a_hand_do_not_point_back_to_the_arm():
    """Some hands have their origin at the tips: the tool centre point faced the wrist, and no object was in reach."""
    hand = f'<body name="tool" pos="0 0 0.12">{FINGERS.replace("0 0.05", "0 -0.07")}</body>'
    mjm = mujoco.MjModel.from_xml_string(arm(hand))
    tcp = find_arms(mjm, [1])[0].tcp(posed(mjm))
    assert (tcp.body, tcp.turns) == ("tool", (0.0, 0.0, 0.0))
    assert tcp.offset == pytest.approx((0.0, 0.0, -0.05), abs=1e-4)


def test_a_look_of_one_finger_does_not_move_the_tool_centre_point():
    """A gripper whose TCP was 2 mm off its middle had both fingers on one side when closed."""
    look = '<geom type="box" size="0.01 0.01 0.01" pos="0 0.02 0" contype="0" conaffinity="0" mass="0"/>'
    at = FINGERS.index("<geom")
    mjm = mujoco.MjModel.from_xml_string(arm(FINGERS[:at] + look + FINGERS[at:]))
    assert find_arms(mjm, [1])[0].tcp(posed(mjm)).offset == pytest.approx((0.0, 0.0, 0.07), abs=1e-4)


@pytest.mark.parametrize("turns", ["{}", '<body><geom size=".1"/>{}</body>'])
def test_a_body_on_slides_and_hinges_is_no_arm(turns: str):
    """With five joints, on one body or on two: the ball of a sensor's test was an arm without fingers."""
    slides, hinges = (
        "".join(f'<joint type="{kind}" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")[:n])
        for kind, n in (("slide", 3), ("hinge", 2))
    )
    text = f'<mujoco><worldbody><body><geom size=".1"/>{slides}{turns.format(hinges)}</body></worldbody></mujoco>'
    assert find_arms(mujoco.MjModel.from_xml_string(text), [1]) == []


@pytest.mark.parametrize("name", ["moving_jaw", "mover"])
def test_a_hinge_named_as_a_jaw_is_a_finger_and_no_joint_of_the_arm(name: str):
    """The hand is the other finger, and its site is the tool centre point, whose x axis points out of the hand."""
    jaw = f'<body name="{name}" pos="0.02 0 0.02"><joint axis="0 1 0" range="0 90"/><geom size="0.01"/></body>'
    site = '<site name="gripperframe" pos="0.01 0 0.09" euler="0 -90 0"/>'
    mjm = mujoco.MjModel.from_xml_string(arm(site + jaw))
    (found,) = find_arms(mjm, [1])
    assert (mjm.body(found.hand).name, len(found.joints)) == ("hand", 6)
    assert [mjm.body(b).name for b in found.fingers] == [name]
    tcp = found.tcp(posed(mjm))
    assert (tcp.site, tcp.pitch) == ("gripperframe", 90.0)


def test_a_jaw_beside_the_axis_of_the_hand_closes_along_this_axis():
    """Its middle is 25 degrees off the axis, and an arm of five joints reaches few poses with an aslant tool."""
    jaw = '<body name="moving_jaw" pos="0.03 0 0.02"><joint axis="0 1 0" range="0 90"/>{}</body>'
    geom = '<geom type="box" size="0.005 0.01 0.03" pos="0 0 0.06"/>'
    mjm = mujoco.MjModel.from_xml_string(arm(jaw.format(geom)))
    tcp = find_arms(mjm, [1])[0].tcp(posed(mjm))
    assert (tcp.body, tcp.turns) == ("hand", (0.0, 0.0, 0.0))


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_without_fingers_the_last_body_points_along_the_last_joint(axis: str):
    """Whichever way its frame is turned; the arm is upright, so that the tool points up."""
    euler = {"x": "90 0 0", "y": "0 -90 0", "z": "180 0 0"}[axis]
    tool = f'<body name="tool" euler="{euler}"><geom size="0.01"/></body>'
    mjm = mujoco.MjModel.from_xml_string(arm(tool))
    data = posed(mjm)
    (found,) = find_arms(mjm, [1])
    tcp = found.tcp(data)
    assert tcp.body == "tool"
    roll, pitch, _ = np.radians(tcp.turns)
    x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    assert data.body("tool").xmat.reshape(3, 3) @ y @ x @ [0, 0, 1] == pytest.approx([0, 0, 1], abs=1e-6)


def test_things_and_hands_without_an_arm_are_no_arms():
    """Neither are free bodies, nor a chain of three joints."""
    assert find_arms(mujoco.MjModel.from_xml_string(TABLE), range(1, 6)) == []
    assert find_arms(mujoco.MjModel.from_xml_string(arm("", depth=3)), [1]) == []


@pytest.fixture(scope="module")
def mjm() -> mujoco.MjModel:
    """The table with things."""
    return mujoco.MjModel.from_xml_string(TABLE)


@pytest.mark.parametrize(("body", "carrier"), [("can", "table"), ("a/main", "table"), ("top", "a"), ("ball", "ground")])
def test_what_is_straight_below_counts(mjm: mujoco.MjModel, body: str, carrier: str):
    """Also what is transparent; the names are those that a scene uses."""
    geom = geom_beneath(mjm, posed(mjm), mjm.body(body).id)
    assert geom is not None
    named = named_support(mjm, geom, {"a": mjm.body("a/main").id})
    assert named is not None
    assert named[0] == carrier


def test_nothing_is_below_what_is_under_the_ground():
    """A body over nothing has nothing beneath it, and what does not collide is nothing."""
    mjm = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="box" size="1 1 0.1" pos="0 0 -1" contype="0" conaffinity="0"/>'
        '<body name="a"><freejoint/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    assert geom_beneath(mjm, posed(mjm), 1) is None


def test_supports_are_listed_with_their_areas(mjm: mujoco.MjModel):
    """The largest first; robots are none."""
    pieces = extract_pieces(mjm, "physics")
    ground, table = supports_of(mjm, {"can": mjm.body("can").id}, [], pieces)
    assert (ground.name, ground.is_endless) == ("ground", True)
    assert (table.name, table.is_endless) == ("table", False)
    assert table.area == pytest.approx(0.48)
    assert table.extent == pytest.approx((0.6, 0.8))
    assert [s.name for s in supports_of(mjm, {}, [mjm.body("table").id], pieces)] == ["ground"]


def test_a_covered_surface_is_no_open_one():
    """A shelf's board below another carries things that are `in` it."""
    mjm = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="shelf"><geom name="low" type="box" size="0.2 0.2 0.01"/>'
        '<geom type="box" size="0.2 0.2 0.01" pos="0 0 0.4"/></body></worldbody></mujoco>'
    )
    named = named_support(mjm, 0, {})
    assert named is not None
    low = support_of(*named, extract_pieces(mjm, "physics"))
    assert (low.name, low.open_above, low.area) == ("low", False, pytest.approx(0.16))
