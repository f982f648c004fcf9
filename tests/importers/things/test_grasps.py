"""Antipodal grasps: across a box where it is narrow enough, above its floor, and none where it is too wide."""

from __future__ import annotations

import numpy as np

from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.importers.things.grasps import MOST, OPENING, antipodal_grasps
from tests.importers.things.shapes import box


def grasps_of(extents: tuple[float, float, float]) -> list:
    """Grasps of a box that stands on z = 0."""
    mesh = box(extents).apply_translation([0, 0, 0.5 * extents[2]])
    return antipodal_grasps(np.asarray(mesh.triangles), np.asarray(mesh.sample(2000, seed=0)))


def test_fingers_close_across_parallel_sides():
    """On the closing axis both fingertips are on the box; the approach is at a right angle, and no finger is below."""
    found = grasps_of((0.03, 0.05, 0.12))
    assert 4 <= len(found) <= MOST
    for grasp in found:
        axes = matrix(grasp.quat)
        assert np.abs(axes[:, 1]).max() > 0.999
        across = np.abs(axes[:, 1]) @ np.array([0.03, 0.05, 0.12])
        np.testing.assert_allclose(grasp.width, across, atol=1e-6)
        off = np.abs(grasp.pos - [0, 0, 0.06])
        np.testing.assert_allclose(off[np.argmax(np.abs(axes[:, 1]))], 0.0, atol=1e-6)
        assert (grasp.pos + 0.009 * axes[:, 2])[2] > 0.0


def test_what_is_wider_than_the_hand_has_none():
    """A cube of 20 cm."""
    assert OPENING < 0.2
    assert grasps_of((0.2, 0.2, 0.2)) == []
