"""Colliders that are kept apart: by hand for what is placed, by the contacts of MuJoCo C for an arm in a grasp."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.colliders import Collider, collect_colliders
from sceniris_gym.program.pack.descent import Trees
from sceniris_gym.program.pack.pairs import ArmPairs, Pair, PairRules, arm_pairs, collider_pairs
from sceniris_gym.program.plan import Plan, build_plan
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from tests.layout.scenes import box_mjcf
from tests.program.scenes import scene_of


class Scene:
    """An arm, two objects to reach, one that is not, and a marker."""

    def __init__(self, folder: Path, robot: str) -> None:
        crate = box_mjcf(folder, "crate", 0.05, 0.05, 0.05)
        reached = {"asset": crate, "on": "floor", "reachable": "ik"}
        objects = {
            "first": reached,
            "other": {"asset": crate, "on": "floor"},
            "second": reached,
            "goal": {"asset": crate, "kind": "marker", "on": "floor"},
        }
        config = {"floor": {"size": [2.0, 2.0]}, "robot": {"asset": robot}, "objects": objects}
        self.model: SceneModel = build_model(SceneConfig.load(config))
        self.plan: Plan = build_plan(self.model)
        self.colliders: list[Collider] = collect_colliders(self.plan.pieces, False, "cpu")

        self.arm: ArmPairs = arm_pairs(self.plan, PairRules(self.model, self.colliders))

    def names(self, pairs: list[Pair]) -> set[frozenset[str]]:
        """A list as pairs of names of bodies."""
        mjm, body = self.model.mjm, [c.body for c in self.colliders]
        return {frozenset((mjm.body(body[p.a]).name, mjm.body(body[p.b]).name)) for p in pairs}


@pytest.mark.parametrize("robot", ["panda", "ur5e", "heron"])
def test_self_contacts_are_those_that_mujoco_reports(tmp_path: Path, robot: str):
    """In random joint states MuJoCo finds contacts of the robot with itself between listed bodies alone."""
    scene = Scene(tmp_path, robot)
    mjm, data = scene.model.mjm, mujoco.MjData(scene.model.mjm)
    own = set(scene.model.subtree("robot"))
    joints = [j for j in range(mjm.njnt) if mjm.jnt_bodyid[j] in own]
    listed, seen = scene.names(scene.arm.itself["robot"]), set()
    rng = np.random.default_rng(0)
    for _ in range(400):
        data.qpos[mjm.jnt_qposadr[joints]] = rng.uniform(*mjm.jnt_range[joints].T)
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_collision(mjm, data)
        for contact in data.contact:
            pair = {int(b) for b in mjm.geom_bodyid[contact.geom]}
            if pair <= own:
                seen.add(frozenset(mjm.body(b).name for b in pair))
    assert len(seen) > 3
    assert seen <= listed


CARRIED = {"panda/link7", "panda/hand", "panda/left_finger", "panda/right_finger"}


def test_the_arm_meets_all_but_markers_and_its_hand_all_but_its_target(tmp_path: Path):
    """One list for each object to reach: only what the last joint carries may touch that object."""
    scene = Scene(tmp_path, "panda")
    first, second = map(scene.names, scene.arm.scene)
    links = {f"panda/link{i}" for i in range(1, 7)}
    for pairs, target, other in ((first, "first", "second"), (second, "second", "first")):
        met = {name: {n for pair in pairs if name in pair for n in pair - {name}} for name in ("world", "other", other)}
        assert all(found >= CARRIED | (links - {"panda/link1"}) for found in met.values())
        assert {n for pair in pairs if target in pair for n in pair - {target}} == links
        assert not any("goal" in pair for pair in pairs)


def test_the_hand_has_lists_of_its_own(tmp_path: Path):
    """They hold what the last joint carries: against all but the target, then against the target alone."""
    scene = Scene(tmp_path, "panda")
    first, second, hand, other_hand, on_first, on_second = map(
        scene.names, (*scene.arm.scene, *scene.arm.hand, *scene.arm.target)
    )
    assert hand == {pair for pair in first if pair & CARRIED}
    assert other_hand == {pair for pair in second if pair & CARRIED}
    assert on_first == {frozenset((name, "first")) for name in CARRIED}
    assert on_second == {frozenset((name, "second")) for name in CARRIED}


def test_a_scene_without_reach_has_no_lists(tmp_path: Path):
    """Lists that are not asked for are not prepared."""
    plan = build_plan(build_model(SceneConfig.load("mid")))
    assert arm_pairs(plan, PairRules(plan.scene, collect_colliders(plan.pieces, False, "cpu"))) == ArmPairs()


def _meetings(scene: SceneModel, plan: Plan | None = None) -> dict[tuple[str, str], float]:
    """Return the least gap by pair of bodies that are kept apart when the first of the pair is placed."""
    plan = plan or build_plan(scene)
    colliders = collect_colliders(plan.pieces, False, "cpu")
    found = {}
    for pairs in collider_pairs(plan, PairRules(scene, colliders)):
        for pair in pairs:
            names = tuple(scene.mjm.body(colliders[c].body).name for c in (pair.a, pair.b))
            assert names not in found
            found[names] = pair.margin
    return found


def test_an_object_keeps_the_larger_clearance_to_what_stands_before_it(folder: Path):
    """Each pair once, by the one that is placed later; a marker is in none; the floor is the world."""
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    objects = {
        "a": {**box, "clearance": 0.01},
        "b": {**box, "clearance": 0.03},
        "goal": {**box, "kind": "marker"},
        "wall": {"asset": box["asset"], "kind": "static", "clearance": 0.02},
    }
    assert _meetings(scene_of(objects)) == {
        ("a", "world"): 0.01,
        ("a", "wall"): 0.02,
        ("b", "world"): 0.03,
        ("b", "a"): 0.03,
        ("b", "wall"): 0.03,
    }


def test_an_arm_with_drawn_joints_keeps_off_itself_the_floor_and_what_is_static(folder: Path):
    """No clearance is asked of it; links that are neighbours are left alone, its base is fixed."""
    wall = {"asset": str(folder / "box.xml"), "kind": "static", "clearance": 0.02}
    robot = {"asset": "panda", "joints": {"*": {"noise": 0.1}}}
    pairs = _meetings(scene_of({"wall": wall}, robot=robot))
    assert set(pairs.values()) == {0.0}
    assert ("panda/link4", "world") in pairs
    assert ("panda/link4", "wall") in pairs
    links = [n for n in {a for a, _ in pairs} if n.startswith("panda/")]
    assert len(links) >= 8
    assert not any(a == "panda" and b in ("world", "wall") for a, b in pairs)
    own = [{a, b} for a, b in pairs if b.startswith("panda")]
    assert {"panda/link2", "panda/link5"} in own
    assert {"panda/link2", "panda/link3"} not in own


def test_what_stays_at_home_without_drawn_joints_is_there_from_the_start(folder: Path):
    """A robot at rest is an obstacle of the first object; so is a free object that the scene does not place."""
    objects = {"a": {"asset": str(folder / "box.xml"), "on": "floor"}, "b": {"asset": str(folder / "box.xml")}}
    pairs = _meetings(scene_of(objects, robot={"asset": "panda"}))
    assert {b for _, b in pairs} >= {"world", "b", "panda/link1", "panda/link7"}
    assert {a for a, _ in pairs} == {"a"}


@pytest.mark.parametrize("joints", [{}, {"*": {"noise": 0.1}}], ids=["at rest", "drawn"])
def test_what_is_placed_keeps_the_clearance_of_the_robot(folder: Path, joints: dict):
    """Or its own, where that is larger; the robot itself keeps none from what stays."""
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    objects = {"a": {**box, "clearance": 0.01}, "b": {**box, "clearance": 0.05}, "wall": {**box, "kind": "static"}}
    del objects["wall"]["on"]
    pairs = _meetings(scene_of(objects, robot={"asset": "panda", "clearance": 0.03, "joints": joints}))
    for name, expected in (("a", 0.03), ("b", 0.05)):
        assert {m for (a, b), m in pairs.items() if a == name and b.startswith("panda/")} == {expected}
        assert pairs[name, "wall"] == max(0.001, objects[name]["clearance"])
    assert {m for (a, b), m in pairs.items() if a.startswith("panda/") and b in ("wall", "world")} <= {0.0}


BESIDE = """<mujoco><worldbody><body name="thing">
  <body name="left"><joint name="left" axis="0 0 1" range="-90 90"/>
    <geom name="l0" type="box" size=".05 .05 .05" {margin}/><geom name="l1" size=".02" pos="0 0 .5" {margin}/>
    <geom name="l2" size=".02" pos="0 0 .7" {margin}/></body>
  <body name="right" pos="{at} 0 0"><joint name="right" axis="0 0 1" range="-90 90"/>
    <geom name="r0" type="box" size=".05 .05 .05"/><geom name="r1" size=".02" pos="0 0 .6"/></body>
  </body></worldbody></mujoco>"""


ALL_AXES = {tuple(sign * axis) for axis in np.eye(3) for sign in (-1.0, 1.0)}


def _beside(
    folder: Path, at: float, margin: str = "", geometry: str = "physics"
) -> tuple[SceneModel, list[Pair], list[Collider]]:
    """Two bodies of boxes at this distance [m], with small balls above them: the pairs among them."""
    (folder / "beside.xml").write_text(BESIDE.format(at=at, margin=margin))
    thing = {"asset": str(folder / "beside.xml"), "kind": "static", "joints": {"*": {"noise": 0.1}}}
    scene = scene_of({"thing": thing}, geometry=geometry)
    plan = build_plan(scene)
    colliders = collect_colliders(plan.pieces, geometry == "visual", "cpu")
    (pairs,) = collider_pairs(plan, PairRules(scene, colliders))
    own = set(scene.subtree("thing"))
    return scene, [p for p in pairs if {colliders[p.a].body, colliders[p.b].body} <= own], colliders


@pytest.mark.parametrize(
    ("at", "margin", "expected"),
    [(0.0998, "", -0.0002), (0.1, "", 0.0), (0.11, 'margin=".02"', 0.01)],
    ids=["overlap", "touch", "within the margin"],
)
def test_geoms_that_touch_at_home_are_a_pair_of_their_own(tmp_path: Path, at: float, margin: str, expected: float):
    """It may come nearer by 10 um, less the skin of the device; all others of the two bodies are one pair."""
    scene, pairs, colliders = _beside(tmp_path, at, margin)
    rest, touching = pairs
    name = {i: scene.mjm.geom(i).name for i in range(scene.mjm.ngeom)}
    assert touching.geoms is not None
    assert [name[g] for g in touching.geoms] == ["thing/l0", "thing/r0"]
    assert touching.margin == pytest.approx(expected - 1e-5, abs=1e-9)
    np.testing.assert_allclose([found[0] for found in touching.directions], [[1, 0, 0], [1, 0, 0]], atol=1e-9)
    assert [{tuple(np.round(way).tolist()) for way in found} for found in touching.directions] == [ALL_AXES, ALL_AXES]
    assert rest.margin == (0.02 if margin else 0.0)
    assert (rest.geoms, len(rest.directions[0]), len(rest.directions[1])) == (None, 0, 0)
    met = sorted(_geoms_met(scene, colliders, rest) + _geoms_met(scene, colliders, touching))
    assert met == sorted((f"thing/l{i}", f"thing/r{j}") for i in range(3) for j in range(2))


def _geoms_met(scene: SceneModel, colliders: list[Collider], pair: Pair) -> list[tuple[str, str]]:
    """Names of the geoms that a pair tests."""
    pieces = build_plan(scene).pieces
    child = np.concatenate([c.child for c in colliders])

    def below(node: int, names: dict[int, str]) -> list[str]:
        first = int(child[node])
        return [names[node]] if first < 0 else below(first, names) + below(first + 1, names)

    first, second = (
        {node: scene.mjm.geom(pieces[piece].geom).name for node, piece in Trees(colliders).leaves(collider).items()}
        for collider in (pair.a, pair.b)
    )
    return [(x, y) for a, b in pair.starts for x in below(a, first) for y in below(b, second)]


def test_what_is_apart_at_home_is_one_pair(tmp_path: Path):
    """And what is seen is left alone where it touches there."""
    assert [p.geoms for p in _beside(tmp_path, 0.11)[1]] == [None]
    assert len(_beside(tmp_path, 0.11, geometry="visual")[1]) == 1
    assert _beside(tmp_path, 0.0998, geometry="visual")[1] == []
