"""The fit of convex parts: bounds that are known for simple shapes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from sceniris_gym.importers.things.fit import Measure, height_over
from tests.importers.things.shapes import box, cup


def test_a_box_fits_itself():
    """No error either way."""
    assert Measure(box()).fit([box()]).error < 1e-6


def test_a_part_that_sticks_out_is_beyond_by_as_much():
    """A box 10 mm too high."""
    high = box((0.04, 0.06, 0.12))
    fit = Measure(box()).fit([high])
    assert fit.beyond == pytest.approx(0.01, abs=1e-5)
    assert fit.bare < 1e-6


def test_a_part_that_is_too_small_leaves_the_mesh_bare():
    """The same the other way round; corners are farther off than faces."""
    fit = Measure(box()).fit([box((0.04, 0.06, 0.08))])
    assert fit.bare == pytest.approx(0.01, abs=1e-5)


def test_the_hull_of_a_cup_is_off_by_the_radius_of_its_hole():
    """The middle of the mouth is 34 mm from its rim."""
    assert Measure(cup()).fit([cup().convex_hull]).beyond == pytest.approx(0.034, rel=0.05)


def test_two_halves_leave_no_seam():
    """Where parts touch, they have no outside."""
    halves = [box((0.04, 0.06, 0.05)).apply_translation([0, 0, z]) for z in (-0.025, 0.025)]
    assert Measure(box()).fit(halves).error < 1e-6


@pytest.mark.parametrize(("gap", "error"), [(5e-5, 5e-5), (1e-3, 0.02)])
def test_a_sliver_between_parts_is_no_surface_of_theirs(gap: float, error: float):
    """Half a tenth of a millimetre within 10 cm is none; of a millimetre, the middle is 2 cm from the sides."""
    halves = [box((0.04, 0.06, 0.05 - gap / 2)).apply_translation([0, 0, z * (0.025 + gap / 4)]) for z in (-1, 1)]
    assert Measure(box()).fit(halves).error == pytest.approx(error, rel=0.1, abs=5e-5)


def test_heights_over_a_part_are_negative_inside():
    """A unit cube."""
    cube = trimesh.creation.box((1, 1, 1))
    np.testing.assert_allclose(height_over(cube, np.array([[0, 0, 0], [0, 0, 1.0]])), [-0.5, 0.5])
