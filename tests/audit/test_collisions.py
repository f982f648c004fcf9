"""Pairs of solids that must be apart, by MuJoCo's rules; and their distances in layouts and among rejected ones."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.collisions import JudgedPairs, Tree
from sceniris_gym.audit.geometry import solids_of
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from tests.audit.judging import GEOMETRIES, MJM, auditor
from tests.commands.scenes import GAP, MODEL, OBJECTS, bodies, layout, small_config, small_model, with_row
from tests.versions import since_4


def test_contact_bits_and_exclusions_are_honoured():
    """A can that collides with nothing, and a gem that is excluded from the crate, may be anywhere."""
    spec = mujoco.MjSpec.from_string(MODEL)
    spec.geom("can").contype, spec.geom("can").conaffinity = 2, 2
    spec.add_exclude(bodyname1="gem", bodyname2="crate")
    mjm = spec.compile()
    rows = layout(mjm, can=(0.3, 0, GAP, 0), gem=(0.3, 0, 0.01, 0))
    assert not Auditor(mjm, small_config(), bodies(mjm)).judge(rows).conflicts
    assert len(auditor().judge(rows).conflicts) == 3


def test_fixtures_are_kept_from_the_static_world_though_mujoco_is_silent():
    """A shelf in a static wall is a missed collision."""
    spec = mujoco.MjSpec.from_string(MODEL)
    spec.worldbody.add_geom(name="wall", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 1, 1], pos=[-0.45, 0, 0])
    spec.body("crate").add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 0.01, 0.01], pos=[0, 0, 0.04])
    wall = spec.worldbody.add_body(name="pillar", pos=[0, 0.4, 0])
    wall.add_geom(name="pillar", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.5])
    mjm = spec.compile()
    report = Auditor(mjm, small_config(), bodies(mjm)).judge(layout(mjm, shelf=(0, 0.35, GAP, 0)))
    assert {frozenset(c.owners) for c in report.conflicts} == {frozenset({"shelf", "pillar"})}


def test_what_no_layout_moves_is_judged_by_mujoco_alone(tmp_path: Path):
    """A mocap body in a static wall, and two loose ones with contacts off: as at home. What is placed there is not."""
    walls = """<geom type="box" size=".1 .1 .1" pos="1 0 .1"/>
      <body name="guide" mocap="true" pos="1 0 .2"><geom size=".05"/></body>
      <body name="one" pos="0 1 .3"><freejoint/><geom size=".05"/></body>
      <body name="two" pos="0 1 .32"><freejoint/><geom size=".05"/></body>"""
    (tmp_path / "own.xml").write_text(
        f'<mujoco><option><flag contact="disable"/></option><worldbody>{walls}</worldbody></mujoco>'
    )
    scene = {"model": str(tmp_path / "own.xml"), "floor": {"size": [1, 1]}}
    for objects, owners in (({}, set()), ({"one": {"on": "floor"}}, {"one", "two"}), ({"two": {}}, set())):
        config = SceneConfig.load({**scene, "objects": objects})
        mjm = build_model(config).mjm
        judged = Auditor(mjm, config, {name: mjm.body(name).id for name in objects})
        found = {frozenset(pair.owners) for pair in judged.collisions.pairs}
        assert (frozenset(owners) in found) if owners else not found
        assert frozenset({"guide", "world"}) not in found


HEAP = """
<mujoco>
  <worldbody>
    <geom name="ground" type="sphere" size="0.1"/>
    <body name="post"><geom name="post" type="sphere" size="0.1"/></body>
    <body name="arm">
      <geom name="base" type="sphere" size="0.1"/>
      <body name="upper"><joint axis="0 0 1"/><geom name="upper" type="sphere" size="0.1"/>
        <body name="glued"><geom name="glued" type="sphere" size="0.1"/></body>
        <body name="hanging"><joint axis="1 0 0"/><geom name="hanging" type="sphere" size="0.1"/></body>
      </body>
    </body>
    <body name="a"><freejoint/><geom name="a" type="sphere" size="0.1"/>
      <geom name="a, other bit" type="sphere" size="0.1" contype="2" conaffinity="0"/></body>
    <body name="b"><freejoint/><geom name="b" type="sphere" size="0.1"/>
      <geom name="b, other bit" type="sphere" size="0.1" contype="0" conaffinity="2"/></body>
    <body name="c"><freejoint/><geom name="c" type="sphere" size="0.1"/></body>
  </worldbody>
  <contact><exclude body1="a" body2="c"/><exclude body1="upper" body2="post"/></contact>
