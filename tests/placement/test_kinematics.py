"""Body poses against MuJoCo C: shipped assets, and joints of every kind on offset, turned and moved bodies."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy import stats

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.stored import StoredLayouts
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


@pytest.mark.parametrize(("norm", "pattern", "size"), [(0.3, "joint*", 7), (0.2, "joint[1-3]", 3), (0.1, "joint1", 1)])
def test_a_norm_is_that_of_a_vector_in_a_uniform_direction(norm: float, pattern: str, size: int):
    """The squares of its coordinates have a beta distribution. Other joints have draws of their own."""
    words = {pattern: {"noise_norm": norm}, "finger_joint1": {"range": [0.01, 0.02]}}
    compiled = compile_on_cpu({"floor": {"size": [1, 1]}, "robot": {"asset": "panda", "joints": words}})
    generator = LayoutGenerator(compiled, 4096, seed=3)
    generator.generate()
    away = read(generator.layouts).qpos - compiled.scene.home_qpos
    moved = away[:, :size] / norm
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1.0, atol=1e-5)
    assert np.abs(away[:, size:7]).max(initial=0.0) < 1e-6
    assert np.ptp(away[:, 7]) > 0.009
    for coordinate in moved.T:
        assert stats.binomtest(int((coordinate > 0).sum()), 4096).pvalue > 1e-4
        if size > 1:
            assert stats.kstest(coordinate**2, stats.beta(0.5, (size - 1) / 2).cdf).pvalue > 1e-4
    assert np.abs(np.corrcoef(moved.T) - np.eye(size)).max() < 0.07


def test_a_norm_is_cut_off_at_limits_and_gives_way_to_a_start():
    """A drawer is limited to 0 to 25 cm. A start that draws it does so uniformly. It is no param."""
    words = {"asset": "cabinet", "kind": "static", "joints": {"*": {"noise_norm": 0.3}}}
    start = [{"joints": {"cabinet/upper": {"range": [0.1, 0.2]}}}]
    config = {"floor": {"size": [1, 1]}, "objects": {"cabinet": words}}
    for scene, low, high in ((config, 0.0, 0.25), ({**config, "start": start}, 0.1, 0.2)):
        compiled = compile_on_cpu(scene)
        generator = LayoutGenerator(compiled, 256, seed=3)
        generator.generate()
        upper = read(generator.layouts).qpos[:, compiled.scene.joints("cabinet")["upper"]]
        assert low <= upper.min() < low + 0.01
        assert high - 0.02 < upper.max() <= high + 1e-6
    with pytest.raises(ArgumentError, match=r"'noise_norm'\. Give a 'range'"):
        LayoutGenerator(compiled, 1, params=["objects.cabinet.joints.upper"])


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def test_a_norm_belongs_to_each_variant_and_to_the_id_of_a_layout(device: str):
    """Layouts have the same joints by their ids, from a table, and after another object was drawn again."""
    unit = {"kind": "fixture", "on": "floor", "asset": ["cabinet", "cupboard"], "joints": {"*": {"noise_norm": 0.2}}}
    objects = {"unit": unit | {"region": {"box": [[0, 0.6], [0.1, 0.7]]}}, "can": {"asset": "can", "on": "floor"}}
    compiled = compile_scene({"bank": 4, "floor": {"size": [4, 4]}, "objects": objects}, device)
    generator = LayoutGenerator(compiled, 64, seed=3)
    generator.generate()
    table = generator.table()
    for name, size in (("unit/cabinet", 2), ("unit/cupboard", 1)):
        there = table.present[:, compiled.slots.index(name)]
        away = table.qpos[there][:, compiled.mjm.jnt_qposadr[list(compiled.scene.joints(name).values())]]
        assert away.shape[1] == size
        assert 0.1 < np.linalg.norm(away, axis=1).max() <= 0.2 + 1e-6  # a closed unit can only open
    again = LayoutGenerator(compiled, 64, seed=9)
    again.reseed(layouts=generator.ids("train"))
    again.generate()
    stored = StoredLayouts(compiled, table, 64)
    stored.generate()
    moved = read(generator.redraw(generator.layouts, ["can"])).qpos
    np.testing.assert_array_equal(again.table().qpos, table.qpos)
    order = np.argsort(stored.layouts.view.seed.numpy())
    np.testing.assert_array_equal(read(stored.layouts).qpos[order], table.qpos)
    joints = compiled.mjm.jnt_qposadr[compiled.mjm.jnt_type != int(mujoco.mjtJoint.mjJNT_FREE)]
    np.testing.assert_array_equal(moved[:, joints], table.qpos[:, joints])
    assert (moved != table.qpos).any()


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
