"""Whether points are spread evenly over a region: chi-square over cells of equal area."""

import numpy as np
import scipy.stats
import shapely
from shapely.geometry.base import BaseGeometry


def equal_cells(region: BaseGeometry, depth: int) -> list[BaseGeometry]:
    """Cut a region into 2^depth cells of one area, each time across its longer side."""
    if depth == 0:
        return [region]
    x0, y0, x1, y1 = region.bounds
    across_x = x1 - x0 >= y1 - y0
    low, high = (x0, x1) if across_x else (y0, y1)
    ends = low, high

    def below(cut: float) -> BaseGeometry:
        return region.intersection(shapely.box(x0, y0, *((cut, y1) if across_x else (x1, cut))))

    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if below(middle).area < region.area / 2 else (low, middle)
    rest = region.intersection(shapely.box(*((low, y0) if across_x else (x0, low)), x1, y1))
    assert ends[0] < low < ends[1]
    return equal_cells(below(low), depth - 1) + equal_cells(rest, depth - 1)


def p_value(points: np.ndarray, region: BaseGeometry, depth: int = 6) -> float:
    """Return the probability that points (n, 2) drawn uniformly from the region are spread as unevenly as these.

    Points that are outside of all cells count as one more cell in which none is expected, which gives 0.
    """
    counts = np.array(
        [shapely.contains_xy(cell, points[:, 0], points[:, 1]).sum() for cell in equal_cells(region, depth)]
    )
    if counts.sum() < 0.999 * len(points):  # what lies on a cut is in no cell
        return 0.0
    return float(scipy.stats.chisquare(counts).pvalue)
