"""The plan: who is placed when, where it may stand, and what is drawn for it."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.plan import build_plan, placement_order
from tests.program.scenes import scene_of


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
    order = placement_order(scene_of(objects, robot=robot))
    assert order == ["robot", "drawn", "table", "apple", "can", "cabinet", "banana"]
    assert placement_order(scene_of(objects)) == order[1:]


def test_what_has_neither_support_nor_region_starts_where_the_model_has_it(folder: Path):
    """Free, fixture or marker: it is no step of the program, and stands at the world's origin as an obstacle."""
    objects = {
        "box": {"asset": str(folder / "box.xml")},
        "shelf": {"asset": str(folder / "box.xml"), "kind": "fixture"},
        "goal": {"kind": "marker"},
        "apple": {"asset": "apple", "on": "floor"},
    }
    plan = build_plan(scene_of(objects))
    assert [o.name for o in plan.objects] == ["apple"]
    np.testing.assert_allclose(plan.pivot_pose[:3], [[0.3, 0, 0.3, 0], [0.3, 0, 0.3, 0], [0, 0, 0, 0]], atol=1e-9)
    assert len(plan.pieces) > 3


def test_a_stream_belongs_to_a_place_in_the_file(folder: Path):
    """The robot's is 0, objects count from 1, whenever they are placed."""
    objects = {
        "apple": {"asset": "apple", "on": "table"},
        "table": {"asset": "table", "kind": "fixture", "on": "floor"},
        "drawn": {"asset": "cabinet", "kind": "static", "joints": {"upper": {"value": 0.1}}},
    }
    scene = scene_of(objects, robot={"asset": "panda", "joints": {"joint1": {"noise": 0.1}}})
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
        ({"*": {"noise_norm": 0.1}}, (0.15, 0.3), (0.4, 0.6)),
    ],
)
def test_joint_ranges_are_intervals_in_metres_and_radians(folder: Path, joints: dict, slide: tuple, hinge: tuple):
    """All words for joints; noise is about the keyframe and is cut off at the limits."""
    gadget = {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor", "joints": joints}
    (placed,) = build_plan(scene_of({"gadget": gadget})).objects
    np.testing.assert_allclose([(d.low, d.high) for d in placed.joint_ranges], [slide, hinge], atol=1e-12)
    assert [d.qposadr for d in placed.joint_ranges] == [0, 1]


def test_joints_with_a_norm_form_one_vector(folder: Path):
    """Two norms of one object are refused by name."""
    joints = {"slide": {"noise_norm": 0.1}, "hinge": {"noise_norm": 0.2}}
    gadget = {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor", "joints": joints}
    with pytest.raises(SceneKeyError, match=r"objects.gadget.joints: all joints with 'noise_norm' .* same value"):
        build_plan(scene_of({"gadget": gadget}))


def test_a_pivot_is_the_bottom_centre_of_the_bounds_at_home(folder: Path):
    """A box beside its frame, and the gadget with its tower at the height of its keyframe."""
    plan = build_plan(
        scene_of(
            {
                "box": {"asset": str(folder / "box.xml"), "on": "floor"},
                "gadget": {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor"},
            }
        )
    )
    np.testing.assert_allclose(plan.objects[0].stable_poses[0].pivot, [0.3, 0.0, 0.3], atol=1e-9)
    np.testing.assert_allclose(plan.objects[1].stable_poses[0].pivot, [0.0, 0.0, -0.02], atol=1e-9)


def test_home_is_the_state_of_mujoco_at_the_start_pose(folder: Path):
    """Poses of all bodies in the keyframe that was composed."""
    scene = scene_of({"gadget": {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor"}})
    data = mujoco.MjData(scene.mjm)
    mujoco.mj_resetDataKeyframe(scene.mjm, data, scene.mjm.key("home").id)
    mujoco.mj_kinematics(scene.mjm, data)
    np.testing.assert_allclose(scene.home.xpos, data.xpos)
    assert np.isclose(data.body("gadget/a").xpos[2], 0.1 + 0.25)
