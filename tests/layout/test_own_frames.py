"""Sides of an object that its model has turned: along the axes of its own body, in literal numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.layout.related import judged, table_of
from tests.layout.scenes import box_mjcf, compile_on_cpu, make, posed, valid, write_mjcf

# A desk of 0.4 m (x) by 0.2 m (y) whose own x axis points to the world's back: its front, -y, is to the world's right.
DESK = '<geom type="box" size=".2 .1 .05" pos="0 0 .05"/>'
TURNED = '<body name="desk" euler="0 0 90">{}</body>'
OFF_FLOOR = '<body name="desk" pos="0 0 .01" euler="0 0 90">{}</body>'
HERE = {"on": "floor", "region": {"box": [[-0.0001, -0.0001], [0.0001, 0.0001]]}, "orientation": {"yaw": [90, 90]}}

ANCHORS: dict[str, tuple[str, dict[str, Any], bool]] = {
    "static of a model": (TURNED.format(DESK), {"kind": "static"}, True),
    "free of a model": (OFF_FLOOR.format("<freejoint/>" + DESK), {}, True),
    "free of a model, placed": (OFF_FLOOR.format("<freejoint/>" + DESK), HERE, True),
    "fixture of a model": (OFF_FLOOR.format(DESK), {"kind": "fixture"}, True),
    "fixture of a model, placed": (TURNED.format(DESK), {"kind": "fixture", **HERE}, True),
    "static asset": (TURNED.format(DESK), {"kind": "static"}, False),
    "fixture of an asset, placed": (TURNED.format(DESK), {"kind": "fixture", **HERE}, False),
    "free asset, placed": (TURNED.format(DESK), HERE, False),
}
# Where things are in the world, at 0.4 m from the desk.
SIDES = {"front": (0.4, 0.0), "right": (0.0, 0.4), "back": (-0.4, 0.0), "left": (0.0, -0.4)}


def _scene(folder: Path, body: str, words: dict[str, Any], is_model: bool, objects: dict[str, Any]) -> dict[str, Any]:
    file = folder / "desk.xml"
    file.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    desk = words if is_model else {"asset": str(file), **words}
    scene = {"floor": {"size": [2.0, 2.0]}, "objects": {"desk": desk, **objects}}
    return {"model": str(file), **scene} if is_model else scene


def _at(side: str, **words: Any) -> dict[str, Any]:
    relation = {f"{side}_of": "desk", "angle": 2, "distance": {"equal": 0.4, "tolerance": 0.001}}
    return {"kind": "marker", "on": "floor", "relations": [relation], **words}


@pytest.mark.parametrize("anchor", ANCHORS)
def test_sides_are_those_of_the_body_itself(anchor: str, tmp_path: Path):
    """Whoever turned it: a model, the root of an asset, or the draw; the audit finds the same."""
    objects: dict[str, Any] = {side: _at(side) for side in SIDES}
    block = {"asset": box_mjcf(tmp_path, "block", 0.1, 0.06, 0.04), "on": "floor", "orientation": "fixed"}
    objects["block"] = {**block, "relations": [{"beside": "desk", "side": "front", "gap": 0.05}]}
    compiled = compile_on_cpu(_scene(tmp_path, *ANCHORS[anchor], objects), bank=4)
    table = table_of(compiled, 8)
    for data in posed(compiled, valid(make(compiled, 8))):
        assert data.body("desk").xmat[[0, 3]] == pytest.approx([0.0, 1.0], abs=1e-5)
        for side, at in SIDES.items():
            assert data.body(side).xpos[:2] == pytest.approx(at, abs=0.02), side
        assert data.body("block").xpos[0] == pytest.approx(0.1 + 0.05 + 0.05, abs=2e-4)
        assert abs(data.body("block").xpos[1]) < 0.2 - 0.03 + 2e-4
    assert [k for k in judged(compiled, table) if k.broken] == []


@pytest.mark.parametrize("frame", ["anchor", "support", "table"])
def test_the_frame_of_a_support_is_that_of_the_object(frame: str, tmp_path: Path):
    """A table that the model has turned by 90 degrees: what stands on it sees one right-hand side, the world's back."""
    table = '<body name="table" euler="0 0 90"><geom type="box" size=".5 .5 .05"/></body>'
    (tmp_path / "table.xml").write_text(f"<mujoco><worldbody>{table}</worldbody></mujoco>")
    relation = {"right_of": "table", "angle": 2, "frame": frame, "distance": {"equal": 0.4, "tolerance": 0.001}}
    objects = {"table": {"kind": "static"}, "mark": {"kind": "marker", "on": "table", "relations": [relation]}}
    rows = make(compile_on_cpu({"model": str(tmp_path / "table.xml"), "objects": objects}, bank=4), 8)
    np.testing.assert_allclose(rows.mocap_pos[:, 0, :2], np.tile([0.0, 0.4], (8, 1)), atol=0.02)


