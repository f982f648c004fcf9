"""Stable poses of what has joints that are drawn, margins, `gravcomp`, or contacts that are turned off."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.program.plan import build_plan
from tests.program.scenes import scene_of


def poses(folder: Path, body: str, joints: dict[str, Any] | None = None, rest: str = "", **words: Any) -> np.ndarray:
    """Return the direction of the thing that points up in each of its stable poses on the floor, shape (n, 3)."""
    path = folder / "thing.xml"
    path.write_text(f"<mujoco><worldbody>{body}</worldbody>{rest}</mujoco>")
    thing = {"asset": str(path), "on": "floor", "orientation": "stable", **words}
    scene = scene_of({"thing": thing | ({"joints": joints} if joints else {})})
    return np.array([matrix(v.quat)[2] for v in build_plan(scene).objects[-1].stable_poses])


def thing(inside: str, gravcomp: float = 0.0) -> str:
    """A block of 10 x 8 x 6 cm with more inside."""
    return f'<body name="thing" gravcomp="{gravcomp}"><geom type="box" size=".05 .04 .03"/>{inside}</body>'


def has(found: np.ndarray, *up: float) -> bool:
    """Return whether a pose has this axis of the thing up."""
    return bool((found @ up > 0.999).any())


def slide(low: float, high: float) -> str:
    """A foot beside the base, 1 cm above its bottom, that slides up and down."""
    joint = f'<joint name="foot" type="slide" axis="0 0 1" range="{low} {high}"/>'
    return thing(f'<body name="foot" pos=".07 0 -.01">{joint}<geom type="box" size=".01 .01 .01"/></body>')


def test_a_pose_is_stable_in_all_states_that_joints_are_drawn_in(tmp_path: Path):
    """A foot that comes out of the bottom, within a range or among choices; no further, it does not matter."""
    for words, stands in (
        ({"range": [0.0, 0.01]}, True),
        ({"range": [-0.03, 0.01]}, False),
        ({"choice": [0.0, -0.03]}, False),
        ({"value": -0.005}, True),
    ):
        found = poses(tmp_path, slide(-0.04, 0.02), {"foot": words})
        assert has(found, 0, 0, 1) == stands
        assert has(found, 0, 0, -1)
    assert has(poses(tmp_path, slide(-0.04, 0.02)), 0, 0, 1)
    assert has(poses(tmp_path, slide(-0.04, 0.02), {"foot": {"value": -0.03}}, kind="fixture"), 0, 0, 1)


def test_no_pose_that_joints_leave_stable_is_refused(tmp_path: Path):
    """A rod on each side comes out, by whatever follows the first one."""
    sides = [(axis, sign) for axis in range(3) for sign in (-1, 1)]
    text, ties = "", ""
    for i, (axis, sign) in enumerate(sides):
        to = " ".join(str(sign if k == axis else 0) for k in range(3))
        text += (
            f'<body name="r{i}"><joint name="r{i}" type="slide" axis="{to}"/><geom type="sphere" size=".005"/></body>'
        )
        ties += f'<joint joint1="r{i}" joint2="r0"/>' if i else ""
    rest = f"<equality>{ties}</equality>"
    assert len(poses(tmp_path, thing(text), {"r0": {"range": [0.0, 0.02]}}, rest)) == 6
    with pytest.raises(SceneKeyError, match=r"objects.thing.orientation: the object has no pose.*Narrow .* 'thing/r0'"):
        poses(tmp_path, thing(text), {"r0": {"range": [0.0, 0.1]}}, rest)


LOAD = '<body name="load" pos=".08 0 .01"><geom type="box" size=".01 .01 .008" mass=".1" {}/></body>'


def test_weight_counts_and_not_mass(tmp_path: Path):
    """A block that floats stands no more where its load is beside it; what rises rests nowhere, what floats does."""
    assert has(poses(tmp_path, thing(LOAD.format(""))), 0, 0, 1)
    found = poses(tmp_path, thing(LOAD.format(""), gravcomp=1.0))
    assert len(found) > 0
    assert not has(found, 0, 0, 1)
    with pytest.raises(SceneKeyError, match=r"objects.thing.orientation: 'gravcomp' leaves the object no weight"):
        poses(tmp_path, thing("", gravcomp=1.1))
    assert len(poses(tmp_path, thing("", gravcomp=1.0))) == 6


def test_what_would_drop_through_a_margin_is_refused(tmp_path: Path):
    """The scene keeps the whole block as far from the floor as the margin of its load, which is elsewhere."""
    assert has(poses(tmp_path, thing(LOAD.format('margin=".002"'))), 0, 0, 1)
    with pytest.raises(SceneKeyError, match=r"objects.thing.orientation: in each stable pose.*would drop by more"):
        poses(tmp_path, thing(LOAD.format('margin=".02"')))
    foot = '<geom type="box" size=".04 .03 .001" pos="0 0 -.03" margin=".02"/>'
    found = poses(tmp_path, thing(foot))
    assert found.tolist() == pytest.approx(np.array([[0.0, 0.0, 1.0]]), abs=1e-9)


def test_what_does_not_collide_with_its_support_does_not_carry(tmp_path: Path):
    """A foot with other bits; where nothing collides, the poses are those of all geoms."""
    foot = '<geom type="box" size=".02 .02 .01" pos="0 0 -.04" {}/>'
    for other, count in (('contype="0" conaffinity="2"', 5), ("", 6)):
        found = poses(tmp_path, thing(foot.format(other)))
        assert has(found, 0, 0, 1) == (count == 6)
    nothing = poses(tmp_path, thing("").replace("/>", ' contype="0" conaffinity="2"/>'))
    assert len(nothing) == 6
