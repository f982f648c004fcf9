"""Scenes as MuJoCo models: names, kinds, start poses, the user's own models, and what is refused."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import (
    MeshError,
    NotSupportedError,
    SceneFileError,
    SceneKeyError,
    ScenirisError,
    UnknownNameError,
)
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.scene.model import SceneModel, build_model

TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

CHEST = """
<mujoco model="chest">
  <compiler angle="degree" meshdir="parts"/>
  <option timestep="0.001"/>
  <asset><mesh name="knob" file="knob.obj"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="ground" type="plane" size="1 1 .1"/>
    <body name="chest">
      <joint name="swing" type="hinge" axis="0 0 1"/>
      <geom name="box" type="box" size=".1 .1 .1" pos="0 0 .1"/>
      <geom name="knob" type="mesh" mesh="knob" pos="0 0 .3"/>
      <body name="tray" pos="0 0 .25">
        <joint name="slide" type="slide" axis="0 -1 0" range="0 .25"/>
        <geom name="tray" type="box" size=".05 .05 .01"/>
        <body name="lid" pos="0 0 .05">
          <joint name="hinge" type="hinge" axis="1 0 0" range="0 90"/>
          <geom name="lid" type="box" size=".05 .05 .005"/>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="chest" body2="tray"/></contact>
  <sensor><framepos name="where" objtype="body" objname="chest"/></sensor>
  <actuator><position name="pull" joint="slide" kp="10"/></actuator>
  <keyframe><key name="home" qpos="1 .2 .5" ctrl=".2"/></keyframe>
</mujoco>
"""
BALL = '<mujoco><worldbody><body name="b"><geom name="g" type="sphere" size=".03"/></body></worldbody></mujoco>'
ARM = """
<mujoco>
  <worldbody><body name="base"><geom name="foot" type="box" size=".05 .05 .05"/>
    <body name="link"><joint name="joint1" type="hinge" axis="0 0 1" range="-2 2"/>
      <geom name="link" type="box" size=".2 .02 .02"/></body></body></worldbody>
  <actuator><position name="motor" joint="joint1"/></actuator>
  <keyframe><key name="home" qpos=".5" ctrl=".4"/><key name="up" qpos="1.5" ctrl="1.4"/></keyframe>
</mujoco>
"""
OWN = """
<mujoco>
  <option timestep="0.003"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <light pos="0 0 2"/>
    <body name="desk" pos="1 0 0"><geom type="box" size=".3 .3 .02"/>
      <body name="drawer"><joint name="rail" type="slide" range="0 .2"/><geom type="box" size=".1 .1 .02"/></body>
    </body>
    <body name="stone" pos="0 0 .2"><freejoint name="loose"/><geom type="sphere" size=".03"/></body>
    <body name="door"><joint name="swing" type="hinge" axis="0 0 1"/><geom type="box" size=".3 .02 .3"/></body>
  </worldbody>
  <keyframe><key name="home" qpos=".1 0 0 .2 1 0 0 0 .7"/></keyframe>
</mujoco>
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the assets of these tests."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "knob.obj").write_text(TETRAHEDRON)
    for name, text in {"chest": CHEST, "ball": BALL, "arm": ARM, "own": OWN}.items():
        (tmp_path / f"{name}.xml").write_text(text)
    return tmp_path


def build(folder: Path, objects: dict[str, Any], **others: Any) -> SceneModel:
    """Build a scene of the assets in `folder`; an asset is named by its file's stem."""
    for part in (*objects.values(), *filter(None, [others.get("robot")])):
        if "asset" in part:
            part["asset"] = str(folder / f"{part['asset']}.xml")
    return build_model(SceneConfig.load({"floor": {"size": [1, 2]}, "objects": objects, **others}))


def names(mjm: mujoco.MjModel, kind: str) -> list[str]:
    """Return the names of all elements of a kind, such as 'body'."""
    count = {"body": mjm.nbody, "joint": mjm.njnt, "geom": mjm.ngeom, "actuator": mjm.nu, "mesh": mjm.nmesh}[kind]
    return [getattr(mjm, kind)(i).name for i in range(count)]