@pytest.mark.parametrize(
    ("orientation", "right"),
    [
        ("fixed", (1, 0)),
        ({"yaw": [90, 90]}, (0, 1)),
        ({"face_to": "mark"}, (0, 1)),
        ({"stable": {"yaw": [0, 0]}}, (1, 0)),
    ],
    ids=str,
)
def test_an_asset_that_is_turned_is_drawn_by_its_own_axes(orientation: Any, right: tuple, tmp_path: Path):
    """A yaw is the angle of its own x axis, and its own front is what faces a mark to the right of it."""
    desk = {"on": "floor", "orientation": orientation}
    here = {"box": [[-1e-4, -1e-4], [1e-4, 1e-4]]}
    mark = {"kind": "marker", "region": {"box": [[0.6, 0.0, 0.0], [0.6, 0.0, 0.0]]}}
    body = '<body name="desk" euler="0 0 90"><geom type="box" size=".3 .2 .02" pos="0 0 .02"/></body>'
    compiled = compile_on_cpu(_scene(tmp_path, body, {**desk, "region": here}, False, {"mark": mark}), bank=4)
    table = table_of(compiled, 8)
    for data in posed(compiled, valid(make(compiled, 8))):
        if abs(data.body("desk").xmat[8]) > 0.99:
            assert data.body("desk").xmat[[0, 3]] == pytest.approx(right, abs=1e-3)
    assert [k for k in judged(compiled, table) if k.broken] == []


def test_a_robot_is_where_its_base_is(tmp_path: Path):
    """An arm that reaches far to its right does not move what is seen from it; its bounds are those of the arm."""
    post = '<geom type="box" size=".05 .05 .1" pos="0 0 .1"/><geom type="box" size=".02 .3 .02" pos="0 -.35 .2"/>'
    home = '<keyframe><key name="home"/></keyframe>'
    robot = {"asset": write_mjcf(tmp_path, "post", post, home), "base": [0.1, -0.2, 0.0], "yaw": 90}
    near = [{"front_of": "robot", "angle": 1, "distance": {"equal": 0.5, "tolerance": 0.001}}]
    beside = [{"beside": "robot", "side": "right", "gap": 0.05}]
    block = {"asset": box_mjcf(tmp_path, "block", 0.1, 0.1, 0.04), "on": "floor", "orientation": "fixed"}
    objects = {"mark": {"kind": "marker", "on": "floor", "relations": near}, "block": {**block, "relations": beside}}
    compiled = compile_on_cpu({"floor": {"size": [3.0, 3.0]}, "robot": robot, "objects": objects}, bank=4)
    table = table_of(compiled, 8)
    for data in posed(compiled, valid(make(compiled, 8))):
        assert data.body("mark").xpos[:2] == pytest.approx((0.1, 0.3), abs=0.02)
        assert data.body("block").xpos[:2] == pytest.approx((0.1 + 0.65 + 0.05 + 0.05, -0.2), abs=2e-4)
    assert [k for k in judged(compiled, table) if k.broken] == []
