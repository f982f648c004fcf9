"""Models of scenes: start poses, the user's own models, cameras, and what cannot be built."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneKeyError, UnknownNameError
from sceniris_gym.scene.build import build_model
from tests.scene.assets import build, names

SCENE: dict[str, Any] = {
    "floor": {"size": [2, 2]},
    "robot": {"asset": "heron", "base": [0.5, 0, 0], "yaw": 90},
    "objects": {"block": {"asset": "block", "on": "floor"}},
}


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
    assert scene.support("desk/drawer", "here").body == mjm.body("drawer").id
    assert scene.joints("desk") == {"rail": mjm.joint("rail").id}
    assert scene.joints("stone") == {}
    np.testing.assert_allclose(scene.home_qpos[: mjm.nq - 7], [0.1, 0, 0, 0.2, 1, 0, 0, 0, 0.7])


def test_the_scene_opens_in_stock_mujoco_from_its_zip(folder: Path):
    """Meshes travel inside; names, poses and masses survive."""
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture"}, "b": {"asset": "chest", "kind": "static"}})
    assert scene.spec is not None
    scene.spec.to_zip(str(folder / "scene.zip"))
    assert "scene.xml" in zipfile.ZipFile(folder / "scene.zip").namelist()
    for gone in ("chest.xml", "parts/knob.obj"):
        (folder / gone).unlink()
    again = mujoco.MjSpec.from_zip(str(folder / "scene.zip")).compile()
    assert names(again, "body") == names(scene.mjm, "body")
    np.testing.assert_allclose(again.mesh_vert, scene.mjm.mesh_vert, atol=1e-7)
    np.testing.assert_allclose(again.body_mass, scene.mjm.body_mass)
    np.testing.assert_allclose(again.key("home").qpos, scene.home_qpos, atol=1e-6)


def test_all_shipped_scenes_build():
    """`mid` and `mid_16k`: the names the scene file uses are those of the bodies."""
    for name in ("mid", "mid_16k"):
        scene = build_model(SceneConfig.load(name))
        assert {"cabinet", "cabinet/upper_drawer", "cabinet/lower_drawer", "apple", "banana"} <= {
            *names(scene.mjm, "body")
        }
        assert scene.mjm.body("cabinet").mocapid == 0
        assert sorted(scene.joints("cabinet")) == ["lower", "upper"]


def test_a_scene_is_given_in_any_form(tmp_path: Path):
    """A name, a path, a mapping, a SceneConfig or a SceneModel; the first four with overrides."""
    path = tmp_path / "small.yaml"
    path.write_text("base: mid")
    config = SceneConfig.load("mid")
    model = build_model(config)
    assert build_model(model) is model
    for scene in ("mid", path, {"base": "mid"}, config):
        assert build_model(scene).hash == model.hash
        assert build_model(scene, {"objects.apple.clearance": 0.01}).hash != model.hash
    with pytest.raises(ArgumentError, match="overrides should be None for a SceneModel"):
        build_model(model, {"objects.apple.clearance": 0.01})
    with pytest.raises(ArgumentTypeError):
        build_model(None)  # pyrefly: ignore[bad-argument-type]


def model_with(cameras: dict[str, Any], **more: Any) -> Any:
    """Return the scene with these cameras."""
    return build_model(SceneConfig.load({**SCENE, "cameras": cameras, **more}))


def test_a_camera_looks_at_its_point_from_its_place():
    """In the frame of the world or of its body: the point lies on the optical axis, and up is up."""
    cameras = {
        "front": {"pos": [1.0, -1.0, 0.8], "look_at": [0, 0, 0.1], "fovy": 30},
        "base": {"body": "robot", "pos": [0.4, 0.1, 0.9], "look_at": [0.2, 0.3, 0.0]},
        "rider": {"body": "block", "pos": [0, 0, 0.3], "look_at": [0, 0, 0], "up": [0, 1, 0]},
    }
    scene = model_with(cameras)
    data = mujoco.MjData(scene.mjm)
    data.qpos[:] = scene.home_qpos
    mujoco.mj_forward(scene.mjm, data)
    for name, words in cameras.items():
        carrier = {"front": 0, "base": scene.bodies["robot"], "rider": scene.bodies["block"]}[name]
        frame, origin = data.xmat[carrier].reshape(3, 3), data.xpos[carrier]
        eye, point = (origin + frame @ np.array(words[w]) for w in ("pos", "look_at"))
        camera = data.camera(name)
        np.testing.assert_allclose(camera.xpos, eye, atol=1e-6)
        axes = camera.xmat.reshape(3, 3)
        np.testing.assert_allclose(axes[:, 2], (eye - point) / np.linalg.norm(eye - point), atol=1e-6)
        assert axes[:, 1] @ frame @ np.array(words.get("up", [0, 0, 1])) > 0.1
    assert scene.mjm.camera("front").fovy == 30
    assert scene.mjm.camera("rider").bodyid == scene.bodies["block"]


def test_cameras_change_no_hash():
    """And one that is called 'overview' takes the place of the automatic one."""
    view = {"pos": [1.0, 0, 1.0], "look_at": [0, 0, 0]}
    plain, seen = model_with({}), model_with({"overview": view})
    assert plain.hash == seen.hash
    assert (plain.mjm.ncam, seen.mjm.ncam) == (1, 1)
    np.testing.assert_allclose(seen.mjm.camera("overview").pos, view["pos"])


def test_a_body_inside_a_robot_has_the_robots_name_or_that_of_its_asset():
    """`robot/...` and `heron/...` are the same body."""
    mjm = model_with({}).mjm
    inside = [mjm.body(i).name for i in range(mjm.nbody) if mjm.body(i).name.startswith("heron/")][-1]
    view = {"pos": [0, 0, 0.1], "look_at": [0, 0, 1]}
    names = {"a": inside, "b": inside.replace("heron/", "robot/")}
    seen = model_with({name: {**view, "body": body} for name, body in names.items()}).mjm
    assert seen.camera("a").bodyid == seen.camera("b").bodyid == seen.body(inside).id


def test_an_object_with_variants_carries_a_camera():
    """The body that its variants share does, by the name of the object."""
    view = {"body": "thing", "pos": [0, 0, 0.3], "look_at": [0, 0, 0]}
    sim = model_with({"eye": view}, objects={"thing": {"asset": ["can", "mug"], "on": "floor"}}).sim
    assert sim.mjm.camera("eye").bodyid == sim.bodies["thing"]


def test_names_that_do_not_exist_or_are_taken_are_refused():
    """With the key; a model that cannot be edited gets no camera."""
    view = {"pos": [0, 0, 1], "look_at": [0, 0, 0]}
    with pytest.raises(UnknownNameError, match=r"cameras\.eye\.body: unknown body 'blok'.*block"):
        model_with({"eye": {**view, "body": "blok"}})
    with pytest.raises(UnknownNameError, match=r"unknown body 'palm'\..* robot, .*robot/hand") as error:
        model_with({"eye": {**view, "body": "palm"}})
    assert "heron" not in str(error.value)
    spec = mujoco.MjSpec.from_string('<mujoco><worldbody><camera name="eye"/></worldbody></mujoco>')
    with pytest.raises(SceneKeyError, match=r"cameras\.eye: the model has a camera of this name"):
        build_model(SceneConfig.load({"model": spec, "cameras": {"eye": view}}))
    with pytest.raises(SceneKeyError, match=r"cameras\.eye: would be added to the model"):
        build_model(SceneConfig.load({"model": spec.compile(), "cameras": {"eye": view}}))
