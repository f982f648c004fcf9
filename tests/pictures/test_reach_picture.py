"""The picture of a map, of a crane whose reach is a ring with a rectangular section."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.pictures.reach_picture import draw
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.map import ReachMap
from tests.layout.crane import HEIGHT, RADIUS, crane_map, crane_mjcf

PIXELS_A_METRE = 120.0  # a panel of 240 pixels shows 2 m


@pytest.fixture(scope="module")
def reach_map(tmp_path_factory: pytest.TempPathFactory) -> ReachMap:
    """The crane's map, in which it reaches straight down and no other way."""
    asset = crane_mjcf(tmp_path_factory.mktemp("crane"))
    path = crane_map(asset)
    return ReachMap.load(path, SerialArm.from_model(mujoco.MjModel.from_xml_path(asset), "crane"), "")


def green(reach_map: ReachMap, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the lower panels, on the left and on the right, say that something is reached from above."""
    drawn = np.asarray(draw(reach_map, height, "cpu")).astype(int)
    found = (drawn[..., 1] > drawn[..., 0] + 30) & (drawn[..., 1] > drawn[..., 2] + 30)
    below = found[found.shape[0] // 2 :]
    return below[:, : found.shape[1] // 2], below[:, found.shape[1] // 2 :]


def test_the_top_view_is_a_ring_and_the_side_view_its_two_sections(reach_map: ReachMap):
    """Areas and middles in closed form, but for lines and labels that are drawn over them."""
    side, top = green(reach_map, 0.2)
    ring = np.pi * (RADIUS[1] ** 2 - RADIUS[0] ** 2) * PIXELS_A_METRE**2
    sections = 2 * (RADIUS[1] - RADIUS[0]) * (HEIGHT[1] - HEIGHT[0]) * PIXELS_A_METRE**2
    assert 0.9 * ring < top.sum() < 1.02 * ring
    assert 0.85 * sections < side.sum() < 1.02 * sections
    across, down = (np.flatnonzero(top.any(axis=axis)) for axis in (0, 1))
    assert np.ptp(across) == pytest.approx(2 * RADIUS[1] * PIXELS_A_METRE, abs=3)
    assert np.ptp(down) == pytest.approx(2 * RADIUS[1] * PIXELS_A_METRE, abs=3)
    rows = np.flatnonzero(side.any(axis=1))
    assert np.ptp(rows) == pytest.approx((HEIGHT[1] - HEIGHT[0]) * PIXELS_A_METRE, abs=3)


def test_the_ring_is_empty_in_the_middle(reach_map: ReachMap):
    """Nothing is reached at the crane's own axis, nor in the picture's corners."""
    _, top = green(reach_map, 0.2)
    across, down = (np.flatnonzero(top.any(axis=axis)) for axis in (0, 1))
    x, y = across.mean(), down.mean()
    rows, columns = np.nonzero(top)
    away = np.hypot(columns - x, rows - y) / PIXELS_A_METRE
    assert RADIUS[0] - 0.02 < away.min() < away.max() < RADIUS[1] + 0.02


def test_above_all_that_is_reached_the_top_view_is_empty(reach_map: ReachMap):
    """The side view does not depend on the height."""
    side, top = green(reach_map, 0.45)
    assert not top.any()
    np.testing.assert_array_equal(side, green(reach_map, 0.1)[0])