def test_a_root_body_has_the_object_s_name_and_all_else_its_prefix(folder: Path):
    """Bodies, joints, geoms, meshes and actuators of two objects of the same asset."""
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture"}, "b": {"asset": "chest", "kind": "static"}})
    assert names(scene.mjm, "body") == ["world", "a", "a/tray", "a/lid", "b", "b/tray", "b/lid"]
    assert names(scene.mjm, "joint") == ["a/slide", "a/hinge", "b/swing", "b/slide", "b/hinge"]
    assert names(scene.mjm, "geom")[:5] == ["floor", "a/box", "a/knob", "a/tray", "a/lid"]
    assert names(scene.mjm, "mesh") == ["a/knob", "b/knob"]
    assert names(scene.mjm, "actuator") == ["a/pull", "b/pull"]
    assert scene.bodies == {"a": 1, "b": 4}


def test_references_to_a_renamed_root_follow_it(folder: Path):
    """Excluded pairs and sensors of an asset still mean its root body."""
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture"}})
    assert scene.mjm.exclude_signature.tolist() == [(1 << 16) + 2]
    assert scene.mjm.sensor("a/where").objid == [scene.bodies["a"]]


def test_a_lamp_and_a_floor_of_an_asset_stay_behind(folder: Path):
    """Only the root body of an asset enters the scene; its options do not, and nothing warns."""
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture"}})
    assert scene.mjm.nlight == 1
    assert "a/ground" not in names(scene.mjm, "geom")
    assert scene.mjm.opt.timestep == 0.005


def test_each_kind_is_the_body_it_should_be(folder: Path):
    """Free: a freejoint; fixture: a mocap body; static: neither; marker: a mocap body that touches nothing."""
    scene = build(
        folder,
        {
            "ball": {"asset": "ball", "on": "floor"},
            "chest": {"asset": "chest", "kind": "fixture", "on": "floor"},
            "rock": {"asset": "ball", "kind": "static"},
            "ghost": {"asset": "ball", "kind": "marker"},
            "goal": {"kind": "marker", "region": {"box": [[0, 0, 0], [1, 1, 1]]}},
        },
    )
    mjm, mocap = scene.mjm, {name: scene.mjm.body(name).mocapid[0] for name in scene.bodies}
    assert mjm.joint("ball/free").type == mujoco.mjtJoint.mjJNT_FREE
    assert mjm.body("ball").jntnum == 1
    assert [mjm.body(name).jntnum[0] for name in ("chest", "rock", "ghost", "goal")] == [0, 0, 0, 0]
    assert [mocap[name] >= 0 for name in ("ball", "chest", "rock", "ghost", "goal")] == [False, True, False, True, True]
    assert mjm.geom("ghost/g").contype == mjm.geom("ghost/g").conaffinity == 0
    assert mjm.geom("rock/g").contype == 1
    assert mjm.body("goal").geomnum == 1
    assert mjm.geom("goal/mark").contype == mjm.geom("goal/mark").conaffinity == 0
    for geometry in ("physics", "visual"):
        assert not extract_pieces(mjm, geometry, {mjm.body("goal").id}), "a mark is nothing to place around"
    assert mjm.body("goal").mass == 0


def test_the_floor_is_as_large_as_the_workspace_and_belongs_to_the_world(folder: Path):
    """The plane's drawn half extents are half of the floor's."""
    floor = build(folder, {}).mjm.geom("floor")
    assert floor.type == mujoco.mjtGeom.mjGEOM_PLANE
    assert floor.bodyid == 0
    np.testing.assert_allclose(floor.size[:2], [0.5, 1.0])


def test_start_poses_come_from_the_keyframes_of_assets(folder: Path):
    """By joint name, whatever joints a kind has dropped; the scene's keyframe 'home' holds the same."""
    scene = build(
        folder,
        {"a": {"asset": "chest", "kind": "fixture"}, "b": {"asset": "ball"}, "c": {"asset": "chest", "kind": "static"}},
    )
    mjm = scene.mjm
    pose = {mjm.joint(i).name: scene.home_qpos[mjm.jnt_qposadr[i]] for i in range(mjm.njnt)}
    assert pose["a/slide"] == pytest.approx(0.2)
    assert pose["a/hinge"] == pytest.approx(0.5)
    assert pose["c/swing"] == pytest.approx(1.0)
    np.testing.assert_allclose(scene.home_ctrl, [0.2, 0.2])
    assert mjm.nkey == 1
    np.testing.assert_array_equal(mjm.key("home").qpos, scene.home_qpos)
    np.testing.assert_array_equal(mjm.key("home").ctrl, scene.home_ctrl)


