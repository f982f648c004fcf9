"""Configurations of the original package: what each key becomes, and what is left out or refused."""

from __future__ import annotations

import copy
import math
import pickle
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym import read_sceniris
from sceniris_gym.config.objects import JointConfig, SupportConfig
from sceniris_gym.config.orientation import DrawnOrientation
from sceniris_gym.config.relations import Relation
from sceniris_gym.config.scene import RobotConfig, SceneConfig
from sceniris_gym.errors import CycleError, KeysLeftOutWarning, SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.model import build_model

QUARTER_TURN = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def read(cfg: dict, **others: Any) -> tuple[SceneConfig, list[str]]:
    """Return the scene and the keys that are left out."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        config = read_sceniris(cfg, **others)
    assert all(isinstance(warning.message, KeysLeftOutWarning) for warning in caught)
    return config, [key for warning in caught for key in getattr(warning.message, "keys", ())]


def mug(**keys: Any) -> dict:
    """Return a configuration of a drawer, a mug and an apple, the mug with the keys."""
    return {
        "objects": [
            {"id": "mug", "asset_path": "mug", **keys},
            {"id": "drawer", "asset_path": "cabinet"},
            {"id": "apple", "asset_path": "apple"},
        ]
    }


def relation(constraint: dict) -> Relation:
    """Return what a constraint of the mug becomes, with nothing left out."""
    config, left_out = read(mug(constraints=[constraint]))
    assert left_out == []
    (relation,) = config.objects["mug"].relations
    return relation


def test_a_scene_with_every_kind_of_key_is_carried_over_to_a_model():
    """Floor, supports, joints, relations and rotations of a scene such as the paper's; the dict is not changed."""
    cfg = {
        "env": {"num_envs": 16, "env_size": 2.0},
        "objects": [
            {
                "id": "orange",
                "asset_path": "orange",
                "constraints": [{"anchor_object_ids": ["drawer", "apple"], "direction": "middle"}],
            },
            {
                "id": "drawer",
                "asset_path": "/somewhere/unit_1.usd",
                "joint_states": [
                    {"joint_ids": ["lower"], "max": 0.3, "min": 0.1, "distribution": "uniform"},
                    {"joint_ids": ["upper"], "max": 1.0, "min": 0.7, "distribution": "uniform"},
                ],
                "rotation": {"type": "uniform_z", "lower": -15.0, "upper": 15.0},
            },
            {
                "id": "banana",
                "asset_path": "banana",
                "parent_id": "drawer/upper_drawer",
                "relation_to_parent": "top",
            },
            {
                "id": "apple",
                "asset_path": "apple",
                "reachable": False,
                "constraints": [
                    {"anchor_object_ids": ["drawer"], "direction": "front", "distance": 0.5, "distance_type": "greater"}
                ],
            },
        ],
    }
    before = copy.deepcopy(cfg)
    config, left_out = read(cfg, assets={"drawer": "cabinet"})
    assert cfg == before
    assert left_out == ["env.num_envs"]
    expected = {
        "floor": {"size": [2.0, 2.0]},
        "objects": {
            "orange": {"asset": "orange", "on": "floor", "relations": [{"between": ["drawer", "apple"]}]},
            "drawer": {
                "asset": "cabinet",
                "kind": "fixture",
                "on": "floor",
                "joints": {"lower": {"fraction": [0.1, 0.3]}, "upper": {"fraction": [0.7, 1.0]}},
                "orientation": {"yaw": [-15, 15]},
            },
            "banana": {"asset": "banana", "on": "drawer/upper_drawer"},
            "apple": {
                "asset": "apple",
                "on": "floor",
                "relations": [{"front_of": "drawer", "frame": "support", "angle": 90.0, "distance": {"min": 0.5}}],
            },
        },
    }
    assert config.objects == SceneConfig.load(expected).objects
    assert config.canonical() == SceneConfig.load(expected).canonical()
    assert set(build_model(config).bodies) == {"orange", "drawer", "banana", "apple"}