</mujoco>
"""
HEAPED = ("arm", "glued", "hanging", "a", "b", "c")


def test_geoms_of_different_objects_are_judged_where_mujoco_collides_them():
    """All are at one place, so its contacts say which pairs it looks at: bits, exclusions, welds and parents."""
    mjm = mujoco.MjModel.from_xml_string(HEAP)
    data = mujoco.MjData(mjm)
    mujoco.mj_fwdPosition(mjm, data)
    tree, solids = Tree(mjm, {name: mjm.body(name).id for name in HEAPED}), solids_of(mjm, "physics")
    judged = [
        frozenset(mjm.geom(solids[i].geom).name for i in (pair.first, pair.second))
        for pair in JudgedPairs(tree, solids, "physics", {})
    ]
    owner = {mjm.geom(g).name: tree.owner[mjm.geom_bodyid[g]] for g in range(mjm.ngeom)}
    reported = {frozenset(mjm.geom(g).name for g in contact.geom) for contact in data.contact[: data.ncon]}
    assert set(judged) == {pair for pair in reported if len({owner[name] for name in pair}) == 2}
    assert len(set(judged)) == len(judged) > 10


def test_parts_of_an_object_are_judged_where_its_joints_are_drawn():
    """As MuJoCo reports them, explicit pairs among them, but for those that touch at home."""
    rule = '<exclude body1="a" body2="c"/>'
    mjm = mujoco.MjModel.from_xml_string(HEAP.replace(rule, rule + '<pair geom1="base" geom2="upper" margin="0.01"/>'))
    data = mujoco.MjData(mjm)
    mujoco.mj_fwdPosition(mjm, data)
    tree, solids = Tree(mjm, {name: mjm.body(name).id for name in ("arm", "a", "b", "c")}), solids_of(mjm, "physics")
    judged = {
        frozenset(mjm.geom(solids[i].geom).name for i in (pair.first, pair.second)): pair
        for pair in JudgedPairs(tree, solids, "physics", {"arm": 0.01}, jointed=["arm"])
    }
    reported = {frozenset(mjm.geom(g).name for g in contact.geom) for contact in data.contact[: data.ncon]}
    assert set(judged) == reported
    own = {pair for pair in reported if pair <= {"base", "upper", "glued", "hanging"}}
    assert len(own) >= 3
    assert {judged[pair].clearance for pair in own} == {0.0}
    assert judged[frozenset(("base", "upper"))].margin == 0.01
    assert not list(JudgedPairs(tree, solids, "physics", {}, jointed=["arm"], at_home=_all_pairs(mjm)))


def _all_pairs(mjm: mujoco.MjModel) -> set[tuple[int, int]]:
    return {(i, j) for i in range(mjm.ngeom) for j in range(i, mjm.ngeom)}


def test_what_is_seen_collides_whatever_its_bits_are():
    """With visual geometry the bits of the physics do not count, but exclusions do."""
    mjm = mujoco.MjModel.from_xml_string(HEAP)
    mjm.geom_contype[:] = mjm.geom_conaffinity[:] = 0
    tree, solids = Tree(mjm, {name: mjm.body(name).id for name in HEAPED}), solids_of(mjm, "visual")
    found = {frozenset(pair.owners) for pair in JudgedPairs(tree, solids, "visual", {})}
    assert {frozenset(("a", "b")), frozenset(("a", "world")), frozenset(("a", "post"))} <= found
    assert frozenset(("a", "c")) not in found


def test_a_pair_keeps_the_larger_clearance():
    """The clearance of a pair is that of the pickier object; an object without one asks for nothing."""
    mjm = mujoco.MjModel.from_xml_string(HEAP)
    tree = Tree(mjm, {name: mjm.body(name).id for name in HEAPED})
    judged = JudgedPairs(tree, solids_of(mjm, "physics"), "physics", {"a": 0.01, "b": 0.03})
    clearance = {frozenset(pair.owners): pair.clearance for pair in judged}
    assert clearance[frozenset(("a", "b"))] == 0.03
    assert clearance[frozenset(("a", "post"))] == 0.01
    assert clearance[frozenset(("c", "post"))] == 0.0


def test_bodies_belong_to_the_object_above_them():
    """Or to the child of the world above them; what hangs on a joint or is a mocap body can be elsewhere."""
    mjm = small_model()
    tree = Tree(mjm, {name: mjm.body(name).id for name in ("shelf", "gem")})
    assert tree.owner == ["world", "shelf", "shelf", "gem", "can", "crate"]
    assert tree.movable.tolist() == [False] + [True] * 5
    assert tree.fixture.tolist() == [False, True, True] + [False] * 3


ORDER = list(OBJECTS)


@since_4("mj_geomDistance says 0 of some shapes that are apart")
def test_conflicts_are_the_pairs_that_mujoco_finds_too_near():
    """Crowded random rows: a pair is reported exactly where MuJoCo's own distance is below the clearance."""
    rng = np.random.default_rng(3)
    judge = auditor()
    rows = layout(MJM, 200)
    for i in range(len(rows)):
        crowd = {name: tuple(rng.uniform([-0.07, -0.07, 0.0, -3.0], [0.07, 0.07, 0.12, 3.0])) for name in ORDER[1:]}
        rows = with_row(rows, i, layout(MJM, 1, **crowd))
    found = {(c.row, c.geoms) for c in judge.judge(rows).conflicts}
    data = mujoco.MjData(MJM)
    checked = 0
    for i in range(len(rows)):
        rows.put(data, i)
        mujoco.mj_kinematics(MJM, data)
        for pair in judge.collisions.pairs:
            first, second = (judge.collisions.solids[k].geom for k in (pair.first, pair.second))
            if "world" in pair.owners:
                continue  # planes, and what stands on them, have a test of their own
            surplus = mujoco.mj_geomDistance(MJM, data, first, second, 1.0, None) - pair.clearance
            if abs(surplus) > 1e-4:
                assert ((i, (first, second)) in found) == (surplus < 0), (i, pair.owners, surplus)
                checked += 1
    assert len(found) > 200
    assert checked > 2000