def test_a_robot_stands_at_its_base_in_its_keyframe(folder: Path):
    """Prefix and root are named after the asset; base, yaw and keyframe are the scene's."""
    robot = {"asset": "arm", "base": [-0.5, 0.1, 0.2], "yaw": 90, "keyframe": "up", "joints": {"*": {"noise": 0.1}}}
    scene = build(folder, {"ball": {"asset": "ball", "on": "floor"}}, robot=robot)
    assert scene.mjm.body(scene.bodies["robot"]).name == "arm"
    assert scene.joints("robot") == {"joint1": 0}
    assert list(scene.joint_configs("robot")) == [0]
    assert scene.home_qpos[0] == pytest.approx(1.5)
    assert scene.home_ctrl == pytest.approx([1.4])
    data = mujoco.MjData(scene.mjm)
    mujoco.mj_kinematics(scene.mjm, data)
    np.testing.assert_allclose(data.body("arm").xpos, [-0.5, 0.1, 0.2])
    np.testing.assert_allclose(data.body("arm").xmat.reshape(3, 3)[:, 0], [0, 1, 0], atol=1e-12)


def test_supports_and_joints_are_found_by_their_names_inside_of_objects(folder: Path):
    """The floor is the world's body 0; a joint's own name goes before a pattern."""
    joints = {"*": {"value": 0.1}, "slide": {"fraction": [0, 1]}}
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture", "joints": joints}})
    assert [scene.support_body(parent, "here") for parent in ("floor", "a", "a/lid")] == [0, 1, 3]
    assert scene.parts("a") == {"tray": 2, "lid": 3}
    assert scene.subtree("a") == [1, 2, 3]
    assert [(config.fraction, config.value) for config in scene.joint_configs("a").values()] == [
        ((0, 1), None),
        (None, 0.1),
    ]


def test_an_own_model_keeps_its_names_options_and_start_pose(folder: Path):
    """Objects without an asset are its bodies; a fixture becomes a mocap body where it stands."""
    objects = {
        "desk": {"kind": "fixture", "on": "floor", "joints": {"rail": {"fraction": [0, 1]}}},
        "stone": {"on": "desk/drawer"},
        "door": {"kind": "static"},
        "ball": {"asset": "ball", "on": "floor"},
    }
    scene = build(folder, objects, model=str(folder / "own.xml"))
    mjm = scene.mjm
    assert mjm.opt.timestep == 0.003
    assert mjm.nlight == 1
    assert names(mjm, "geom").count("floor") == 1
    assert mjm.body("desk").mocapid == 0
    np.testing.assert_allclose(mjm.body("desk").pos, [1, 0, 0])
    assert scene.support_body("desk/drawer", "here") == mjm.body("drawer").id
    assert scene.joints("desk") == {"rail": mjm.joint("rail").id}
    assert scene.joints("stone") == {}
    np.testing.assert_allclose(scene.home_qpos[: mjm.nq - 7], [0.1, 0, 0, 0.2, 1, 0, 0, 0, 0.7])


def test_the_scene_opens_in_stock_mujoco_from_its_zip(folder: Path):
    """Meshes travel inside; names, poses and masses survive."""
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture"}, "b": {"asset": "chest", "kind": "static"}})
    scene.spec.to_zip(str(folder / "scene.zip"))
    assert "scene.xml" in zipfile.ZipFile(folder / "scene.zip").namelist()
    for gone in ("chest.xml", "parts/knob.obj"):
        (folder / gone).unlink()
    again = mujoco.MjSpec.from_zip(str(folder / "scene.zip")).compile()
    assert names(again, "body") == names(scene.mjm, "body")
    np.testing.assert_allclose(again.mesh_vert, scene.mjm.mesh_vert, atol=1e-7)
    np.testing.assert_allclose(again.body_mass, scene.mjm.body_mass)
    np.testing.assert_allclose(again.key("home").qpos, scene.home_qpos, atol=1e-6)