@pytest.mark.parametrize(
    ("keys", "support"),
    [
        ({}, SupportConfig("on", "floor")),
        ({"parent_id": None, "relation_to_parent": None}, SupportConfig("on", "floor")),
        ({"parent_id": "_plane", "relation_to_parent": "top"}, SupportConfig("on", "floor")),
        ({"parent_id": "drawer"}, SupportConfig("on", "drawer")),
        ({"parent_id": "drawer", "relation_to_parent": "inside"}, SupportConfig("inside", "drawer")),
        (
            {"parent_id": "drawer/lower_drawer", "relation_to_parent": "in"},
            SupportConfig("inside", "drawer/lower_drawer"),
        ),
    ],
)
def test_a_parent_becomes_the_support(keys: dict, support: SupportConfig):
    """The top is open above and the inside covered; the ground is the default."""
    config, left_out = read(mug(**keys))
    assert left_out == []
    assert config.objects["mug"].support == support
    assert config.objects["drawer"].kind == ("free" if support.parent == "floor" else "fixture")


def test_the_default_frame_is_the_support_s():
    """The original turns a direction with the support unless it is told otherwise, and so does what is read."""
    found = relation({"anchor_object_ids": ["drawer"], "direction": "front"})
    assert (found.kind, found.anchors, found.frame) == ("direction", ("drawer",), "support")
    assert (found.heading, found.half_angle) == pytest.approx((-math.pi / 2, math.pi / 2))
    assert (found.low, found.high, found.bounds) == (0.0, math.inf, False)


@pytest.mark.parametrize(
    ("transform", "frame", "heading"),
    [
        ("drawer", "anchor", 0.0),
        ("apple", "apple", 0.0),
        ("world", "world", 0.0),
        (None, "support", 0.0),
        (np.eye(4), "support", 0.0),
        (QUARTER_TURN, "support", math.pi / 2),
        (QUARTER_TURN[:3, :3].tolist(), "support", math.pi / 2),
        ("arm", "world", math.pi / 2),
    ],
)
def test_a_frame_turns_the_direction(transform: Any, frame: str, heading: float):
    """Objects, the world, robots' views and matrices; the right of a quarter turn to the left is the back."""
    for direction in ("right", "x", [1.0, 0.0], np.array([2.0, 0.0])):
        constraint = {"anchor_object_ids": ["drawer"], "direction": direction, "relation_axis_transform": transform}
        cfg = mug(constraints=[constraint]) | {"env": {"robot_centric_axis_transforms": {"arm": QUARTER_TURN}}}
        config, left_out = read(cfg)
        (found,) = config.objects["mug"].relations
        assert left_out == []
        assert found.frame == frame
        assert found.heading == pytest.approx(heading)


@pytest.mark.parametrize(
    ("direction", "heading"),
    [("left", math.pi), ("-x", math.pi), ("Back", math.pi / 2), ("y", math.pi / 2), ("-y", -math.pi / 2)],
)
def test_sides_and_axes_are_directions(direction: str, heading: float):
    """Left, right, front and back are -x, x, -y and y."""
    found = relation({"anchor_object_ids": ["drawer"], "direction": direction, "direction_tolerance_angle": 10})
    assert found.heading == pytest.approx(heading)
    assert found.half_angle == pytest.approx(math.radians(10))


@pytest.mark.parametrize("direction", ["right", None])
@pytest.mark.parametrize(
    ("distance", "low", "high"),
    [
        ({"distance_type": "greater"}, 0.4, math.inf),
        ({"distance_type": "less"}, 0.0, 0.4),
        ({"distance_type": "equal"}, 0.39, 0.41),
        ({}, 0.39, 0.41),
        ({"distance_type": "equal", "distance_relax": 0.1}, 0.3, 0.5),
    ],
)
def test_a_distance_is_a_limit_or_a_band(direction: str | None, distance: dict, low: float, high: float):
    """At least, at most, or about d away, in a direction or all around."""
    found = relation({"anchor_object_ids": ["drawer"], "direction": direction, "distance": 0.4, **distance})
    assert (found.low, found.high) == pytest.approx((low, high))
    assert found.half_angle == pytest.approx(math.pi if direction is None else math.pi / 2)
    assert found.anchors == ("drawer",)


