"""The obstacles of a scene: sorted by body, planes first, and errors that name the key of an asset."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.obstacles import obstacles
from tests.layout.scenes import write_mjcf
from tests.program.scenes import scene_of


def test_pieces_are_sorted_by_body_and_planes_come_first(tmp_path: Path):
    """Whatever their order in the file."""
    body = '<geom type="box" size=".2 .2 .05" pos="0 0 .05"/><geom type="plane" size="1 1 .1"/><geom size=".1"/>'
    scene = scene_of(
        {"apple": {"asset": "apple"}, "slab": {"asset": write_mjcf(tmp_path, "slab", body), "kind": "static"}}
    )
    found = obstacles(scene)
    assert [p.body for p in found] == sorted(p.body for p in found)
    own = [p.type for p in found if p.body == scene.bodies["slab"]]
    assert own == [PieceType.PLANE, PieceType.BOX, PieceType.SPHERE]


def test_a_geom_that_is_no_obstacle_is_told_with_the_key_of_its_asset(tmp_path: Path):
    """Of an object that has one, and of the robot."""
    body = '<geom name="dunes" type="hfield" hfield="dunes"/>'
    rest = '<asset><hfield name="dunes" nrow="2" ncol="2" size="1 1 .1 .1" elevation="0 1 0 1"/></asset>'
    dunes = write_mjcf(tmp_path, "land", body, rest)
    key = '<keyframe><key name="home"/></keyframe>'
    robot = {"asset": write_mjcf(tmp_path, "bot", body, rest + key)}
    for scene, where in (
        (scene_of({"land": {"asset": dunes, "kind": "static"}}), r"objects\.land\.asset: "),
        (scene_of({}, robot=robot), r"robot\.asset: "),
    ):
        with pytest.raises(NotSupportedError, match=rf"{where}geom '.*dunes': a hfield cannot be an obstacle"):
            obstacles(scene)