def test_the_hash_names_the_scene_in_every_process_and_place(folder: Path, tmp_path_factory: pytest.TempPathFactory):
    """Equal in another process and folder; another after a change of a knob, a name or a mesh."""
    objects = {"a": {"asset": "chest", "kind": "fixture", "on": "floor"}}
    here = build(folder, {"a": dict(objects["a"])}).hash
    there = tmp_path_factory.mktemp("there")
    (there / "parts").mkdir()
    for file in ("chest.xml", "parts/knob.obj"):
        (there / file).write_text((folder / file).read_text())
    (there / "scene.yaml").write_text(
        "floor: {size: [1, 2]}\nobjects: {a: {asset: ./chest.xml, kind: fixture, on: floor}}"
    )
    code = (
        "import sys; from sceniris_gym import SceneConfig, build_model; "
        "print(build_model(SceneConfig.load(sys.argv[1])).hash)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, there / "scene.yaml"], capture_output=True, text=True, check=True, cwd=there
    )
    assert run.stdout.strip() == here
    assert len(here) == 16
    assert build(folder, {"a": {**objects["a"], "gap": 0.001}}).hash != here
    assert build(folder, {"other": dict(objects["a"])}).hash != here
    (folder / "parts" / "knob.obj").write_text(TETRAHEDRON.replace(".1", ".2"))
    assert build(folder, {"a": dict(objects["a"])}).hash != here


def test_all_shipped_scenes_build():
    """`mid` and `mid_16k`: the names the scene file uses are those of the bodies."""
    for name in ("mid", "mid_16k"):
        scene = build_model(SceneConfig.load(name))
        assert {"cabinet", "cabinet/upper_drawer", "cabinet/lower_drawer", "apple", "banana"} <= {
            *names(scene.mjm, "body")
        }
        assert scene.mjm.body("cabinet").mocapid == 0
        assert sorted(scene.joints("cabinet")) == ["lower", "upper"]


WRONG = {
    "asset": ({"a": {"asset": "aple", "on": "floor"}}, UnknownNameError, ["objects.a.asset", "mean 'apple'"]),
    "file": ({"a": {"asset": "no/such.xml", "on": "floor"}}, SceneFileError, ["objects.a.asset", "no/such.xml"]),
    "body": (
        {"a": {"asset": "cabinet", "kind": "fixture"}, "b": {"asset": "apple", "on": "a/uper_drawer"}},
        UnknownNameError,
        ["objects.b.on", "unknown body 'a/uper_drawer'", "mean 'a/upper_drawer'"],
    ),
    "joint": (
        {"a": {"asset": "cabinet", "kind": "fixture", "joints": {"uper": {"value": 0}}}},
        UnknownNameError,
        ["objects.a.joints", "unknown joint 'uper'", "mean 'upper'"],
    ),
    "pattern": (
        {"a": {"asset": "cabinet", "kind": "fixture", "joints": {"door*": {"value": 0}}}},
        UnknownNameError,
        ["objects.a.joints", "'door*'", "Valid: lower, upper"],
    ),
    "limits": (
        {"a": {"asset": "cabinet", "kind": "fixture", "joints": {"upper": {"range": [0, 0.5]}}}},
        SceneKeyError,
        ["objects.a.joints.upper.range", "[0, 0.25]"],
    ),
}