def test_a_distance_from_bounds_is_measured_between_bounds():
    """`distance_start_bbox`, with and without a distance."""
    bounds = {"anchor_object_ids": ["drawer"], "direction": "left", "distance_start_bbox": True}
    assert relation(bounds | {"distance": 0.3, "distance_type": "less"}).bounds
    assert relation(bounds).low == pytest.approx(0.01)
    assert not relation(bounds | {"distance_start_bbox": False, "max_mesh_projection_z": 0.5}).bounds


@pytest.mark.parametrize("keys", [{"direction": "middle"}, {"distance_type": "middle"}, {}])
def test_several_anchors_are_between(keys: dict):
    """In all the ways in which the original says it."""
    found = relation({"anchor_object_ids": ["drawer", "apple"], "direction_tolerance_angle": 10, **keys})
    assert (found.kind, found.anchors) == ("between", ("drawer", "apple"))


@pytest.mark.parametrize(
    ("rotation", "turn"),
    [
        (None, DrawnOrientation("yaw")),
        ({"type": "uniform_z"}, DrawnOrientation("yaw")),
        ({"type": "uniform_z", "lower": -90, "upper": 0.0}, DrawnOrientation("yaw", (-math.pi / 2, 0.0))),
        ({"type": "constant"}, DrawnOrientation("yaw", (0.0, 0.0))),
        ({"type": "constant", "orientation": 90.0}, DrawnOrientation("yaw", (math.pi / 2, math.pi / 2))),
        ({"type": "constant", "orientation": QUARTER_TURN}, DrawnOrientation("yaw", (math.pi / 2, math.pi / 2))),
        ({"type": "stable"}, DrawnOrientation("stable")),
        ({"type": "stable", "z_rotation": False}, DrawnOrientation("stable", (0.0, 0.0))),
        ({"type": "face_to", "face_to_object_id": "drawer"}, DrawnOrientation("face_to", (0.0, 0.0), "drawer")),
    ],
)
def test_a_rotation_becomes_an_orientation(rotation: dict | None, turn: DrawnOrientation):
    """All types of rotation; angles are degrees."""
    config, left_out = read(mug(rotation=rotation))
    found = config.objects["mug"].drawn_orientation
    assert left_out == []
    assert (found.kind, found.target) == (turn.kind, turn.target)
    assert found.yaw == pytest.approx(turn.yaw)


