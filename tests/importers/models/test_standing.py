"""Carriers beneath bodies, by the known heights of boxes, and the list of all that can carry something."""

from __future__ import annotations

import mujoco
import pytest

from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.importers.models.standing import geom_beneath, named_support, support_of, supports_of
from tests.importers.models.models import TABLE, posed


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