@GEOMETRIES
def test_a_pair_within_its_clearance_is_a_missed_collision(geometry: str):
    """The larger clearance of two objects counts, less the tolerance of 0.01 mm."""
    touching = 0.3 - 0.04 - 0.03
    near = [layout(MJM, crate=(0.3, 0, GAP, 0), can=(touching - d, 0, GAP, 0)) for d in (0.00198, 0.002005)]
    found = [auditor(geometry, can={"clearance": 0.002}).judge(rows).conflicts for rows in near]
    assert [len(f) for f in found] == [1, 0]
    assert found[0][0].distance == pytest.approx(0.00198, abs=1e-5)


@GEOMETRIES
def test_an_object_may_touch_what_carries_it_but_not_sink_in(geometry: str):
    """A gem and a crate 0.05 mm into their supports are missed collisions, one that just touches is none."""
    sunk = layout(MJM, gem=(0, -0.04, GAP + 0.02 - 5e-5, 0), crate=(0.3, 0, -5e-5, 0.5))
    flat = {name: {"gap": 0.00002} for name in ("gem", "crate")}
    pairs = {frozenset(c.owners) for c in auditor(geometry, **flat).judge(sunk).conflicts}
    assert pairs == {frozenset({"gem", "shelf"}), frozenset({"crate", "world"})}
    touching = layout(MJM, gem=(0, -0.04, GAP + 0.02, 0), crate=(0.3, 0, 0, 0.5))
    assert not auditor(geometry, **flat).judge(touching).conflicts


@GEOMETRIES
def test_rejected_candidates_are_false_alarms_only_if_they_keep_their_clearance(geometry: str):
    """Candidates that touch, come too near, are enclosed, or are free; what is placed later is not there yet."""
    touching = 0.3 - 0.04 - 0.03
    rows = layout(MJM, 6)
    for i, d in ((0, -0.001), (1, 0.0009), (2, 0.0012), (4, 0.01)):
        rows = with_row(rows, i, layout(MJM, crate=(0.3, 0, GAP, 0), can=(touching - d, 0, GAP, 0)))
    rows = with_row(rows, 3, layout(MJM, crate=(0, -0.04, 0.03, 0)))  # encloses the gem, touches the shelf
    rows = with_row(rows, 5, layout(MJM, crate=(0.3, 0, GAP, 0), can=(touching, 0, GAP, 0)))
    candidate = ["crate", "crate", "crate", "crate", "crate", "can"]
    alarms = auditor(geometry).judge_rejected(rows, candidate, ORDER)
    assert [alarm.row for alarm in alarms] == [2, 4, 5]
    assert alarms[0].surplus == pytest.approx(0.0002, abs=1e-5)
    assert set(alarms[0].owners or ()) == {"can", "crate"}
