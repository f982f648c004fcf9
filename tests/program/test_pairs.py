"""Which colliders are kept apart: by hand for what is placed, by the contacts of MuJoCo C for an arm in a grasp."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.box_tree import build_tree
from sceniris_gym.geometry.colliders import Colliders, collect_colliders
from sceniris_gym.program.pairs import arm_pairs, collider_pairs, first_nodes
from sceniris_gym.program.plan import Plan, build_plan
from sceniris_gym.scene.model import SceneModel, build_model
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
        self.colliders: Colliders = collect_colliders(self.plan.pieces, False, "cpu")

    def lists(self) -> list[set[frozenset[str]]]:
        """The lists as pairs of names of bodies."""
        lists, body = arm_pairs(self.model, self.plan, self.colliders), self.colliders.body
        mjm = self.model.mjm
        return [{frozenset((mjm.body(body[a]).name, mjm.body(body[b]).name)) for a, b, _ in pairs} for pairs in lists]


@pytest.mark.parametrize("robot", ["panda", "ur5e", "heron"])
def test_self_contacts_are_those_that_mujoco_reports(tmp_path: Path, robot: str):
    """In random joint states MuJoCo finds contacts of the robot with itself between listed bodies alone."""
    scene = Scene(tmp_path, robot)
    mjm, data = scene.model.mjm, mujoco.MjData(scene.model.mjm)
    own = set(scene.model.subtree("robot"))
    joints = [j for j in range(mjm.njnt) if mjm.jnt_bodyid[j] in own]
    listed, seen = scene.lists()[0], set()
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
    _, first, second, *_ = Scene(tmp_path, "panda").lists()
    links = {f"panda/link{i}" for i in range(1, 7)}
    for pairs, target, other in ((first, "first", "second"), (second, "second", "first")):
        met = {name: {n for pair in pairs if name in pair for n in pair - {name}} for name in ("world", "other", other)}
        assert all(found >= CARRIED | (links - {"panda/link1"}) for found in met.values())
        assert {n for pair in pairs if target in pair for n in pair - {target}} == links
        assert not any("goal" in pair for pair in pairs)


def test_the_hand_has_lists_of_its_own(tmp_path: Path):
    """They hold what the last joint carries: against all but the target, then against the target alone."""
    _, first, second, hand, other_hand, on_first, on_second = Scene(tmp_path, "panda").lists()
    assert hand == {pair for pair in first if pair & CARRIED}
    assert other_hand == {pair for pair in second if pair & CARRIED}
    assert on_first == {frozenset((name, "first")) for name in CARRIED}
    assert on_second == {frozenset((name, "second")) for name in CARRIED}


def test_a_scene_without_reach_has_no_lists(tmp_path: Path):
    """What is not asked for is not prepared."""
    scene = build_model(SceneConfig.load("mid"))
    plan = build_plan(scene)
    assert arm_pairs(scene, plan, collect_colliders(plan.pieces, False, "cpu")) == []


def _meetings(scene: SceneModel, plan: Plan | None = None) -> dict[tuple[str, str], float]:
    """Which bodies are kept apart when the first of each pair is placed, and the least gap."""
    plan = plan or build_plan(scene)
    bodies = list(range(scene.mjm.nbody))
    name = {b: scene.mjm.body(b).name for b in bodies}
    classes = [int(np.flatnonzero(scene.mjm.geom_contype)[0])] * len(bodies)  # all geoms collide alike
    found = {}
    for pairs in collider_pairs(scene, plan, Colliders(body=bodies, contact_class=classes, plane=[-1] * len(bodies))):
        for a, b, gap in pairs:
            assert (name[a], name[b]) not in found
            found[name[a], name[b]] = gap
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
    """No clearance is asked of it; links that are neighbours or touch at home are left alone, its base is fixed."""
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


def _leaves(child: np.ndarray, node: int) -> list[int]:
    """Leaves below a node of the trees of all colliders."""
    return [node] if child[node] < 0 else _leaves(child, child[node]) + _leaves(child, child[node] + 1)


def _random_colliders(sizes: list[int]) -> Colliders:
    """Colliders, one a body, over so many random boxes each."""
    colliders, draws = Colliders(), np.random.default_rng(3)
    for body, size in enumerate(sizes):
        middle, half = draws.normal(size=(size, 3)), draws.uniform(0.0, 0.3, (size, 3))
        tree = build_tree(middle - half, middle + half)
        colliders.body.append(body)
        colliders.root.append(colliders.nodes)
        colliders.half.append(tree.half)
        colliders.child.append(np.where(tree.child < 0, tree.child, tree.child + colliders.nodes))
        colliders.nodes += len(tree.child)
    return colliders


@pytest.mark.parametrize("lanes", [1, 4, 32, 33, 10_000])
@pytest.mark.parametrize("sizes", [[1, 1], [1, 40], [7, 13, 1, 30]], ids=str)
def test_lanes_begin_with_what_meets_every_pair_of_leaves_once(sizes: list[int], lanes: int):
    """Whatever is opened ahead of time: nothing is left out and nothing tested twice, and no lane is without work."""
    colliders = _random_colliders(sizes)
    pairs = [(a, b, 0.0) for a in range(len(sizes)) for b in range(a + 1, len(sizes))]
    entries = first_nodes(colliders, pairs, 5, lanes)
    child = np.concatenate(colliders.child)
    for i, (a, b, _) in enumerate(pairs):
        met = [
            (x, y)
            for pair, node, other in entries
            if pair == 5 + i
            for x in _leaves(child, node)
            for y in _leaves(child, other)
        ]
        wanted = [(x, y) for x in _leaves(child, colliders.root[a]) for y in _leaves(child, colliders.root[b])]
        assert sorted(met) == sorted(wanted)
    every = sum(sizes[a] * sizes[b] for a, b, _ in pairs)
    assert min(max(lanes, len(pairs)), every) <= len(entries) <= max(lanes, len(pairs))


def test_without_pairs_no_lane_has_anything_to_begin_with():
    """An object that meets nothing is an object."""
    assert first_nodes(_random_colliders([3]), [], 0, 32) == []
