"""Feet: what of an underside carries an object, by closed forms."""

from __future__ import annotations

import numpy as np
import trimesh
from shapely.geometry import MultiPoint

from sceniris_gym.geometry.feet import around, curved_foot, flat_foot

LEAN = np.radians(2.5)


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the corners of a box [m] that stands on its lowest face at a point."""
    return np.array([[a * x, b * y, c * z] for a in (-1, 1) for b in (-1, 1) for c in (0, 1)]) + at


def test_a_box_stands_on_the_corners_of_its_face():
    """Four of them, counter-clockwise."""
    (corners,) = flat_foot([box(0.03, 0.02, 0.1)])
    assert {tuple(c) for c in corners} == {(a, b) for a in (-0.03, 0.03) for b in (-0.02, 0.02)}
    x, y = corners.T
    assert (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2 == 4 * 0.03 * 0.02


def test_a_table_stands_on_its_legs_and_not_on_its_top():
    """Each leg is a part; a leg that ends 1 mm higher, but within the others' reach, is none."""
    legs = [box(0.005, 0.005, 0.1, (x, y, 0.0)) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    short, top = box(0.005, 0.005, 0.1, (0.0, 0.0, 0.001)), box(0.2, 0.2, 0.01, (0.0, 0.0, 0.1))
    parts = flat_foot([top, *legs, short])
    np.testing.assert_allclose([p.mean(axis=0) for p in parts], [leg.mean(axis=0)[:2] for leg in legs])


def test_a_leg_that_touches_as_the_whole_leans_carries():
    """One of four legs is 2 mm short, which 2.5 degrees over 20 cm make up for."""
    legs = [box(0.005, 0.005, 0.1, (x, y, 0.002 * (x > 0 and y > 0))) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    assert len(flat_foot(legs)) == 4


def test_what_touches_after_a_long_way_carries_nothing():
    """One leg of a table of 2 m is 2 cm short, which 2.5 degrees would make up for; it moves by far more than 3 mm."""
    legs = [box(0.05, 0.05, 0.7, (x, y, 0.02 * (x > 0 and y > 0))) for x in (-1, 1) for y in (-1, 1)]
    assert len(flat_foot(legs)) == 3


def test_the_foot_of_a_ball_is_curved():
    """It has no flat foot."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.04)
    assert flat_foot([ball.vertices + [0.0, 0.0, 0.04]]) == []


def test_a_curved_foot_has_the_radius_of_curvature_times_the_tangent_of_half_the_lean():
    """For a ball in all directions, and for a capsule that lies along y from its axis to both sides and both ends."""
    ball = curved_foot(lambda up: 0.04 * (up[:, 2] - np.linalg.norm(up, axis=1)), LEAN)
    np.testing.assert_allclose(np.linalg.norm(ball, axis=1), 0.04 * np.tan(LEAN / 2), rtol=1e-3)
    capsule = curved_foot(lambda up: 0.04 * (up[:, 2] - 1.0) - 0.1 * np.abs(up[:, 1]), LEAN)
    low, high = capsule.min(axis=0), capsule.max(axis=0)
    np.testing.assert_allclose(high, [0.04 * np.tan(LEAN / 2), 0.1 + 0.04 * np.tan(LEAN / 2)], rtol=0.01)
    np.testing.assert_allclose(low, -high, rtol=0.01)


def test_a_roller_is_as_narrow_as_it_is_round():
    """A cylinder on its side reaches its radius times the tangent of half the lean to both sides."""
    axis = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    across = np.array([-axis[1], axis[0], 0.0])

    def lowest(up: np.ndarray) -> np.ndarray:
        along = up @ axis
        return 0.04 * up[:, 2] - 0.04 * np.sqrt(1.0 - along**2) - 0.05 * np.abs(along)

    found = curved_foot(lowest, LEAN) @ across[:2]
    np.testing.assert_allclose([found.min(), found.max()], 0.04 * np.tan(LEAN / 2) * np.array([-1, 1]), rtol=0.02)


def test_a_cylinder_on_its_end_is_round_and_flat():
    """Its foot has nearly the area of the disc, from the inside."""
    end = trimesh.creation.cylinder(0.05, 0.1, sections=64).vertices + [0.0, 0.0, 0.05]
    (corners,) = flat_foot([end])
    assert 0.97 < MultiPoint(corners).convex_hull.area / (np.pi * 0.05**2) < 1.0


def test_directions_go_all_around():
    """They are unit vectors with equal angles between them."""
    found = around(32)
    np.testing.assert_allclose((found * np.roll(found, 1, axis=0)).sum(axis=1), np.cos(2 * np.pi / 32))
