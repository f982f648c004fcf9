"""Scenes as MuJoCo models: what is found by its name, hashes, wrong names, and joints that cannot be drawn."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, SceneFileError, SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.scene.build import build_model
from tests.scene.assets import BALL, TETRAHEDRON, build


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


def test_a_part_names_a_joint_by_its_name_a_pattern_or_its_body(folder: Path):
    """The first joint that matches; a word of `joints` may be a part, which hides a joint of its name."""
    parts = {"a": "*", "b": "slide", "c": "lid", "slide": "hinge"}
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture", "parts": parts, "joints": {"b": {"value": 0.1}}}})
    names = {scene.mjm.joint(j).name: j for j in range(scene.mjm.njnt)}
    assert names.keys() == {"a/slide", "a/hinge"}
    slide, hinge = names["a/slide"], names["a/hinge"]
    assert scene.joints("a") == {"hinge": hinge, "a": min(slide, hinge), "b": slide, "c": hinge, "slide": hinge}
    assert list(scene.joint_configs("a")) == [slide]
    twice = {
        "asset": "chest",
        "kind": "fixture",
        "parts": parts,
        "joints": {"c": {"value": 0.1}, "hinge": {"value": 0}},
    }
    with pytest.raises(SceneKeyError, match=r"objects\.a\.joints: '(c|hinge)' and another key are the same joint"):
        build(folder, {"a": twice}).joint_configs("a")
    for wrong, message in {"lidd": "unknown joint 'lidd'.*Valid: hinge, slide", "z*": r"unknown joint 'z\*'"}.items():
        with pytest.raises(UnknownNameError, match=rf"objects\.a\.parts\.b: {message}"):
            build(folder, {"a": {"asset": "chest", "kind": "fixture", "parts": {"b": wrong}}})


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
            with pytest.raises(SceneKeyError, match=r"pot\.joints\.\*\.noise_norm: 'pot/lid' starts at"):
                build(folder, {"pot": {**pot, "joints": {"*": {"noise_norm": 0.15}}}})
        build(folder, {"pot": {**pot, "joints": {"lid": {"range": [0, 0.1]}}}})


def test_a_ball_joint_cannot_be_drawn_yet(folder: Path):
    """Joints are sliders and hinges."""
    (folder / "joystick.xml").write_text(
        BALL.replace("</body>", "<body name='s'><joint type='ball'/><geom size='.1'/></body></body>")
    )
    with pytest.raises(NotSupportedError, match="'a/joint0' is a ball joint"):
        build(folder, {"a": {"asset": "joystick", "kind": "fixture", "joints": {"*": {"value": 0}}}})
