"""Draws of a candidate: headings, points of boxes in space, and joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import FLOOR, Rows, box_mjcf, compile_on_cpu, make, write_mjcf
from tests.versions import OLD


def _one(scene: Mapping, nworld: int = 400) -> tuple[CompiledScene, Rows]:
    compiled = compile_on_cpu(scene)
    rows = make(compiled, nworld, seed=13)
    assert (rows.status == LayoutStatus.VALID).all()
    return compiled, rows


def _yaw(quat: np.ndarray) -> np.ndarray:
    """Yaw [rad] of upright wxyz quaternions, shape (n, 4)."""
    return 2 * np.arctan2(quat[:, 3], quat[:, 0])


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize(
    ("words", "low", "high"), [("fixed", 0, 0), ({"yaw": [170, 250]}, 170, 250), (None, -180, 180)]
)
def test_the_yaw_is_drawn_about_the_heading_of_the_support(tmp_path: Path, words, low: float, high: float):
    """Uniform in its range relative to a turned tray; the range may cross 180 degrees."""
    tray = box_mjcf(tmp_path, "tray", 0.4, 0.4, 0.02)
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.03, 0.04), "on": "tray"}
    if words is not None:
        crate["orientation"] = words
    objects = {"tray": {"asset": tray, "kind": "fixture", "on": "floor"}, "crate": crate}
    _, rows = _one({"floor": FLOOR, "objects": objects}, 1000)
    turn = _wrapped(_yaw(rows.qpos[:, 3:7]) - _yaw(rows.mocap_quat[:, 0]) - np.radians((low + high) / 2))
    assert np.ptp(_yaw(rows.mocap_quat[:, 0])) > 6.0
    half = np.radians(high - low) / 2
    assert np.abs(turn).max() <= half + 2e-6
    if half > 0:
        assert stats.kstest(turn, "uniform", args=(-half, 2 * half)).pvalue > 0.001


@pytest.mark.parametrize("kind", ["free", "fixture", "marker"])
def test_a_box_in_space_is_filled_uniformly(tmp_path: Path, kind: str):
    """Markers, free objects and fixtures without a support: the pivot, in the world, in all three directions."""
    crate = box_mjcf(tmp_path, "crate", 0.04, 0.02, 0.01)
    region = {"box": [[-0.2, 0.1, 0.3], [0.4, 0.3, 1.1]]}
    _, rows = _one({"objects": {"crate": {"asset": crate, "kind": kind, "region": region}}}, 2000)
    at = rows.qpos[:, :3] if kind == "free" else rows.mocap_pos[:, 0]
    for column, low, high in zip(at.T, *region["box"], strict=True):
        assert low - 1e-6 <= column.min() <= column.max() <= high + 1e-6
        assert stats.kstest(column, "uniform", args=(low, high - low)).pvalue > 0.001
    assert np.abs(np.corrcoef(at.T) - np.eye(3)).max() < 0.1


GADGET = """<geom type="box" size=".02 .02 .02" pos="0 0 .02"/>
  <body name="s" pos="0 0 .1"><joint name="slide" type="slide" axis="0 0 1" range="-.1 .3"/>
    <geom type="box" size=".01 .01 .01"/></body>
  <body name="h" pos="0 0 .8"><joint name="hinge" type="hinge" axis="0 0 1" range="-30 90"/>
    <geom type="box" size=".01 .01 .01"/></body>
  <body name="w" pos="0 0 .9"><joint name="wheel" type="hinge" axis="0 0 1"/>
    <geom type="box" size=".01 .01 .01"/></body>"""
HINGE = np.radians([-30.0, 90.0])
FORMS = {
    "fraction": ({"slide": {"fraction": [0.25, 0.5]}}, "slide", (0.0, 0.1)),
    "fraction of a hinge": ({"hinge": {"fraction": [0, 1]}}, "hinge", tuple(HINGE)),
    "range": ({"hinge": {"range": [0.1, 0.4]}}, "hinge", (0.1, 0.4)),
    "range without limits": ({"wheel": {"range": [-9.0, 9.0]}}, "wheel", (-9.0, 9.0)),
    "noise": ({"slide": {"noise": 0.05}}, "slide", (-0.05, 0.05)),
    "noise cut off at a limit": ({"slide": {"noise": 0.2}}, "slide", (-0.1, 0.2)),
    "noise without limits": ({"wheel": {"noise": 0.5}}, "wheel", (-0.5, 0.5)),
    "pattern": ({"*": {"value": 0.2}, "s*": {"noise": 0.0}, "hinge": {"range": [0, 0.5]}}, "hinge", (0.0, 0.5)),
}


@pytest.mark.parametrize("name", FORMS)
def test_joints_are_uniform_in_their_interval(tmp_path: Path, name: str):
    """All forms that name an interval, of slides and hinges, with limits and without."""
    if OLD and name == "noise cut off at a limit":
        pytest.skip("MuJoCo before 4.0: a fixture's own parts collide with it, as where the slide is lowest")
    joints, joint, (low, high) = FORMS[name]
    gadget = {"asset": write_mjcf(tmp_path, "gadget", GADGET), "kind": "fixture", "on": "floor", "joints": joints}
    compiled, rows = _one({"floor": FLOOR, "objects": {"gadget": gadget}}, 1000)
    q = rows.qpos[:, compiled.mjm.joint(f"gadget/{joint}").qposadr[0]]
    assert low - 1e-6 <= q.min() <= q.max() <= high + 1e-6
    assert stats.kstest(q, "uniform", args=(low, high - low)).pvalue > 0.001


def test_joints_take_values_and_choices(tmp_path: Path):
    """A value holds, each choice comes equally often, and what is not named stays at home; all independent."""
    joints = {"slide": {"choice": [-0.05, 0.0, 0.25]}, "hinge": {"value": 1.2}}
    gadget = {"asset": write_mjcf(tmp_path, "gadget", GADGET), "kind": "free", "on": "floor", "joints": joints}
    _, rows = _one({"floor": FLOOR, "objects": {"gadget": gadget}}, 1500)
    slide, hinge, wheel = rows.qpos[:, 7:].T
    values, counts = np.unique(slide, return_counts=True)
    np.testing.assert_array_equal(values, np.array([-0.05, 0.0, 0.25], np.float32))
    assert stats.chisquare(counts).pvalue > 0.001
    assert (hinge == np.float32(1.2)).all()
    assert (wheel == 0.0).all()


def test_joints_are_drawn_independently_of_each_other_and_of_the_pose():
    """Seven joints of the arm and two drawers: no two are correlated, nor with where the cabinet stands."""
    region = {"box": [[0.0, 1.0], [0.3, 1.3]]}
    joints = {"*": {"fraction": [0, 1]}}
    cabinet = {"asset": "cabinet", "kind": "fixture", "on": "floor", "region": region, "joints": joints}
    robot = {"asset": "panda", "joints": {"joint*": {"noise": 0.05}}}
    compiled, rows = _one({"floor": {"size": [4, 4]}, "robot": robot, "objects": {"cabinet": cabinet}}, 2000)
    joints = [i for i in range(compiled.mjm.nq) if np.ptp(rows.qpos[:, i]) > 0]
    assert len(joints) == 9
    columns = np.column_stack([rows.qpos[:, joints], rows.mocap_pos[:, 0, :2], _yaw(rows.mocap_quat[:, 0])])
    assert np.abs(np.corrcoef(columns.T) - np.eye(12))[:9].max() < 0.09


def test_what_no_object_names_stays_at_home_bit_for_bit():
    """Fingers of an arm whose other joints are drawn, and controls of nothing else."""
    robot = {"asset": "panda", "joints": {"joint*": {"noise": 0.1}}}
    compiled, rows = _one({"robot": robot}, 20)
    still = [i for i in range(compiled.mjm.nq) if not compiled.mjm.joint(i).name.startswith("panda/joint")]
    assert len(still) == 2
    assert (rows.qpos[:, still] == compiled.home_qpos[still]).all()
