"""Evenness of points over a region: chi-square over cells of equal area."""

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


def shares(points: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """Return two numbers (n, 2) for each point (n, 2) that are uniform in [0, 1]^2 if it is uniform in its region (n,).

    The share of the area to the left of it, and that of the line through it, along y, which is below it (M. Rosenblatt,
    "Remarks on a multivariate transformation", Annals of Mathematical Statistics 23(3), 1952).
    """
    x0, y0, _, y1 = shapely.bounds(regions).T
    x, y = points.T
    left = shapely.area(shapely.intersection(regions, shapely.box(x0 - 1, y0 - 1, x, y1 + 1))) / shapely.area(regions)

    def length(top: np.ndarray) -> np.ndarray:
        ends = np.stack([np.stack([x, y0 - 1], 1), np.stack([x, top], 1)], 1)
        return shapely.length(shapely.intersection(regions, shapely.linestrings(ends)))

    return np.stack([left, length(y) / length(y1 + 1)], 1)


def turned_back(points: np.ndarray, regions: np.ndarray, headings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, 2) and regions (n,) turned by minus the headings (n,) [rad] about the origin."""
    coordinates, row = shapely.get_coordinates(regions, return_index=True)

    def turn(x: np.ndarray, angle: np.ndarray) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([c * x[:, 0] + s * x[:, 1], c * x[:, 1] - s * x[:, 0]], 1)

    return turn(points, headings), shapely.set_coordinates(regions.copy(), turn(coordinates, headings[row]))


def spread_p_value(points: np.ndarray, regions: np.ndarray, cells: int = 5) -> float:
    """Return the probability that points, each uniform in a region of its own, are spread as unevenly as these.

    By chi-square over `cells` x `cells` parts of equal area of the regions. A point that is outside of its region by
    more than 0.5 mm (the arcs of the regions are polygons) gives 0.
    """
    if shapely.distance(regions, shapely.points(points)).max() > 5e-4:
        return 0.0
    counts, _, _ = np.histogram2d(*shares(points, regions).T, bins=cells, range=[[0, 1], [0, 1]])
    return float(scipy.stats.chisquare(counts.ravel()).pvalue)


def grid_p_value(points: np.ndarray, region: BaseGeometry, n: int = 8) -> float:
    """Return the p value of a chi-square test of points (n, 2) over the cells that a grid cuts the region into."""
    assert shapely.covers(region.buffer(1e-6), shapely.points(points)).all()
    x0, y0, x1, y1 = region.bounds
    xs, ys = np.linspace(x0, x1, n + 1), np.linspace(y0, y1, n + 1)
    cells = [shapely.box(xs[i], ys[j], xs[i + 1], ys[j + 1]) for i in range(n) for j in range(n)]
    share = shapely.area(shapely.intersection(cells, region)) / region.area
    i, j = (
        np.clip(np.searchsorted(s, p, side="right") - 1, 0, n - 1) for s, p in ((xs, points[:, 0]), (ys, points[:, 1]))
    )
    count = np.bincount(i * n + j, minlength=n * n)
    small = share * len(points) < 8
    expected = np.append(share[~small], share[small].sum()) * len(points)
    observed = np.append(count[~small], count[small].sum())
    keep = expected > 1e-6
    return float(scipy.stats.chisquare(observed[keep], expected[keep]).pvalue)
