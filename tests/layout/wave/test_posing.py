"""Poses of candidates: heights, pivots and tilts, on placed objects and without a support."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import FLOOR, Rows, box_mjcf, compile_on_cpu, make, posed, write_mjcf
from tests.oracle.solids import Solids


def _one(scene: Mapping, nworld: int = 400) -> tuple[CompiledScene, Rows]:
    compiled = compile_on_cpu(scene)
    rows = make(compiled, nworld, seed=13)
    assert (rows.status == LayoutStatus.VALID).all()
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
    stool = {"asset": write_mjcf(tmp_path, "stool", body), "on": "floor", "stands": False}
    stool |= {"joints": {"*": {"fraction": [0, 1]}}}
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
        "crate": {"asset": box_mjcf(tmp_path, "crate", 0.02, 0.02, 0.02), "on": "tray", "gap": 0.003, "stands": False},
        "tray": {
            "asset": box_mjcf(tmp_path, "tray", 0.2, 0.1, 0.02),
            "on": "lift/platform",
            "gap": 0.002,
            "stands": False,
        },
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


def test_orientations_keep_the_tilt_that_the_asset_has(tmp_path: Path):
    """Whatever the yaw, it turns about the vertical alone; the yaw of a fixed one is 0, that of its own x axis."""
    (tmp_path / "tilted.xml").write_text("""<mujoco><worldbody><body name="tilted" euler="35 0 20">
      <geom type="box" size=".05 .02 .03"/></body></worldbody></mujoco>""")
    words = {"asset": str(tmp_path / "tilted.xml"), "on": "floor", "clearance": 0.0}
    words = {**words, "stands": False}
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
