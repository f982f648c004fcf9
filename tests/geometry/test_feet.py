"""Feet: what of an underside carries an object, by closed forms."""

from __future__ import annotations

import numpy as np
import trimesh
from shapely.geometry import MultiPoint

from sceniris_gym.geometry.feet import around, foot

LEAN = np.sin(np.radians(2.5))


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the corners of a box [m] that stands on its lowest face at a point."""
    return np.array([[a * x, b * y, c * z] for a in (-1, 1) for b in (-1, 1) for c in (0, 1)]) + at


def test_a_box_stands_on_the_corners_of_its_face():
    """Four of them, counter-clockwise."""
    (corners,), curved = foot([box(0.03, 0.02, 0.1)], 0.05)
    assert not curved
    assert {tuple(c) for c in corners} == {(a, b) for a in (-0.03, 0.03) for b in (-0.02, 0.02)}
    x, y = corners.T
    assert (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2 == 4 * 0.03 * 0.02


def test_a_table_stands_on_its_legs_and_not_on_its_top():
    """Each leg is a part; a leg that ends 1 mm higher, but within the others' reach, is none."""
    legs = [box(0.005, 0.005, 0.1, (x, y, 0.0)) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    short, top = box(0.005, 0.005, 0.1, (0.0, 0.0, 0.001)), box(0.2, 0.2, 0.01, (0.0, 0.0, 0.1))
    parts, curved = foot([top, *legs, short], 0.08)
    assert not curved
    np.testing.assert_allclose([p.mean(axis=0) for p in parts], [leg.mean(axis=0)[:2] for leg in legs])


def test_a_leg_that_touches_as_the_whole_leans_carries():
    """One of four legs is 2 mm short, which 2.5 degrees over 20 cm make up for."""
    legs = [box(0.005, 0.005, 0.1, (x, y, 0.002 * (x > 0 and y > 0))) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    assert len(foot(legs, 0.05)[0]) == 4


def test_a_ball_stands_on_a_disc_in_which_its_centre_may_be_off():
    """Its radius is that of the ball times the sine of the angle of rocking."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.04)
    (corners,), curved = foot([ball.vertices + [0.0, 0.0, 0.04]], 0.04)
    assert curved
    radius = np.linalg.norm(corners, axis=1)
    assert (radius > 0.9 * 0.04 * LEAN).all()
    assert (radius < 2.1 * 0.04 * LEAN).all()


def test_a_cylinder_on_its_end_is_round_and_flat():
    """Its foot has nearly the area of the disc, from the inside."""
    end = trimesh.creation.cylinder(0.05, 0.1, sections=64).vertices + [0.0, 0.0, 0.05]
    (corners,), curved = foot([end], 0.05)
    assert not curved
    assert 0.97 < MultiPoint(corners).convex_hull.area / (np.pi * 0.05**2) < 1.0


def test_directions_go_all_around():
    """They are unit vectors with equal angles between them."""
    found = around(32)
    np.testing.assert_allclose((found * np.roll(found, 1, axis=0)).sum(axis=1), np.cos(2 * np.pi / 32))
