"""Scenes as MuJoCo models: start poses, what is found by its name, the user's own models, and wrong names."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import (
    ArgumentTypeError,
    NotSupportedError,
    SceneFileError,
    SceneKeyError,
    ScenirisError,
    UnknownNameError,
)
from sceniris_gym.scene.model import build_model
from tests.scene.assets import BALL, TETRAHEDRON, build, names


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
    assert [scene.support(parent, "here").body for parent in ("floor", "a", "a/lid")] == [0, 1, 3]
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
    assert scene.support("desk/drawer", "here").body == mjm.body("drawer").id
    assert scene.joints("desk") == {"rail": mjm.joint("rail").id}
    assert scene.joints("stone") == {}
    np.testing.assert_allclose(scene.home_qpos[: mjm.nq - 7], [0.1, 0, 0, 0.2, 1, 0, 0, 0, 0.7])


def test_noise_around_a_start_pose_beyond_the_limits_is_refused(folder: Path):
    """It would be cut off at limits that the joint has left already; a rounded keyframe is fine."""
    lid = '<joint name="lid" type="slide" range="0 .2"/><geom size=".1"/>'
    for start, fits in ((0.3, False), (-0.1, False), (0.2, True), (0.2 + 1e-7, True)):
        key = f'<keyframe><key name="home" qpos="{start}"/></keyframe>'
        (folder / "pot.xml").write_text(
            f'<mujoco><worldbody><body name="pot"><body>{lid}</body></body></worldbody>{key}</mujoco>'
        )
        pot = {"asset": "pot", "kind": "fixture", "joints": {"*": {"noise": 0.15}}}
        if fits:
            build(folder, {"pot": dict(pot)})
        else:
            with pytest.raises(
                SceneKeyError, match=r"pot\.joints\.\*\.noise: 'pot/lid' starts at .* limits \[0, 0\.2\]"
            ):
                build(folder, {"pot": dict(pot)})
        build(folder, {"pot": {**pot, "joints": {"lid": {"range": [0, 0.1]}}}})


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


def test_a_ball_joint_cannot_be_drawn_yet(folder: Path):
    """Joints are sliders and hinges."""
    (folder / "joystick.xml").write_text(
        BALL.replace("</body>", "<body name='s'><joint type='ball'/><geom size='.1'/></body></body>")
    )
    with pytest.raises(NotSupportedError, match="'a/joint0' is a ball joint"):
        build(folder, {"a": {"asset": "joystick", "kind": "fixture", "joints": {"*": {"value": 0}}}})


def test_what_is_no_scene_config_is_refused():
    """The name of a scene too, which SceneConfig.load reads."""
    for wrong in (None, "mid"):
        with pytest.raises(ArgumentTypeError, match="build_model: config should be a SceneConfig, got"):
            build_model(wrong)  # type: ignore[arg-type]
