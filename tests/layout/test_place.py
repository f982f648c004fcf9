"""Where the placing kernel puts things: heights, pivots, headings, boxes in space, and drawn joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy import stats

from sceniris_gym.layout.layouts import Status
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import FLOOR, Rows, box_mjcf, compile_on_cpu, make, posed, write_mjcf
from tests.oracle.solids import Solids


def _one(scene: Mapping, nworld: int = 400) -> tuple[CompiledScene, Rows]:
    compiled = compile_on_cpu(scene)
    rows = make(compiled, nworld, seed=13)
    assert (rows.status == Status.VALID).all()
    return compiled, rows


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("asset", ["apple", "banana", "mug", "bowl", "can", "orange", "cabinet"])
def test_the_lowest_point_stands_at_the_gap_over_the_surface(asset: str, geometry: str):
    """On a table, at any yaw and with any joints drawn: the posed meshes end 2 mm above its top."""
    joints = {"*": {"fraction": [0, 1]}} if asset == "cabinet" else {}
    kind = "fixture" if asset == "cabinet" else "free"
    objects = {
        "table": {"asset": "table", "kind": "static"},
        asset: {"asset": asset, "kind": kind, "on": "table", "gap": 0.002, "joints": joints},
    }
    compiled, rows = _one({"geometry": geometry, "attempts": 40, "objects": objects}, 40)
    solids = Solids(compiled.mjm, geometry)
    lowest = [solids.lowest(data, solids.geoms(asset)) for data in posed(compiled, rows)]
    np.testing.assert_allclose(lowest, 0.4 + 0.002, atol=3e-6)


def test_the_lowest_point_of_what_unfolds_downwards_stands_on_the_surface(tmp_path: Path):
    """Legs on hinges reach below the body, each by its own angle: the body is raised to stand on the longer one."""
    leg = '<body name="{0}" pos="{1} 0 .1"><joint name="{0}" axis="0 1 0" range="-60 60"/><geom type="box"'
    leg += ' size=".005 .005 .08" pos="0 0 -.06"/></body>'
    body = '<geom type="box" size=".1 .02 .005" pos="0 0 .1"/>' + leg.format("l", -0.08) + leg.format("r", 0.08)
    stool = {"asset": write_mjcf(tmp_path, "stool", body), "on": "floor", "joints": {"*": {"fraction": [0, 1]}}}
    compiled, rows = _one({"floor": FLOOR, "attempts": 50, "objects": {"stool": stool}}, 100)
    solids = Solids(compiled.mjm, "physics")
    lowest = [solids.lowest(data, solids.geoms("stool")) for data in posed(compiled, rows)]
    np.testing.assert_allclose(lowest, 0.0005, atol=2e-6)
    assert np.ptp(rows.qpos[:, 2]) > 0.01


def test_what_stands_on_what_stands_rises_with_it(tmp_path: Path):
    """A lift whose platform is drawn between 20 and 60 cm, a free tray on it, a crate on the tray."""
    body = """<geom type="box" size=".2 .2 .01" pos="0 0 .01"/><body name="platform" pos="0 0 .2">
      <joint name="lift" type="slide" axis="0 0 1" range="0 .4"/><geom type="box" size=".2 .2 .01"/></body>"""
    lift = {"asset": write_mjcf(tmp_path, "lift", body), "kind": "fixture", "on": "floor"}
    objects = {
        "crate": {"asset": box_mjcf(tmp_path, "crate", 0.02, 0.02, 0.02), "on": "tray", "gap": 0.003},
        "tray": {"asset": box_mjcf(tmp_path, "tray", 0.2, 0.1, 0.02), "on": "lift/platform", "gap": 0.002},
        "lift": {**lift, "joints": {"lift": {"fraction": [0, 1]}}, "gap": 0.001},
    }
    compiled, rows = _one({"floor": FLOOR, "objects": objects}, 200)
    assert compiled.placed == ("lift", "tray", "crate")
    at = {joint: int(compiled.mjm.joint(joint).qposadr[0]) for joint in ("lift/lift", "tray/free", "crate/free")}
    platform = 0.001 + 0.2 + rows.qpos[:, at["lift/lift"]] + 0.01
    tray, crate = rows.qpos[:, at["tray/free"] :][:, :7], rows.qpos[:, at["crate/free"] :][:, :7]
    np.testing.assert_allclose(tray[:, 2], platform + 0.002, atol=1e-6)
    np.testing.assert_allclose(crate[:, 2], tray[:, 2] + 0.02 + 0.003, atol=1e-6)
    turn = _yaw(tray[:, 3:])
    dx, dy = (crate[:, :2] - tray[:, :2]).T
    across = np.abs([np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx]).max(axis=1)
    np.testing.assert_allclose(across, [0.1, 0.05], rtol=0.05)


def test_a_marker_with_drawn_joints_stays_in_its_region(tmp_path: Path):
    """With `geometry: physics` its geoms touch nothing, and are no pieces; its pose must not depend on them."""
    body = """<geom type="box" size=".01 .01 .01"/><body name="tip" pos="0 0 .1">
      <joint name="tip" type="slide" axis="0 0 1" range="0 .1"/><geom type="box" size=".01 .01 .01"/></body>"""
    wand = {"asset": write_mjcf(tmp_path, "wand", body), "kind": "marker", "joints": {"tip": {"fraction": [0, 1]}}}
    _, rows = _one({"objects": {"wand": {**wand, "region": {"box": [[0.1, 0.2, 0.5], [0.1, 0.2, 0.5]]}}}}, 20)
    np.testing.assert_allclose(rows.mocap_pos[:, 0], np.tile([0.1, 0.2, 0.5], (20, 1)), atol=1e-6)


def test_the_pivot_is_the_bottom_centre_of_the_bounds(tmp_path: Path):
    """A box whose frame is far from its middle and lies on its side: region and turn are about the bottom centre."""
    (tmp_path / "lying.xml").write_text("""<mujoco><worldbody><body name="lying" quat=".707106781 .707106781 0 0">
      <geom type="box" size=".05 .02 .1" pos=".3 -.2 .4"/></body></worldbody></mujoco>""")
    words = {"asset": str(tmp_path / "lying.xml"), "on": "floor", "region": {"box": [[-0.01, 0.1], [0.01, 0.12]]}}
    compiled, rows = _one({"floor": FLOOR, "objects": {"lying": words}})
    solids = Solids(compiled.mjm, "physics")
    centres = np.array([solids.points(data, solids.geoms("lying")[0]).mean(0) for data in posed(compiled, rows)])
    assert (np.abs(centres[:, 0]) <= 0.01 + 1e-6).all()
    assert (np.abs(centres[:, 1] - 0.11) <= 0.01 + 1e-6).all()
    np.testing.assert_allclose(centres[:, 2], 0.02 + 0.0005, atol=2e-6)  # lying: its y half extent is up


def test_a_fixture_that_is_not_placed_stays_where_its_model_has_it(tmp_path: Path):
    """A mocap body of a model, and one that no object is made of: in every layout they are where they were drawn."""
    box = '<geom type="box" size=".1 .1 .1"/>'
    bodies = f'<body name="post" pos=".3 -.2 .11" euler="0 0 30">{box}</body>'
    bodies += f'<body name="lamp" mocap="true" pos="0 .4 1" euler="90 0 0">{box}</body>'
    (tmp_path / "room.xml").write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    objects = {"post": {"kind": "fixture"}, "apple": {"asset": "apple", "on": "floor"}}
    compiled, rows = _one({"model": str(tmp_path / "room.xml"), "floor": FLOOR, "objects": objects})
    for data in posed(compiled, rows):
        for name, at in (("post", [0.3, -0.2, 0.11]), ("lamp", [0.0, 0.4, 1.0])):
            np.testing.assert_allclose(data.body(name).xpos, at, atol=1e-6)
        np.testing.assert_allclose(data.body("post").xmat[[0, 3]], [np.sqrt(0.75), 0.5], atol=1e-6)
        np.testing.assert_allclose(data.body("lamp").xmat[7], 1.0, atol=1e-6)


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


def test_orientations_keep_the_tilt_that_the_asset_has(tmp_path: Path):
    """Whatever the yaw, it turns about the vertical alone; the yaw of a fixed one is 0, that of its own x axis."""
    (tmp_path / "tilted.xml").write_text("""<mujoco><worldbody><body name="tilted" euler="35 0 20">
      <geom type="box" size=".05 .02 .03"/></body></worldbody></mujoco>""")
    words = {"asset": str(tmp_path / "tilted.xml"), "on": "floor", "clearance": 0.0}
    objects = {"a": {**words, "orientation": "fixed"}, "b": words}
    compiled, rows = _one({"floor": {"size": [2, 2]}, "objects": objects})
    solids = Solids(compiled.mjm, "physics")
    up = np.empty(9)
    mujoco.mju_quat2Mat(up, compiled.mjm.body_quat[compiled.mjm.body("a").id])
    for data in posed(compiled, rows):
        # the world's vertical in the body's frame does not depend on the yaw
        for name in objects:
            np.testing.assert_allclose(data.body(name).xmat[6:], up[6:], atol=1e-6)
        assert data.body("a").xmat[0] > 0.9
        np.testing.assert_allclose(data.body("a").xmat[3], 0.0, atol=1e-6)
        np.testing.assert_allclose(solids.lowest(data, solids.geoms("b")), 0.0005, atol=2e-6)


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
    cabinet = {"asset": "cabinet", "kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0, 1]}}}
    cabinet["region"] = {"box": [[0.0, 1.0], [0.3, 1.3]]}
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
