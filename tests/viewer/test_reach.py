"""The slice of the reach map: opaque where the map lets approaches through, and in place."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.config.tier import Tier
from sceniris_gym.viewer.reach import ReachSlice
from tests.viewer.worlds_on_show import compiled_scene, world_of


def test_a_slice_is_opaque_where_the_arm_reaches():
    """Not in its base, not beyond its span, and at points that the map knows; the height is that of the world."""
    world = world_of("tabletop_lift")
    (piece,) = ReachSlice.of(world.compiled.scene)
    height = 0.6
    base = world.data.xpos[piece.body]
    picture = piece.picture(world.data, height)
    assert picture.shape[2] == 4
    assert picture[0, 0, 3] == 0
    num = len(picture)
    ticks = (np.arange(num) + 0.5) / num * 2.0 * piece.span - piece.span
    x, y = ticks[3 * num // 4], ticks[num // 2]
    poses = np.tile(np.eye(4), (1, 1, 1))
    poses[0, :3, 3] = [x + piece.map.arm.axis_xy[0], y + piece.map.arm.axis_xy[1], height - base[2]]
    poses[0, :3, 2] = [0.0, 0.0, -1.0]
    poses[0, :3, 0], poses[0, :3, 1] = [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]
    assert piece.map.verdict(poses, "cpu")[0] >= Tier.MAP.least_verdict
    assert picture[num - 1 - num // 2, 3 * num // 4, 3] > 0
    at, turn = piece.pose(world.data, height)
    assert at[2] == height
    assert at[:2] == pytest.approx(base[:2], abs=0.2)
    assert turn == pytest.approx(world.data.xquat[piece.body])


def test_scenes_without_a_map_have_no_slice():
    """No robot at all."""
    assert ReachSlice.of(compiled_scene("mid").scene) == []
