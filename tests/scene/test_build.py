"""Models of scenes: start poses, the user's own models, and what cannot be built."""

from __future__ import annotations

import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentTypeError
from sceniris_gym.scene.build import build_model
from tests.scene.assets import build, names


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


def test_what_is_no_scene_config_is_refused():
    """The name of a scene too, which SceneConfig.load reads."""
    for wrong in (None, "mid"):
        with pytest.raises(ArgumentTypeError, match="build_model: config should be a SceneConfig, got"):
            build_model(wrong)  # type: ignore[arg-type]
