"""The placement program on the host: who is placed when, what is drawn for it, and what it keeps clear of."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.colliders import Colliders
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.pairs import collider_pairs
from sceniris_gym.program.plan import Plan, build_plan, placement_order
from sceniris_gym.scene.model import SceneModel, build_model

BOX = (
    '<mujoco><worldbody><body name="box"><geom type="box" size=".05 .02 .1" pos=".3 0 .4"/></body></worldbody></mujoco>'
)
GADGET = """
<mujoco><worldbody><body name="gadget"><geom type="box" size=".02 .02 .02"/>
  <body name="a" pos="0 0 .1"><joint name="slide" type="slide" range="-.1 .3"/>
    <geom type="box" size=".01 .01 .01"/></body>
  <body name="b" pos="0 0 .8"><joint name="hinge" axis="0 0 1" range="-30 90"/>
    <geom type="box" size=".01 .01 .01"/></body>
</body></worldbody><keyframe><key name="home" qpos=".25 .5"/></keyframe></mujoco>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the assets of these tests."""
    (tmp_path / "box.xml").write_text(BOX)
    (tmp_path / "gadget.xml").write_text(GADGET)
    return tmp_path


def _scene(objects: dict, **others) -> SceneModel:
    return build_model(SceneConfig.load({"floor": {"size": [3, 3]}, "objects": objects, **others}))


def test_parents_are_placed_before_their_children_and_else_the_file_decides():
    """Whatever the order in the file; what only has joints to draw goes first."""
    objects = {
        "banana": {"asset": "banana", "on": "cabinet/upper_drawer"},
        "apple": {"asset": "apple", "on": "table"},
        "table": {"asset": "table", "kind": "fixture", "on": "floor"},
        "can": {"asset": "can", "on": "floor"},
        "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "table"},
        "still": {"asset": "cabinet", "kind": "static"},
        "drawn": {"asset": "cabinet", "kind": "static", "joints": {"upper": {"value": 0.1}}},
    }
    robot = {"asset": "panda", "joints": {"joint1": {"noise": 0.1}}}
    order = placement_order(_scene(objects, robot=robot))
    assert order == ["robot", "drawn", "table", "apple", "can", "cabinet", "banana"]
    assert placement_order(_scene(objects)) == order[1:]


def test_what_has_neither_support_nor_region_starts_where_the_model_has_it(folder: Path):
    """Free, fixture or marker: it is no step of the program, and stands at the world's origin as an obstacle."""
    objects = {
        "box": {"asset": str(folder / "box.xml")},
        "shelf": {"asset": str(folder / "box.xml"), "kind": "fixture"},
        "goal": {"kind": "marker"},
        "apple": {"asset": "apple", "on": "floor"},
    }
    plan = build_plan(_scene(objects))
    assert [o.name for o in plan.objects] == ["apple"]
    np.testing.assert_allclose(plan.place[:3], [[0.3, 0, 0.3, 0], [0.3, 0, 0.3, 0], [0, 0, 0, 0]], atol=1e-9)
    assert len(plan.pieces) > 3


def test_a_stream_belongs_to_a_place_in_the_file(folder: Path):
    """The robot's is 0, objects count from 1, whenever they are placed."""
    objects = {
        "apple": {"asset": "apple", "on": "table"},
        "table": {"asset": "table", "kind": "fixture", "on": "floor"},
        "drawn": {"asset": "cabinet", "kind": "static", "joints": {"upper": {"value": 0.1}}},
    }
    scene = _scene(objects, robot={"asset": "panda", "joints": {"joint1": {"noise": 0.1}}})
    assert {o.name: o.stream for o in build_plan(scene).objects} == {"robot": 0, "apple": 1, "table": 2, "drawn": 3}
    kinds = {o.name: o.kind for o in build_plan(scene).objects}
    assert kinds["robot"] == kinds["drawn"] == ObjectKind.STATIC
    assert (kinds["apple"], kinds["table"]) == (ObjectKind.FREE, ObjectKind.FIXTURE)


@pytest.mark.parametrize(
    ("joints", "slide", "hinge"),
    [
        ({"*": {"fraction": [0, 1]}}, (-0.1, 0.3), (-np.pi / 6, np.pi / 2)),
        ({"slide": {"fraction": [0.25, 0.5]}, "hinge": {"range": [0.1, 0.2]}}, (0.0, 0.1), (0.1, 0.2)),
        ({"slide": {"value": 0.2}, "hinge": {"value": -0.5}}, (0.2, 0.2), (-0.5, -0.5)),
        ({"slide": {"noise": 0.1}, "hinge": {"noise": 0.1}}, (0.15, 0.3), (0.4, 0.6)),
    ],
)
def test_draws_are_intervals_in_metres_and_radians(folder: Path, joints: dict, slide: tuple, hinge: tuple):
    """All words for joints; noise is about the keyframe and is cut off at the limits."""
    gadget = {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor", "joints": joints}
    (placed,) = build_plan(_scene({"gadget": gadget})).objects
    np.testing.assert_allclose([(d.low, d.high) for d in placed.draws], [slide, hinge], atol=1e-12)
    assert [d.qposadr for d in placed.draws] == [0, 1]


def test_a_pivot_is_the_bottom_centre_of_the_bounds_at_home(folder: Path):
    """A box beside its frame, and the gadget with its tower at the height of its keyframe."""
    plan = build_plan(
        _scene(
            {
                "box": {"asset": str(folder / "box.xml"), "on": "floor"},
                "gadget": {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor"},
            }
        )
    )
    np.testing.assert_allclose(plan.objects[0].variants[0].pivot, [0.3, 0.0, 0.3], atol=1e-9)
    np.testing.assert_allclose(plan.objects[1].variants[0].pivot, [0.0, 0.0, -0.02], atol=1e-9)


def test_home_is_the_state_of_mujoco_at_the_start_pose(folder: Path):
    """Poses of all bodies in the keyframe that was composed."""
    scene = _scene({"gadget": {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor"}})
    data = mujoco.MjData(scene.mjm)
    mujoco.mj_resetDataKeyframe(scene.mjm, data, scene.mjm.key("home").id)
    mujoco.mj_kinematics(scene.mjm, data)
    np.testing.assert_allclose(build_plan(scene).home.xpos, data.xpos)
    assert np.isclose(data.body("gadget/a").xpos[2], 0.1 + 0.25)


def _meetings(scene: SceneModel, plan: Plan | None = None) -> dict[tuple[str, str], float]:
    """Which bodies are kept apart when the first of each pair is placed, and the least gap."""
    plan = plan or build_plan(scene)
    bodies = list(range(scene.mjm.nbody))
    name = {b: scene.mjm.body(b).name for b in bodies}
    found = {}
    for pairs in collider_pairs(scene, plan, Colliders(body=bodies, plane=[-1] * len(bodies))):
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
    assert _meetings(_scene(objects)) == {
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
    pairs = _meetings(_scene({"wall": wall}, robot=robot))
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
    pairs = _meetings(_scene(objects, robot={"asset": "panda"}))
    assert {b for _, b in pairs} >= {"world", "b", "panda/link1", "panda/link7"}
    assert {a for a, _ in pairs} == {"a"}