def test_a_crop_is_a_fraction_of_the_support():
    """Corners in any order, cut off at the support's bounds; the ratio too is cut off."""
    config, _ = read(mug(position={"xy_limit": [[0.9, -0.5], [0.2, 0.5]]}, ratio_on_support=1.5))
    region = config.objects["mug"].region
    assert region is not None
    assert region.fraction == ((0.2, 0.0), (0.9, 0.5))
    assert config.objects["mug"].ratio_on_support == 1.0
    assert read(mug(ratio_on_support=None))[0].objects["mug"].ratio_on_support == 0.0


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"ratio_on_support": 3}, {"objects.mug.ratio_on_support": "3 is cut off to 1"}),
        ({"ratio_on_support": -2}, {"objects.mug.ratio_on_support": "-2 is cut off to 0"}),
        (
            {"position": {"xy_limit": [[0.9, 0.9], [-1, 2]]}},
            {"objects.mug.position.xy_limit": "[[0.0, 0.9], [0.9, 1.0]] here"},
        ),
        ({"position": {"xy_limit": [[0.2, 0.6], [0.1, 0.9]]}}, {"objects.mug.position.xy_limit": "[[0.1, 0.6], [0.2"}),
        ({"position": {"xy_limit": [[0, 0.2], [0.4, 1]]}, "ratio_on_support": 1}, {}),
    ],
    ids=str,
)
def test_values_that_are_cut_off_are_told_by_their_keys(keys: dict, said: dict[str, str]):
    """What they are now; a value that is kept is not told."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_sceniris(mug(**keys))
    changed = dict(item for warning in caught for item in getattr(warning.message, "changed", {}).items())
    assert changed.keys() == said.keys()
    assert all(text in changed[key] for key, text in said.items())


def test_the_limits_of_the_workspace_hold_for_all_that_is_on_the_floor():
    """The floor is centred at the origin: it reaches over the limits, and regions keep objects inside of them."""
    cfg = mug(position={"xy_limit": [[0.5, 0.0], [1.0, 1.0]]})
    cfg["objects"][2]["parent_id"] = "drawer"
    config, left_out = read(cfg | {"env": {"env_size": 9.0, "workspace_limits": [[0.0, -1.0], [2.0, 3.0]]}})
    assert left_out == []
    assert config.floor is not None
    assert config.floor.size == (4.0, 6.0)
    regions = {name: part.region and part.region.box for name, part in config.objects.items()}
    assert regions == {"mug": ((1.0, -1.0), (2.0, 3.0)), "drawer": ((0.0, -1.0), (2.0, 3.0)), "apple": None}


def test_a_fixed_position_overrules_the_rest():
    """In the air a point, on the floor a tiny square."""
    keys = {"parent_id": "drawer", "constraints": [{"anchor_object_ids": ["apple"], "direction": "left"}]}
    config, left_out = read(mug(fixed_world_positions=[np.array([1.0, 0.5, 1.8])], **keys))
    mounted = config.objects["mug"]
    assert left_out == []
    assert (mounted.kind, mounted.support, mounted.relations) == ("fixture", None, ())
    assert mounted.region is not None
    assert mounted.region.box == ((1.0, 0.5, 1.8), (1.0, 0.5, 1.8))
    standing = read(mug(fixed_world_positions=[(0.2, 0.1, 0.0)]))[0].objects["mug"]
    assert standing.support == SupportConfig("on", "floor")
    assert standing.region is not None
    assert np.allclose(standing.region.box or 0.0, [[0.2, 0.1], [0.2, 0.1]], atol=2e-4)


@pytest.mark.parametrize("limits", [None, [[-0.5, -0.5], [0.5, 0.5]]], ids=str)
def test_a_fixed_position_may_be_beyond_the_workspace(limits: list | None):
    """The floor is made to hold it; what is drawn on it keeps to the workspace, and layouts can be made."""
    env = {"env_size": 1.0, "workspace_limits": limits}
    cfg = mug(fixed_world_positions=[[0.8, -0.3, 0.0]])
    cfg["env"] = env
    cfg["objects"][2]["position"] = {"xy_limit": [[0.5, 0.0], [1.0, 1.0]]}
    config, left_out = read(cfg)
    assert left_out == []
    assert config.floor is not None
    assert config.floor.size == pytest.approx((1.6002, 1.0))
    regions = {name: part.region and part.region.box for name, part in config.objects.items()}
    assert np.allclose(regions["mug"] or 0.0, [[0.7999, -0.3001], [0.8001, -0.2999]], atol=1e-9)
    assert regions["drawer"] == ((-0.5, -0.5), (0.5, 0.5))
    assert regions["apple"] == ((0.0, -0.5), (0.5, 0.5))
    build_plan(build_model(config))  # which refuses regions that leave nothing of the floor


@pytest.mark.parametrize("far", [[200.0, 0.0, 0.0], [0.0, -150.0, 0.0], [0.0, 0.0, 120.0]], ids=str)
def test_a_fixed_position_that_is_too_far_is_refused_by_its_key(far: list[float]):
    """Positions are kept within 100 m of the origin, on the floor as in the air."""
    with pytest.raises(SceneKeyError, match=r"original configuration: objects\.mug\.fixed_world_positions: .*100 m"):
        read(mug(fixed_world_positions=[far]))


@pytest.mark.parametrize(
    ("robot", "others", "tier"),
    [
        ("panda", {}, "map"),
        ("panda", {"tier": "clear"}, "clear"),
        ({"asset": "panda", "base": [-0.5, 0.0, 0.0], "yaw": 90}, {}, "map"),
    ],
    ids=str,
)
def test_what_is_reachable_stays_so_for_a_robot_that_is_given(robot: Any, others: dict, tier: str):
    """It stands where it is said to, and only what was reachable is."""
    cfg = mug(reachable=True)
    cfg["objects"][2]["reachable"] = False
    config, left_out = read(cfg, robot=robot, **others)
    assert left_out == []
    assert config.robot == RobotConfig(**(robot if isinstance(robot, dict) else {"asset": robot}))
    assert {name: part.reachable for name, part in config.objects.items()} == {
        "mug": tier,
        "drawer": False,
        "apple": False,
    }
    assert build_model(config).bodies["robot"] > 0


def test_what_is_reachable_without_a_robot_is_told_with_what_would_help():
    """Once, however many objects have the key."""
    cfg = mug(reachable=True)
    cfg["objects"][2]["reachable"] = True
    with pytest.warns(KeysLeftOutWarning) as caught:
        read_sceniris(cfg)
    (warning,) = (w.message for w in caught)
    assert isinstance(warning, KeysLeftOutWarning)
    assert warning.keys == ("objects.mug.reachable", "objects.apple.reachable")
    assert str(warning).count("'reachable' is carried over if read_sceniris is given the 'robot'.") == 1
    assert str(pickle.loads(pickle.dumps(warning))) == str(warning)


@pytest.mark.parametrize(
    ("others", "error", "says"),
    [
        ({"robot": {"base": [0, 0, 0]}}, SceneKeyError, r"read_sceniris: robot: asset: is missing"),
        ({"robot": {"asset": "panda", "bsae": [0, 0, 0]}}, SceneKeyError, r"read_sceniris: robot: bsae: .*mean 'base'"),
        ({"robot": 3}, SceneKeyError, r"read_sceniris: robot: .*mapping"),
        ({"robot": "panda", "tier": "maps"}, UnknownNameError, r"read_sceniris: tier: .*mean 'map'"),
    ],
    ids=str,
)
def test_a_wrong_robot_is_refused(others: dict, error: type[ScenirisError], says: str):
    """By the argument, not by a key of the configuration."""
    with pytest.raises(error, match=says):
        read(mug(), **others)


def test_objects_may_be_a_mapping_by_id():
    """As the original makes one of the list."""
    cfg = {"objects": {part["id"]: part for part in mug(parent_id="drawer")["objects"]}}
    assert read(cfg)[0].canonical() == read(mug(parent_id="drawer"))[0].canonical()


def test_joints_default_to_their_whole_range():
    """`min` and `max` are 0 and 1."""
    both = ["lower", "upper"]
    config, _ = read(mug(asset_path="cabinet", joint_states=[{"joint_ids": both}, {"joint_ids": [], "max": 0.3}]))
    assert config.objects["mug"].joints == dict.fromkeys(both, JointConfig(fraction=(0.0, 1.0)))


LEFT_OUT = {
    "a robot's reach": ({"reachable": True}, ["objects.mug.reachable"]),
    "a key of no meaning": ({"colour": "red", "tag": None}, ["objects.mug.colour"]),
    "a limit of height": ({"position": {"z_limit": [0, 1]}}, ["objects.mug.position.z_limit"]),
    "several fixed positions": (
        {"fixed_world_positions": [[0, 0, 0], [1, 0, 0]]},
        ["objects.mug.fixed_world_positions"],
    ),
    "another distribution": (
        {"asset_path": "cabinet", "joint_states": [{"joint_ids": ["upper"], "distribution": "normal"}]},
        ["objects.mug.joint_states.0.distribution"],
    ),
    "an unknown rotation": (
        {"rotation": {"type": "spin", "speed": 3}},
        ["objects.mug.rotation.type", "objects.mug.rotation.speed"],
    ),
    "a rotation that is not about z": (
        {"rotation": {"type": "constant", "orientation": UPSIDE_DOWN}},
        ["objects.mug.rotation.orientation"],
    ),
    "another support for a constraint": (
        {"constraints": [{"anchor_object_ids": ["apple"], "direction": "left", "base_support_id": "x"}]},
        ["objects.mug.constraints.0.base_support_id"],
    ),
    "the height of what is measured": (
        {
            "constraints": [
                {
                    "anchor_object_ids": ["apple"],
                    "direction": "left",
                    "distance_start_bbox": True,
                    "max_mesh_projection_z": 0.1,
                }
            ]
        },
        ["objects.mug.constraints.0.max_mesh_projection_z"],
    ),
    "bounds of what is around": (
        {"constraints": [{"anchor_object_ids": ["apple", "drawer"], "distance_start_bbox": True}]},
        ["objects.mug.constraints.0.distance_start_bbox"],
    ),
    "a direction from several": (
        {"constraints": [{"anchor_object_ids": ["apple", "drawer"], "direction": "left"}]},
        ["objects.mug.constraints.0"],
    ),
    "no anchors": ({"constraints": [{"anchor_object_ids": None, "direction": "left"}]}, ["objects.mug.constraints.0"]),
    "next to": (
        {"constraints": [{"anchor_object_ids": ["apple"], "direction": "next_to"}]},
        ["objects.mug.constraints.0"],
    ),
    "a distance of next to": (
        {"constraints": [{"anchor_object_ids": ["apple"], "direction": "left", "distance": "next_to"}]},
        ["objects.mug.constraints.0.distance"],
    ),
    "neither direction nor distance": (
        {"constraints": [{"anchor_object_ids": ["apple"]}]},
        ["objects.mug.constraints.0"],
    ),
    "a file that is no MJCF": ({"asset_path": Path("/a/mug.usd")}, ["objects.mug.asset_path"]),
}


@pytest.mark.parametrize(("keys", "left_out"), LEFT_OUT.values(), ids=LEFT_OUT.keys())
def test_what_cannot_be_carried_over_is_listed_by_key(keys: dict, left_out: list[str]):
    """Each such key is named once, and the rest of the scene is there."""
    config, found = read(mug(**keys))
    assert found == left_out
    assert list(config.objects) == ["mug", "drawer", "apple"]


def test_a_file_of_another_kind_is_not_looked_into(tmp_path: Path):
    """It is listed and kept, and so are the names of joints and parts that it may have."""
    usd = tmp_path / "mug.usd"
    usd.write_bytes(b"PXR-USDC")
    config, left_out = read(mug(asset_path=str(usd), joint_states=[{"joint_ids": ["hinge"]}]))
    assert left_out == ["objects.mug.asset_path"]
    assert list(config.objects["mug"].joints) == ["hinge"]


def test_the_warning_can_be_made_an_error():
    """It names all keys of the configuration that are left out, on all levels."""
    cfg = mug(reachable=True) | {"env": {"num_envs": 4, "collision_checker_backend": "curobo"}, "other": 1}
    with pytest.warns(KeysLeftOutWarning, match=r"env\.num_envs, env\.collision_checker_backend, .*reachable, other"):
        read_sceniris(cfg)


CHANGED = {
    "the middle of two": ({"direction": "middle"}, 2, {"direction": "a strip .*, the rectangle"}),
    "the middle of two as a distance": ({"distance_type": "middle"}, 2, {"distance_type": "a strip"}),
    "two anchors alone": ({}, 2, {"anchor_object_ids": "a strip"}),
    "a distance from bounds": (
        {"direction": "left", "distance": 0.3, "distance_start_bbox": True},
        1,
        {"distance_start_bbox": "between the bounds of both here"},
    ),
    "a frame that is no anchor": (
        {"direction": "left", "relation_axis_transform": "apple"},
        1,
        {"relation_axis_transform": "with 'apple' here, with the support there"},
    ),
    "a frame that is the anchor": ({"direction": "left", "relation_axis_transform": "drawer"}, 1, {}),
    "the middle of three": ({"direction": "middle"}, 3, {}),
}


@pytest.mark.parametrize(("keys", "anchors", "changed"), CHANGED.values(), ids=CHANGED.keys())
def test_what_means_another_thing_is_told_by_its_key(keys: dict, anchors: int, changed: dict[str, str]):
    """The warning says what it means here and what it meant there; nothing is said of the rest."""
    cfg = mug(constraints=[{"anchor_object_ids": ["drawer", "apple", "pear"][:anchors], **keys}])
    cfg["objects"].append({"id": "pear", "asset_path": "pear"})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_sceniris(cfg)
    found = {path: meaning for w in caught for path, meaning in getattr(w.message, "changed", {}).items()}
    assert list(found) == [f"objects.mug.constraints.0.{key}" for key in changed]
    for (path, meaning), says in zip(found.items(), changed.values(), strict=True):
        assert re.search(says, meaning)
        assert f"{path} ({meaning})" in str(caught[0].message)
        assert pickle.loads(pickle.dumps(caught[0].message)).changed == found


ONE = {"anchor_object_ids": ["drawer"]}
WRONG = {
    "no objects": ({}, SceneKeyError, "objects: is missing"),
    "objects of another kind": ({"objects": 3}, SceneKeyError, "objects: 3 should be a list"),
    "an object of another kind": ({"objects": ["mug"]}, SceneKeyError, r"objects\.0: 'mug' should be a mapping"),
    "no id": ({"objects": [{"asset_path": "mug"}]}, SceneKeyError, r"objects\.0\.id: None should be the name"),
    "an id twice": (
        {"objects": [{"id": "a", "asset_path": "mug"}] * 2},
        SceneKeyError,
        r"objects\.1\.id: 'a' should be another name",
    ),
    "no asset": ({"objects": [{"id": "a"}]}, SceneKeyError, r"objects\.a\.asset_path: is missing"),
    "env of another kind": (mug() | {"env": 3}, SceneKeyError, "env: 3 should be a mapping"),
    "a text for a size": (mug() | {"env": {"env_size": "1"}}, SceneKeyError, r"env\.env_size: '1' should be a number"),
    "flat limits": (
        mug() | {"env": {"workspace_limits": [0, 0, 1, 1]}},
        SceneKeyError,
        r"env\.workspace_limits: .* should be \[\[min x, min y\]",
    ),
    "an unknown parent": (mug(parent_id="drawr/x"), UnknownNameError, r"mug\.parent_id: .*mean 'drawer'"),
    "an unknown relation": (
        mug(parent_id="drawer", relation_to_parent="insid"),
        UnknownNameError,
        r"mug\.relation_to_parent: .*mean 'inside'",
    ),
    "an unknown anchor": (
        mug(constraints=[{"anchor_object_ids": ["aple"]}]),
        UnknownNameError,
        r"mug\.constraints\.0\.anchor_object_ids: unknown object 'aple'.*mean 'apple'",
    ),
    "an anchor of another kind": (
        mug(constraints=[{"anchor_object_ids": [["apple"]]}]),
        UnknownNameError,
        "unknown object",
    ),
    "anchors as a text": (
        mug(constraints=[{"anchor_object_ids": "apple"}]),
        SceneKeyError,
        "'apple' should be a list",
    ),
    "the middle of one": (
        mug(constraints=[{**ONE, "direction": "middle"}]),
        SceneKeyError,
        "two objects or more for 'middle'",
    ),
    "an unknown direction": (
        mug(constraints=[{**ONE, "direction": "lefft"}]),
        UnknownNameError,
        r"direction: unknown direction 'lefft'\. Did you mean 'left'",
    ),
    "a direction in space": (
        mug(constraints=[{**ONE, "direction": [0, 0, 1]}]),
        SceneKeyError,
        r"constraints\.0\.direction: \[0, 0, 1\] should be \[x, y\]",
    ),
    "an unknown frame": (
        mug(constraints=[{**ONE, "direction": "left", "relation_axis_transform": "wrld"}]),
        UnknownNameError,
        "unknown frame 'wrld'.*mean 'world'",
    ),
    "a frame that is no matrix": (
        mug(constraints=[{**ONE, "direction": "left", "relation_axis_transform": [1, 2]}]),
        SceneKeyError,
        "should be a matrix",
    ),
    "an unknown type of distance": (
        mug(constraints=[{**ONE, "distance": 1.0, "distance_type": "lesss"}]),
        UnknownNameError,
        "unknown distance type 'lesss'.*mean 'less'",
    ),
    "a negative distance": (
        mug(constraints=[{**ONE, "distance": -1.0, "distance_type": "less"}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.0\.distance: -1.0 should be at least 0",
    ),
    "a relaxation that is none": (
        mug(constraints=[{"anchor_object_ids": []}, {**ONE, "distance": 1.0, "distance_relax": 0.0}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.1\.distance_relax: 0.0 should be at least 0.0001 m",
    ),
    "an angle that is too wide": (
        mug(constraints=[{**ONE, "direction": "left", "direction_tolerance_angle": 200}]),
        SceneKeyError,
        r"objects\.mug\.constraints\.0\.direction_tolerance_angle: 200.0 should be at most 180",
    ),
    "an anchor that is the object itself": (
        mug(constraints=[{"anchor_object_ids": ["mug"], "direction": "left"}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.0\.anchor_object_ids: 'mug' should be another",
    ),
    "too many constraints": (
        mug(constraints=[{**ONE, "direction": "left"}] * 5),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints: .* 4 values at most",
    ),
    "joints the wrong way round": (
        mug(asset_path="cabinet", joint_states=[{"joint_ids": ["upper"], "min": 0.9, "max": 0.1}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.joint_states\.0: .* low <= high",
    ),
    "a joint with two limits": (
        mug(
            asset_path="cabinet",
            joint_states=[{"joint_ids": ["lower", "upper"], "min": 0.9}, {"joint_ids": ["upper"], "max": 0.1}],
        ),
        SceneKeyError,
        r"original configuration: objects\.mug\.joint_states\.1\.joint_ids: 'upper' has other limits .* Name it once",
    ),
    "a floor without end": (mug() | {"env": {"env_size": 1e6}}, SceneKeyError, r"configuration: env\.env_size: 1"),
    "objects on each other": (
        {"objects": [{"id": a, "asset_path": "mug", "parent_id": b} for a, b in ("ab", "ba")]},
        CycleError,
        "original configuration: objects are placed relative to each other: a -> b -> a",
    ),
    "an unknown joint": (
        mug(asset_path="cabinet", joint_states=[{"joint_ids": ["uper"]}]),
        UnknownNameError,
        r"mug\.joint_states\.0\.joint_ids: unknown joint 'uper'\. Did you mean 'upper'",
    ),
    "an unknown part": (
        mug(parent_id="drawer/uper_drawer"),
        UnknownNameError,
        r"mug\.parent_id: unknown body 'drawer/uper_drawer'\. Did you mean 'drawer/upper_drawer'",
    ),
    "an unknown asset": (mug(asset_path="mugg"), UnknownNameError, r"objects\.mug\.asset_path: .*mean 'mug'"),
    "an unknown target": (
        mug(rotation={"type": "face_to", "face_to_object_id": "appel"}),
        UnknownNameError,
        r"mug\.rotation\.face_to_object_id: unknown object 'appel'.*mean 'apple'",
    ),
    "a ragged crop": (mug(position={"xy_limit": [[0, 1], [0]]}), SceneKeyError, r"position\.xy_limit: .* should be"),
    "robots of another kind": (
        mug() | {"env": {"robot_centric_axis_transforms": 3}},
        SceneKeyError,
        "robot_centric_axis_transforms: 3 should be a mapping",
    ),
}


@pytest.mark.parametrize(("cfg", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_configuration_is_refused_by_its_key(cfg: dict, error: type[ScenirisError], says: str):
    """What the original would stop at, or misread, is an error that names the key and what would be right."""
    with pytest.raises(error, match=says):
        read_sceniris(cfg)


@pytest.mark.parametrize(
    "keys",
    [
        {"parent_id": "mugg"},
        {"rotation": {"type": "face_to", "face_to_object_id": "mugg"}},
        {"constraints": [{"anchor_object_ids": ["mugg"], "direction": "left"}]},
        {"constraints": [{"anchor_object_ids": ["drawer"], "direction": "left", "relation_axis_transform": "mugg"}]},
    ],
    ids=str,
)
def test_an_object_is_not_advised_to_refer_to_itself(keys: dict):
    """All other names are valid."""
    with pytest.raises(UnknownNameError) as caught:
        read_sceniris(mug(**keys))
    assert {"drawer", "apple"} <= set(caught.value.valid)
    assert "mug" not in caught.value.valid


def test_assets_are_given_for_objects_that_are_there():
    """A name that is no object's is refused."""
    with pytest.raises(UnknownNameError, match=r"assets: unknown object 'drawr'\. Did you mean 'drawer'"):
        read_sceniris(mug(), assets={"drawr": "cabinet"})
