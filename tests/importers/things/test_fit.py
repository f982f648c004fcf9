"""The fit of convex parts: bounds that are known for simple shapes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from sceniris_gym.importers.things.fit import Distances, Measure, height_over
from tests.importers.things.shapes import box, cup


def test_a_box_fits_itself():
    """No error either way."""
    assert Measure(box(), 0.002).error([box()]) < 1e-6


def test_a_part_that_sticks_out_is_beyond_by_as_much():
    """A box 10 mm too high."""
    high = box((0.04, 0.06, 0.12))
    measure = Measure(box(), 0.002)
    assert measure.error([high]) == measure.beyond(high, []) == pytest.approx(0.01, abs=1e-5)
    assert measure.bare([high]) < 1e-6


def test_a_part_that_is_too_small_leaves_the_mesh_bare():
    """The same the other way round; corners are farther off than faces."""
    measure, low = Measure(box(), 0.002), box((0.04, 0.06, 0.08))
    assert measure.error([low]) == measure.bare([low]) == pytest.approx(0.01, abs=1e-5)


def test_the_hull_of_a_cup_is_off_by_the_radius_of_its_hole():
    """The middle of the mouth is 34 mm from its rim."""
    assert Measure(cup(), 0.002).beyond(cup().convex_hull, []) == pytest.approx(0.034, rel=0.05)


def test_two_halves_leave_no_seam():
    """Parts have no outside where they touch."""
    halves = [box((0.04, 0.06, 0.05)).apply_translation([0, 0, z]) for z in (-0.025, 0.025)]
    assert Measure(box(), 0.002).error(halves) < 1e-6


@pytest.mark.parametrize(("gap", "error"), [(1e-3, 5e-4), (1.5e-3, 7.5e-4), (2.1e-3, 0.02)])
def test_a_gap_counts_where_a_ball_of_the_tolerance_fits_in(gap: float, error: float):
    """The surface within a gap is half of it away from a part; within one that counts, its middle is 2 cm away."""
    halves = [box((0.04, 0.06, 0.05 - gap / 2)).apply_translation([0, 0, z * (0.025 + gap / 4)]) for z in (-1, 1)]
    assert Measure(box(), 0.002).error(halves) == pytest.approx(error, rel=0.1)


def test_what_parts_fill_counts_where_the_ball_touches_it_from_outside():
    """Two halves fill a cup but for a gap of half a millimetre: their tops are as far off as that of its hull."""
    whole = cup().convex_hull
    corners = [whole.slice_plane([side * 2.5e-4, 0, 0], [side, 0, 0]).vertices for side in (-1, 1)]
    halves = [trimesh.convex.convex_hull(points) for points in corners]
    measure = Measure(cup(), 0.002)
    assert max(measure.beyond(*pair) for pair in ((halves[0], halves[1:]), (halves[1], halves[:1]))) == pytest.approx(
        0.034, rel=0.05
    )


def test_heights_over_a_part_are_negative_inside():
    """A unit cube."""
    cube = trimesh.creation.box((1, 1, 1))
    np.testing.assert_allclose(height_over(cube, np.array([[0, 0, 0], [0, 0, 1.0]])), [-0.5, 0.5])


def test_a_face_without_area_is_not_near_everything():
    """FCL takes the distance of any point from a needle to be 0."""
    vertices = np.concatenate([box().vertices, [[0.0, 0.0, 0.05], [0.01, 0.0, 0.05], [0.02, 0.0, 0.05]]])
    faces = np.concatenate([box().faces, [[8, 9, 10]]])
    assert Distances(vertices, faces).farthest(np.array([[0.0, 0.0, 0.15]]))[1] == pytest.approx(0.1, abs=1e-6)
