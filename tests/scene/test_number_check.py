"""Numbers that MuJoCo takes and no simulation can use: nan, timesteps of no length, geoms beyond the horizon."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.scene.build import build_model
from tests.versions import since_4

BODY = '<body name="crate"><freejoint/><geom name="side" size=".1" {geom}/></body>'


def _build(folder: Path, *, option: str = "", geom: str = "", rest: str = "") -> None:
    path = folder / "own.xml"
    body = BODY.format(geom=geom)
    path.write_text(f"<mujoco><option {option}/><worldbody>{body}</worldbody>{rest}</mujoco>")
    build_model(
        SceneConfig.load({"model": str(path), "floor": {"size": [1, 1]}, "objects": {"crate": {"on": "floor"}}})
    )


@pytest.mark.parametrize("timestep", ["nan", "-1", "0", "1e300"])
def test_a_timestep_is_a_short_time(tmp_path: Path, timestep: str):
    """MuJoCo steps backwards, or never."""
    with pytest.raises(SceneKeyError, match=r"model: option timestep: \S+ should be from 1e-07 to 1 s"):
        _build(tmp_path, option=f'timestep="{timestep}"')


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"geom": 'friction="nan 1 1"'}, r"geom_friction of geom 'side': nan should be a number"),
        ({"geom": 'friction="-1 1 1"'}, r"geom_friction of geom 'side': -1 should be from 0"),
        pytest.param(
            {"geom": 'pos="1e8 0 0"'},
            r"geom_pos of geom 'side': 1e\+08 should be from",
            marks=since_4("its compiler makes nan of the body's inertia, which is refused first"),
        ),
        ({"geom": 'solref="nan 1"'}, r"geom_solref of geom 'side': nan"),
        ({"option": 'gravity="0 0 nan"'}, r"option gravity: 0, 0, nan should be from -10000 to 10000 m/s\^2"),
        ({"option": 'gravity="0 0 1e30"'}, r"option gravity: 0, 0, 1e\+30 should be from"),
        ({"option": 'wind="0 0 inf"'}, r"option wind: 0, 0, inf should be a finite number"),
        ({"option": 'tolerance="nan"'}, r"option tolerance: nan should be from 0 to 1000\."),
        ({"option": 'iterations="-5"'}, r"option iterations: -5 should be from 0 to 100000\."),
        ({"option": 'impratio="-1"'}, r"option impratio: -1 should be from 1e-06"),
        ({"geom": 'mass="1e30"'}, r"body_mass of body 'crate': 1e\+30 should be from 0 to 1e\+15 kg"),
        ({"rest": '<keyframe><key name="home" qpos="0 0 nan 1 0 0 0"/></keyframe>'}, r"key_qpos of key 'home': nan"),
    ],
)
def test_a_number_that_nothing_real_has_is_refused_by_its_name(tmp_path: Path, words: dict[str, str], says: str):
    """Nan anywhere, and lengths and coefficients out of bounds."""
    with pytest.raises(SceneKeyError, match=says):
        _build(tmp_path, **words)


def test_a_start_pose_is_normalised(tmp_path: Path):
    """A quaternion of any length is the rotation that MuJoCo takes it for."""
    path = tmp_path / "own.xml"
    key = '<keyframe><key name="home" qpos="0 0 1 2 0 0 0"/></keyframe>'
    path.write_text(f"<mujoco><worldbody>{BODY.format(geom='')}</worldbody>{key}</mujoco>")
    scene = build_model(SceneConfig.load({"model": str(path), "objects": {"crate": {}}}))
    assert scene.home_qpos.tolist() == [0, 0, 1, 1, 0, 0, 0]


CELL = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" size="1 1 .1"/>
    <body name="arm"><joint name="turn"/><geom size=".05"/></body>
    <body name="cube" pos=".3 0 .1"><freejoint name="loose"/><geom size=".02"/></body>
    <body name="stand" mocap="true" pos=".5 .5 .3"><geom size=".03"/></body>
  </worldbody>
  <actuator><motor joint="turn"/></actuator>
  <keyframe><key name="home" {words}/></keyframe>
</mujoco>"""


@pytest.mark.parametrize(("form", "robots"), [("path", 0), ("path", 1), ("spec", 0), ("spec", 1), ("model", 0)])
@pytest.mark.parametrize(
    ("words", "says"),
    [
        ('qpos="nan 0 0 1 1 0 0 0"', r"key_qpos of key 'home': nan should be a number \(qpos\[0\], joint 'turn'\)"),
        ('qpos="0 0 0 nan 1 0 0 0"', r"key_qpos of key 'home': nan should be a number \(qpos\[3\], joint 'loose'\)"),
        ('qpos="0 nan 0 1 1 0 0 0"', r"key_qpos of key 'home': nan should be a number \(qpos\[1\], joint 'loose'\)"),
        ('ctrl="nan"', r"key_ctrl of key 'home': nan should be a number\."),
    ],
)
def test_a_nan_of_the_start_pose_is_named_by_its_keyframe(
    tmp_path: Path, words: str, says: str, form: str, robots: int
):
    """Of a model in any form, and also where a robot is attached to it, which makes MuJoCo fill in some of them."""
    path = tmp_path / "cell.xml"
    path.write_text(CELL.format(words=words))
    spec = mujoco.MjSpec.from_file(str(path))
    robot: dict[str, Any] = {"robot": {"asset": "panda", "base": [-2, 0, 0]}} if robots else {}
    model = {"path": str(path), "spec": spec, "model": spec.copy().compile()}[form]
    with pytest.raises(SceneKeyError, match=rf"scene: model: {says}"):
        build_model(SceneConfig.load({"model": model, "objects": {"cube": {"on": "ground"}}, **robot}))


def test_a_nan_of_a_robot_s_start_pose_is_named_by_its_keyframe(tmp_path: Path):
    """Of the keyframe that the robot starts from; another one is not read."""
    path = tmp_path / "cell.xml"
    path.write_text(
        "<mujoco><worldbody><body name='arm'><geom size='.05'/><body><joint name='turn'/><geom size='.02'/></body>"
        "</body></worldbody><keyframe><key name='home' qpos='1'/><key name='bad' qpos='nan'/></keyframe></mujoco>"
    )
    scene = build_model(SceneConfig.load({"floor": {"size": [1, 1]}, "robot": {"asset": str(path)}}))
    assert scene.home_qpos.tolist() == [1.0]
    with pytest.raises(SceneKeyError, match=r"robot\.asset.*key_qpos of key 'bad': nan .*\(qpos\[0\], joint 'turn'\)"):
        build_model(SceneConfig.load({"floor": {"size": [1, 1]}, "robot": {"asset": str(path), "keyframe": "bad"}}))
