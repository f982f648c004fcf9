"""Supports: which of them may lean, and those that are named where another one has no level surface."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.errors import NoSupportError
from sceniris_gym.program.plan import build_plan
from tests.layout.scenes import write_mjcf
from tests.program.scenes import scene_of


def test_a_support_leans_with_a_joint_that_follows(tmp_path: Path):
    """As it does with one that is drawn itself."""
    tray = """<geom type="box" size=".1 .1 .01"/>
      <body name="knob" pos=".3 0 .2"><joint name="knob" axis="0 0 1" range="-30 30"/><geom size=".01"/></body>
      <body name="tray" pos="0 0 .2"><joint name="tilt" axis="1 0 0" range="-30 30"/>
        <geom type="box" size=".1 .1 .01"/></body>"""
    rest = '<equality><joint joint1="tilt" joint2="knob"/></equality>'
    asset = write_mjcf(tmp_path, "stand", tray, rest)
    stand = {"asset": asset, "kind": "fixture", "on": "floor"}
    for joints, tilts in (({}, False), ({"knob": {"noise": 0.2}}, True)):
        scene = scene_of({"stand": {**stand, "joints": joints}, "apple": {"asset": "apple", "on": "stand/tray"}})
        assert build_plan(scene).objects[-1].tilts == tilts


def test_the_size_of_the_floor_is_its_full_extents():
    """It lies around the origin of the world, at height 0."""
    plan = build_plan(scene_of({"apple": {"asset": "apple", "on": "floor"}}, floor={"size": [2.0, 0.5]}))
    (ground,) = plan.objects[0].surfaces[0]
    assert (ground.body, ground.height) == (0, 0.0)
    assert ground.outline.bounds == (-1.0, -0.25, 1.0, 0.25)


@pytest.mark.parametrize(
    ("orientation", "tilts"), [("fixed", False), ({"yaw": [-30, 30]}, False), ("stable", True), ("any", True)]
)
def test_a_support_leans_as_its_object_may_lie(folder: Path, orientation: str | dict, tilts: bool):
    """A box that stands upright in all draws, or not."""
    box = {"asset": str(folder / "box.xml"), "on": "floor", "orientation": orientation}
    assert build_plan(scene_of({"box": box, "apple": {"asset": "apple", "on": "box"}})).objects[-1].tilts == tilts


def test_a_support_without_a_level_surface_is_told_with_those_that_have_one(folder: Path):
    """The floor first, then objects and their parts by name; with `inside` there is no floor."""
    objects = {
        "pear": {"asset": "pear", "on": "floor"},
        "tray": {"asset": str(folder / "box.xml"), "kind": "static"},
        "cabinet": {"asset": "cabinet", "kind": "static"},
    }
    for word, floor in (("on", "floor, "), ("inside", "")):
        says = rf"objects\.apple\.{word}: 'pear' has no level surface.* Valid: {floor}apple, cabinet, .*tray\."
        with pytest.raises(NoSupportError, match=says):
            build_plan(scene_of({**objects, "apple": {"asset": "apple", word: "pear"}}))
