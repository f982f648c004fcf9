"""Configurations of the original package: what each key becomes, and what is left out or refused."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import pytest

from benchmarks.paper.sceniris.keys import KeysLeftOutWarning
from benchmarks.paper.sceniris.reader import read_sceniris
from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.orientation import DrawnOrientation
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.scene.build import build_model
from tests.benchmarks.paper.sceniris.configurations import QUARTER_TURN, UPSIDE_DOWN, mug, read


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
    assert str(warning).count("'reachable' is carried over if read_sceniris gets a 'robot'.") == 1
    assert str(pickle.loads(pickle.dumps(warning))) == str(warning)


@pytest.mark.parametrize(
    ("others", "error", "says"),
    [
        (
            {"robot": {"base": [0, 0, 0]}},
            SceneKeyError,
            r"read_sceniris: robot: .* exactly one of asset, in_model",
        ),
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


LEFT_OUT: dict[str, tuple] = {
    "a robot's reach": ({"reachable": True}, ["objects.mug.reachable"]),
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


WRONG: dict[str, tuple] = {
    "no objects": ({}, SceneKeyError, "objects: is missing"),
    "no id": ({"objects": [{"asset_path": "mug"}]}, SceneKeyError, r"objects\.0\.id: None should be the name"),
    "an id twice": (
        {"objects": [{"id": "a", "asset_path": "mug"}] * 2},
        SceneKeyError,
        r"objects\.1\.id: 'a' should be a different name",
    ),
    "no asset": ({"objects": [{"id": "a"}]}, SceneKeyError, r"objects\.a\.asset_path: is missing"),
    "a joint with two limits": (
        mug(
            asset_path="cabinet",
            joint_states=[{"joint_ids": ["lower", "upper"], "min": 0.9}, {"joint_ids": ["upper"], "max": 0.1}],
        ),
        SceneKeyError,
        r"original configuration: objects\.mug\.joint_states\.1\.joint_ids: 'upper' has different limits .* only once",
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
}


@pytest.mark.parametrize(("cfg", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_configuration_is_refused_by_its_key(cfg: dict, error: type[ScenirisError], says: str):
    """Values that the original would stop at, or misread, are errors that name the key and what would be right."""
    with pytest.raises(error, match=says):
        read_sceniris(cfg)


def test_assets_are_given_for_objects_that_are_there():
    """A name that is no object's is refused."""
    with pytest.raises(UnknownNameError, match=r"assets: unknown object 'drawr'\. Did you mean 'drawer'"):
        read_sceniris(mug(), assets={"drawr": "cabinet"})


def test_a_urdf_is_an_asset(tmp_path: Path):
    """Its joints are looked up, and nothing is told."""
    urdf = tmp_path / "crate.urdf"
    lid = '<link name="lid"/><joint name="hinge" type="revolute"><parent link="crate"/><child link="lid"/></joint>'
    urdf.write_text(f'<robot name="crate"><link name="crate"/>{lid}</robot>')
    config, left_out = read(mug(asset_path=str(urdf), joint_states=[{"joint_ids": ["hinge"]}]))
    assert (config.objects["mug"].asset, left_out) == (str(urdf), [])
    with pytest.raises(UnknownNameError, match=r"objects\.mug\.joint_states.*unknown joint 'hinges'.*'hinge'"):
        read(mug(asset_path=str(urdf), joint_states=[{"joint_ids": ["hinges"]}]))
