"""Contacts as MuJoCo C reports them: which are collisions, and which are allowed for."""

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor, Report
from sceniris_gym.audit.collisions import Tree
from sceniris_gym.audit.contacts import ContactAudit
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import MJM, auditor
from tests.commands.scenes import layout, with_row

# A frame with two doors that overlap by 2 mm at home, on a desk into which it is let by 1 mm; and two things.
MODEL = """
<mujoco>
  <worldbody>
    <geom name="desk" type="box" size="1 1 0.1" pos="0 0 -0.1"/>
    <body name="machine">
      <geom name="foot" size="0.01"/>
      <body name="column"><joint name="turn" axis="0 0 1"/>
        <geom name="column" type="box" size="0.05 0.05 0.05" pos="0 0 0.049"/></body>
      <body name="left" pos="0 0 1"><joint name="left" type="slide" axis="1 0 0"/>
        <geom name="left" type="box" size="0.1 0.1 0.1" pos="-0.099 0 0"/></body>
      <body name="right" pos="0 0 1"><joint name="right" type="slide" axis="1 0 0"/>
        <geom name="right" type="box" size="0.1 0.1 0.1" pos="0.099 0 0"/></body>
    </body>
    <body name="can"><freejoint/><geom name="can" size="0.05" pos="0 0 0.05" {can}/></body>
    <body name="cup"><freejoint/><geom name="cup" size="0.05" pos="0 0 0.05" {cup}/></body>
  </worldbody>
  <contact>{contact}</contact>
</mujoco>
"""
OBJECTS = {name: {"asset": name, "region": {"box": [[-0.9, -0.9, 0], [0.9, 0.9, 2]]}} for name in ("can", "cup")}


def judged(
    *rows: tuple[float, float, float],
    geometry: str = "physics",
    can: str = "",
    cup: str = "",
    contact: str = "",
    model: str = MODEL,
) -> Report:
    """The report on rows of (left door, right door, distance between can and cup) [m]."""
    mjm = mujoco.MjModel.from_xml_string(model.format(can=can, cup=cup, contact=contact))
    objects = OBJECTS | {"machine": {"asset": "machine", "kind": "static", "joints": {"*": {"noise": 0.1}}}}
    config = SceneConfig.load({"geometry": geometry, "objects": objects})
    qpos = np.repeat(mjm.qpos0[None], len(rows), axis=0)
    for i, (left, right, away) in enumerate(rows):
        qpos[i, 1:3] = left, right
        qpos[i, 3:6], qpos[i, 10:13] = (0.5, 0.0, 0.1), (0.5, 0.1 + away, 0.1)
    nothing = np.zeros((len(rows), 0, 3)), np.zeros((len(rows), 0, 4))
    table = LayoutTable.from_states(qpos, *nothing, present=np.ones((len(rows), 3), bool))
    bodies = {"can": mjm.body("can").id, "cup": mjm.body("cup").id, "machine": mjm.body("machine").id}
    return Auditor(mjm, config, bodies).judge(table)


def test_a_penetration_is_what_mujoco_measures():
    """A crate 3 mm in the floor is 3 mm deep, and is a missed collision."""
    rows = with_row(layout(MJM, 3), 1, layout(MJM, crate=(0.3, 0, -0.003, 0.5)))
    report = auditor().judge(rows)
    assert report.penetration is not None
    assert report.penetration.depth == pytest.approx(0.003, abs=1e-6)
    assert report.penetration.row == 1
    assert set(report.penetration.owners) == {"world", "crate"}
    assert [c.row for c in report.conflicts] == [1]


def test_what_touches_at_home_may_be_as_deep_as_there():
    """Doors that overlap by 2 mm and a column let into the desk by 1 mm are allowed for, and listed with the reason."""
    report = judged((0.0, 0.0, 0.1), (-0.001, 0.0, 0.1), (0.000005, 0.0, 0.1), (0.0, -0.001, 0.1))
    assert [(c.row, c.owners) for c in report.conflicts] == [(3, ("machine", "machine"))]
    assert report.penetration is not None
    assert report.penetration.excess == pytest.approx(0.001, abs=1e-9)
    found = {names: depths for names, (_, *depths) in report.allowed.items()}
    assert found["left", "right"] == pytest.approx([0.002, 0.003], abs=1e-9)
    assert found["world", "column"] == pytest.approx([0.001, 0.001], abs=1e-9)


def test_other_geoms_of_bodies_that_touch_at_home_are_kept_apart():
    """A latch of the left door that is pulled into a stop of the right one, while the doors themselves part."""
    latch = ('<geom name="left"', '<geom name="latch" size="0.01" pos="0.30 0 0.3"/><geom name="left"')
    stop = ('<geom name="right"', '<geom name="stop" size="0.01" pos="0.25 0 0.3"/><geom name="right"')
    model = MODEL.replace(*latch).replace(*stop)
    report = judged((0.0, 0.0, 0.1), (-0.02, 0.0, 0.1), (-0.045, 0.0, 0.1), model=model)
    mjm = mujoco.MjModel.from_xml_string(model.format(can="", cup="", contact=""))
    assert [(c.row, {mjm.geom(g).name for g in c.geoms}) for c in report.conflicts] == [(2, {"latch", "stop"})]


def test_without_a_missed_collision_nothing_is_deeper_than_the_tolerance():
    """The two numbers are one verdict, whatever is allowed for."""
    report = judged((0.0, 0.0, 0.1), (-0.002, 0.001, 0.1))
    assert report.colliding == 0
    assert report.penetration is None or report.penetration.excess <= 1e-5


def test_mujocos_own_rules_hold():
    """Explicit pairs count whatever the bits are, margins from where MuJoCo acts on; exclusions count for nothing."""
    airy = 'contype="2" conaffinity="0"'
    assert judged((0.0, 0.0, -0.001)).colliding == 1
    assert judged((0.0, 0.0, -0.001), can=airy, cup=airy).colliding == 0
    pair = '<pair geom1="can" geom2="cup"/><exclude body1="can" body2="cup"/>'
    assert judged((0.0, 0.0, -0.001), can=airy, cup=airy, contact=pair).colliding == 1
    assert judged((0.0, 0.0, 0.015)).colliding == 0
    assert judged((0.0, 0.0, 0.015), can='margin="0.02"').colliding == 1
    assert judged((0.0, 0.0, -0.001), contact='<exclude body1="can" body2="cup"/>').colliding == 0


def test_shapes_that_collide_are_allowed_for_where_the_drawn_ones_are_kept_apart():
    """With `geometry: visual` a contact is listed, and FCL alone decides."""
    unseen = 'group="3"'
    report = judged((0.0, 0.0, -0.001), geometry="visual", can=unseen)
    assert (report.colliding, report.penetration) == (0, None)
    why, _, depth = report.allowed["can", "cup"]
    assert depth == pytest.approx(0.001, abs=1e-9)
    assert "visual geoms" in why


def test_placed_objects_say_nothing_at_home():
    """All of them are at the origin there, in each other."""
    tree = Tree(MJM, {name: MJM.body(name).id for name in ("can", "crate", "gem", "shelf")})
    placed = {name: MJM.body(name).id for name in ("can", "crate", "gem", "shelf")}
    assert ContactAudit(tree, placed, set()).at_home == {}
    assert ("can", "crate") in {
        tuple(sorted(tree.owner[int(MJM.geom_bodyid[g])] for g in geoms))
        for geoms in ContactAudit(tree, {}, set()).at_home
    }
