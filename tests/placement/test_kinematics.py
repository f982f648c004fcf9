"""Body poses against MuJoCo C: shipped assets, and joints of every kind on offset, turned and moved bodies."""

from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.layout.generate import LayoutGenerator
from tests.layout.scenes import ANYWHERE, compile_on_cpu, posed, read, write_mjcf

LINKAGE = """
<geom type="box" size=".02 .02 .02"/>
<body name="a" pos=".1 -.05 .2" euler="30 -50 70">
  <joint name="a1" type="hinge" axis=".3 -1 .5" pos=".02 .03 -.04" range="-150 150"/>
  <joint name="a2" type="slide" axis="1 1 -2" range="-.1 .2"/>
  <joint name="a3" type="hinge" axis="0 0 1" pos="-.05 0 .01" range="-90 120" ref="25"/>
  <geom type="box" size=".01 .02 .03" pos="0 .1 0"/>
  <body name="b" pos="0 .15 0" quat=".5 .1 -.7 .3">
    <joint name="b1" type="slide" axis="0 -1 0" range="-.1 .1" ref=".03"/>
    <joint name="b2" type="hinge" axis="-1 .2 0" pos="0 .02 0" range="-170 170"/>
    <geom type="box" size=".01 .01 .01" pos=".05 0 0"/>
    <body name="still" pos="0 0 .1" axisangle="1 0 1 33"><geom type="box" size=".005 .005 .005"/></body>
  </body>
  <body name="c" pos="-.1 0 0"><joint name="c1" type="hinge" axis="0 1 0" pos=".1 .1 .1" range="-45 45"/>
    <geom type="box" size=".01 .01 .01"/></body>
</body>
"""


def _largest_error(compiled, rows, generator) -> float:
    """Largest difference [m, or of unit quaternions up to sign] between the device's body poses and MuJoCo's."""
    pos, quat = generator.layouts.view.body_pos.numpy(), generator.layouts.view.body_quat.numpy()
    worst = 0.0
    for i, data in enumerate(posed(compiled, rows)):
        sign = np.sign((quat[i] * data.xquat).sum(1))[:, None]
        worst = max(worst, np.abs(pos[i] - data.xpos).max(), np.abs(sign * quat[i] - data.xquat).max())
    return worst


@pytest.mark.parametrize("kind", ["free", "fixture"])
def test_body_poses_are_those_of_mujoco_for_a_linkage_of_all_joints(tmp_path: Path, kind: str):
    """Several joints a body, anchors off the origin, axes of any length, reference positions, turned bodies."""
    asset = write_mjcf(tmp_path, "linkage", LINKAGE)
    words = {"asset": asset, "kind": kind, "region": {"box": ANYWHERE}, "joints": {"*": {"fraction": [0, 1]}}}
    compiled = compile_on_cpu({"objects": {"linkage": words}, "attempts": 40})
    generator = LayoutGenerator(compiled, 64, seed=1)
    generator.generate()
    rows = read(generator.layouts)
    assert (rows.status == 1).all()
    assert np.ptp(rows.qpos[:, -6:], axis=0).min() > 0.05
    assert _largest_error(compiled, rows, generator) < 1e-5


def test_body_poses_are_those_of_mujoco_for_the_cabinet_and_the_arm():
    """A fixture with drawers, and a robot on a turned and raised base, in drawn joint states."""
    compiled = compile_on_cpu(
        {
            "floor": {"size": [1, 1]},
            "robot": {"asset": "panda", "base": [-0.8, 0.1, 0.3], "yaw": 70, "joints": {"*": {"noise": 0.4}}},
            "objects": {
                "cabinet": {
                    "asset": "cabinet",
                    "kind": "fixture",
                    "on": "floor",
                    "joints": {"*": {"fraction": [0, 1]}},
                    "region": {"box": [[0, -0.3], [0.4, 0.3]]},
                }
            },
            "attempts": 50,
        }
    )
    generator = LayoutGenerator(compiled, 64, seed=2)
    generator.generate()
    rows = read(generator.layouts)
    assert _largest_error(compiled, rows[rows.status == 1], generator) < 1e-5


@pytest.mark.parametrize("kind", ["static", "free"])
def test_what_stays_where_the_model_has_it_is_posed_as_mujoco_poses_it(tmp_path: Path, kind: str):
    """Jointed bodies of an own model that are not placed start at its keyframe; their joints are drawn."""
    free = '<freejoint name="loose"/>' if kind == "free" else ""
    home = ".3 .2 .5 .8 .0 .6 .0 " if kind == "free" else ""
    text = f"""<mujoco><worldbody>
      <body name="lamp" pos=".1 .2 .3" euler="0 20 40">{free}<geom type="box" size=".02 .02 .02"/>
        <body name="lamp/arm" pos=".1 0 0"><joint name="lamp/hinge" axis="0 1 1" pos=".01 0 0" range="-90 90"/>
          <geom type="box" size=".02 .01 .01" pos=".05 0 0"/></body></body>
    </worldbody><keyframe><key name="home" qpos="{home}.4"/></keyframe></mujoco>"""
    (tmp_path / "own.xml").write_text(text)
    lamp = {"kind": kind, "joints": {"hinge": {"fraction": [0, 1]}}}
    compiled = compile_on_cpu({"model": tmp_path / "own.xml", "objects": {"lamp": lamp}})
    generator = LayoutGenerator(compiled, 16)
    generator.generate()
    rows = read(generator.layouts)
    assert np.ptp(rows.qpos[:, -1]) > 0.5
    if kind == "free":
        np.testing.assert_allclose(rows.qpos[:, :7], np.tile(compiled.scene.home_qpos[:7], (16, 1)), atol=1e-7)
    assert _largest_error(compiled, rows, generator) < 1e-5


def test_a_ball_joint_below_a_placed_object_keeps_its_start_pose(tmp_path: Path):
    """It cannot be drawn, but what hangs on it is where MuJoCo has it."""
    body = """<geom type="box" size=".02 .02 .02"/><body name="bob" pos=".1 0 .1">
      <joint name="ball" type="ball" pos="0 0 .02"/><geom type="box" size=".03 .01 .01"/></body>"""
    key = '<keyframe><key name="home" qpos=".6 .0 .64 -.48"/></keyframe>'
    asset = write_mjcf(tmp_path, "pendulum", body, key)
    compiled = compile_on_cpu(
        {"objects": {"pendulum": {"asset": asset, "kind": "fixture", "region": {"box": ANYWHERE}}}}
    )
    generator = LayoutGenerator(compiled, 8)
    generator.generate()
    assert _largest_error(compiled, read(generator.layouts), generator) < 1e-5


def test_the_arm_s_drawn_joints_stay_within_its_limits():
    """Noise larger than the way to a limit is cut off there."""
    compiled = compile_on_cpu({"robot": {"asset": "panda", "joints": {"*": {"noise": 1.0}}}, "attempts": 100})
    generator = LayoutGenerator(compiled, 200)
    generator.generate()
    qpos = generator.layouts.qpos.numpy()
    low, high = compiled.mjm.jnt_range.T
    assert (qpos >= low.astype(np.float32)).all()
    assert (qpos <= high.astype(np.float32)).all()
    home = compiled.scene.home_qpos
    assert (np.abs(qpos - home) <= 1.0 + 1e-6).all()
    cut = (home - 1.0 < low) | (home + 1.0 > high)
    assert 0 < cut.sum() < len(cut)
