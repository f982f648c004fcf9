"""Pairs of geoms that must be apart, against the contacts that MuJoCo finds where everything overlaps."""

from pathlib import Path

import mujoco

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.geometry import solids_of
from sceniris_gym.audit.pairs import Tree, judged_pairs
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from tests.audit.judging import auditor
from tests.commands.scenes import GAP, MODEL, bodies, layout, small_config, small_model


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
        for pair in judged_pairs(tree, solids, "physics", {})
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
        for pair in judged_pairs(tree, solids, "physics", {"arm": 0.01}, jointed=["arm"])
    }
    reported = {frozenset(mjm.geom(g).name for g in contact.geom) for contact in data.contact[: data.ncon]}
    assert set(judged) == reported
    own = {pair for pair in reported if pair <= {"base", "upper", "glued", "hanging"}}
    assert len(own) >= 3
    assert {judged[pair].clearance for pair in own} == {0.0}
    assert judged[frozenset(("base", "upper"))].margin == 0.01
    assert not judged_pairs(tree, solids, "physics", {}, jointed=["arm"], at_home=_all_pairs(mjm))


def _all_pairs(mjm: mujoco.MjModel) -> set[tuple[int, int]]:
    return {(i, j) for i in range(mjm.ngeom) for j in range(i, mjm.ngeom)}


def test_what_is_seen_collides_whatever_its_bits_are():
    """With visual geometry the bits of the physics do not count, but exclusions do."""
    mjm = mujoco.MjModel.from_xml_string(HEAP)
    mjm.geom_contype[:] = mjm.geom_conaffinity[:] = 0
    tree, solids = Tree(mjm, {name: mjm.body(name).id for name in HEAPED}), solids_of(mjm, "visual")
    found = {frozenset(pair.owners) for pair in judged_pairs(tree, solids, "visual", {})}
    assert {frozenset(("a", "b")), frozenset(("a", "world")), frozenset(("a", "post"))} <= found
    assert frozenset(("a", "c")) not in found


def test_a_pair_keeps_the_larger_clearance():
    """The clearance of a pair is that of the pickier object; an object without one asks for nothing."""
    mjm = mujoco.MjModel.from_xml_string(HEAP)
    tree = Tree(mjm, {name: mjm.body(name).id for name in HEAPED})
    judged = judged_pairs(tree, solids_of(mjm, "physics"), "physics", {"a": 0.01, "b": 0.03})
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