@pytest.mark.parametrize(("objects", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_wrong_names_are_refused_with_file_path_and_the_nearest(
    tmp_path: Path, objects: dict, error: type[ScenirisError], says: list[str]
):
    """Names that only the model can judge: assets, bodies, joints, and joint values."""
    path = tmp_path / "scene.yaml"
    path.write_text(f"floor: {{size: [1, 1]}}\nobjects: {objects}")
    with pytest.raises(error) as caught:
        build_model(SceneConfig.load(path))
    for text in (str(path), *says):
        assert text in str(caught.value)


BAD_ASSETS = {
    "no XML": ("<mujoco>", SceneFileError, "MuJoCo cannot read"),
    "no body": ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", SceneKeyError, "one body.*found none"),
    "two bodies": (BALL.replace("</worldbody>", "<body name='c'/></worldbody>"), SceneKeyError, "one body.*'b', 'c'"),
    "a missing mesh": (
        BALL.replace("<worldbody>", "<asset><mesh name='m' file='m.obj'/></asset><worldbody>"),
        SceneFileError,
        "refers to .*m.obj",
    ),
    "no mass": (
        BALL.replace('size=".03"', 'size=".03" mass="0"'),
        SceneFileError,
        r"objects\.a\.asset: MuJoCo cannot compile",
    ),
    "a hinge at the root": (
        BALL.replace("<geom", "<joint name='h' type='hinge'/><geom"),
        SceneKeyError,
        r"objects\.a\.kind: a 'free' object .*'a/h'",
    ),
}


@pytest.mark.parametrize(("text", "error", "says"), BAD_ASSETS.values(), ids=BAD_ASSETS.keys())
def test_a_bad_asset_is_refused_by_its_object(folder: Path, text: str, error: type[ScenirisError], says: str):
    """Assets that MuJoCo cannot read or compile, or that are not one body."""
    (folder / "bad.xml").write_text(text)
    with pytest.raises(error, match=says):
        build(folder, {"a": {"asset": "bad", "on": "floor"}})


@pytest.mark.parametrize(
    ("objects", "error", "says"),
    [
        ({"dest": {"kind": "static"}}, UnknownNameError, r"objects\.dest: unknown body .*mean 'desk'"),
        ({"drawer": {"kind": "static"}}, SceneKeyError, "'drawer' should be a child of the world, not of 'desk'"),
        ({"stone": {"kind": "static"}}, SceneKeyError, "'stone' has a freejoint; its kind should be 'free'"),
        ({"desk": {}}, SceneKeyError, "'desk' should have a freejoint"),
        ({"door": {"kind": "fixture"}}, SceneKeyError, "'door' should have no joint of its own"),
        ({"desk": {"asset": "ball"}}, SceneKeyError, "has a body of this name"),
        (
            {"door": {"kind": "static", "joints": {"swing": {"fraction": [0, 1]}}}},
            SceneKeyError,
            "'swing' has no limits",
        ),
    ],
)
def test_a_body_of_an_own_model_must_suit_its_kind(folder: Path, objects: dict, error: type[ScenirisError], says: str):
    """What would silently change the user's model is refused."""
    with pytest.raises(error, match=says):
        build(folder, objects, model=str(folder / "own.xml"))


@pytest.mark.parametrize("knob", ["", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 3 4\n"], ids=["empty", "flat"])
def test_a_mesh_without_a_volume_is_refused(folder: Path, knob: str):
    """Meshes of which MuJoCo can make no convex hull."""
    (folder / "parts" / "knob.obj").write_text(knob)
    with pytest.raises(MeshError, match=r"objects\.b\.asset: .*vertices"):
        build(folder, {"a": {"asset": "ball", "on": "floor"}, "b": {"asset": "chest", "kind": "fixture"}})


def test_unknown_keyframes_and_taken_names_of_a_robot_are_refused(folder: Path):
    """A keyframe must exist; no object can have the name of the robot's asset."""
    with pytest.raises(UnknownNameError, match=r"unknown keyframe 'hom'\. Did you mean 'home'"):
        build(folder, {}, robot={"asset": "arm", "keyframe": "hom"})
    with pytest.raises(SceneKeyError, match=r"objects\.arm: the name of the robot's asset"):
        build(folder, {"arm": {"asset": "ball"}}, robot={"asset": "arm"})


def test_a_ball_joint_cannot_be_drawn_yet(folder: Path):
    """Joints are sliders and hinges."""
    (folder / "joystick.xml").write_text(
        BALL.replace("</body>", "<body name='s'><joint type='ball'/><geom size='.1'/></body></body>")
    )
    with pytest.raises(NotSupportedError, match="'a/joint0' is a ball joint"):
        build(folder, {"a": {"asset": "joystick", "kind": "fixture", "joints": {"*": {"value": 0}}}})
