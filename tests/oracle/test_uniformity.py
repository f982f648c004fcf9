"""The uniformity oracle, on points whose spread is known."""

import numpy as np
import pytest
import shapely

from tests.oracle.uniformity import equal_cells, p_value

RNG = np.random.default_rng(5)
ELL = shapely.Polygon([(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)])


def test_cells_have_one_area_and_cover_the_region():
    """A region that is not convex."""
    cells = equal_cells(ELL, 5)
    assert [cell.area for cell in cells] == pytest.approx([ELL.area / 32] * 32)
    assert shapely.union_all(cells).area == pytest.approx(ELL.area)


def test_even_points_pass_and_uneven_ones_fail():
    """Uniform points, points that thin out by a tenth over the region, and points beside it."""
    points = RNG.uniform([0, 0], [3, 2], (60000, 2))
    points = points[shapely.contains_xy(ELL, points[:, 0], points[:, 1])]
    assert p_value(points, ELL) > 0.001
    thinned = points[RNG.uniform(size=len(points)) > 0.1 * points[:, 0]]
    assert p_value(thinned, ELL) < 1e-6
    assert p_value(points + [0.5, 0.0], ELL) == 0.0
