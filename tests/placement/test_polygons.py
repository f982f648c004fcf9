"""Hulls, clipping in place, areas and drawn points of convex polygons, against shapely."""

from collections.abc import Callable

import numpy as np
import pytest
import shapely
import warp as wp

from sceniris_gym.config.bounds import MAX_ANCHORS, MAX_CORNERS
from sceniris_gym.placement.polygons import HalfPlane, area, clip, convex_hull, draw_in_polygon, set_triangle

wp.set_module_options({"enable_backward": False})

_CORNERS = wp.constant(MAX_CORNERS)
# How many half-planes cut each triangle: of those through its corners few leave anything.
_PLANES = {"around the middle": 16, "through corners": 2, "along edges": 8}
_FAR = 10.0  # [m], of a half-plane's other sides


@wp.kernel
def _cut(
    triangle: wp.array2d[wp.vec2],
    normal: wp.array2d[wp.vec2],
    origin: wp.array2d[wp.vec2],
    offset: wp.array2d[float],
    u: wp.array[wp.vec3],
    num: wp.array[int],
    size: wp.array[float],
    corner: wp.array2d[wp.vec2],
    drawn: wp.array[wp.vec2],
):
    i = wp.tid()
    p = wp.zeros(shape=(_CORNERS,), dtype=wp.vec2)
    n = set_triangle(p, triangle[i, 0], triangle[i, 1], triangle[i, 2])
    for k in range(normal.shape[1]):
        if n > 0:
            n = clip(p, n, HalfPlane(normal[i, k], origin[i, k], offset[i, k]))
    num[i] = n
    size[i] = area(p, n)
    for k in range(n):
        corner[i, k] = p[k]
    if n > 2:
        drawn[i] = draw_in_polygon(p, n, u[i][0], u[i][1], u[i][2])


def _planes(kind: str, triangle: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals, origins and offsets of the half-planes for each triangle."""
    count, planes = len(triangle), _PLANES[kind]
    angle = rng.uniform(-np.pi, np.pi, size=(count, planes))
    origin = np.repeat(triangle.mean(axis=1, keepdims=True), planes, axis=1)
    offset = rng.uniform(0.05, 0.4, size=(count, planes))
    if kind == "through corners":
        origin = triangle[np.arange(count)[:, None], rng.integers(3, size=(count, planes))]
        offset = np.zeros((count, planes))
    if kind == "along edges":
        edge = rng.integers(3, size=(count, planes))
        origin = triangle[np.arange(count)[:, None], edge]
        along = triangle[np.arange(count)[:, None], (edge + 1) % 3] - origin
        side = np.where(rng.random((count, planes)) < 0.9, -1.0, 1.0)
        angle = np.arctan2(along[..., 1], along[..., 0]) + 0.5 * np.pi * side
        offset = rng.choice([0.0, 0.1], size=(count, planes))
    return np.stack((np.cos(angle), np.sin(angle)), axis=-1), origin, offset


def _half_plane(normal: np.ndarray, origin: np.ndarray, offset: float) -> shapely.Polygon:
    """As much of a half-plane as matters."""
    across = np.array([-normal[1], normal[0]])
    edge = origin + offset * normal
    a, b = edge - _FAR * across, edge + _FAR * across
    return shapely.Polygon([a, b, b - _FAR * normal, a - _FAR * normal])


@pytest.mark.parametrize("kind", _PLANES)
def test_clipped_polygons_are_those_of_shapely(kind: str):
    """Area and outline to 1e-5, with up to 16 half-planes; points lie inside."""
    rng = np.random.default_rng(11)
    count = 400
    triangle = rng.uniform(-1.0, 1.0, size=(count, 3, 2)).astype(np.float32)
    normal, origin, offset = (np.asarray(x, np.float32) for x in _planes(kind, triangle, rng))
    num, size, corner, drawn = (
        wp.zeros(count, dtype=int),
        wp.zeros(count, dtype=float),
        wp.zeros((count, MAX_CORNERS), dtype=wp.vec2),
        wp.zeros(count, dtype=wp.vec2),
    )
    given = [wp.array(x, dtype=wp.vec2) for x in (triangle, normal, origin)]
    u = wp.array(rng.random((count, 3)), dtype=wp.vec3)
    wp.launch(_cut, dim=count, inputs=[*given, wp.array(offset, dtype=float), u, num, size, corner, drawn])
    num, size, corner, drawn = (x.numpy() for x in (num, size, corner, drawn))
    for i in range(count):
        exact = shapely.Polygon(triangle[i])
        for plane in zip(normal[i], origin[i], offset[i], strict=True):
            exact = exact.intersection(_half_plane(*plane))
        assert size[i] == pytest.approx(exact.area, abs=1e-5)
        if exact.area > 1e-3:
            assert shapely.Polygon(corner[i, : num[i]]).symmetric_difference(exact).area < 1e-5
            assert exact.distance(shapely.Point(drawn[i])) < 1e-5
    if kind == "around the middle":
        assert num.max() > 8
    assert (size > 1e-3).any()


_POINTS = wp.constant(MAX_ANCHORS)


@wp.kernel
def _surround(given: wp.array2d[wp.vec2], num: wp.array[int], hull: wp.array2d[wp.vec2]):
    i = wp.tid()
    p = wp.zeros(shape=(_POINTS,), dtype=wp.vec2)
    for k in range(given.shape[1]):
        p[k] = given[i, k]
    num[i] = convex_hull(p, given.shape[1], hull[i])


def _fence(rng: np.random.Generator) -> np.ndarray:
    """Seven posts in a row, and one beside them."""
    return np.array([(0.2 * k, 0.0) for k in range(7)] + [(0.1, 0.5)])


def _grid(rng: np.random.Generator) -> np.ndarray:
    return 0.3 * np.array([(i, j) for i in range(4) for j in range(2)])


def _twins(rng: np.random.Generator) -> np.ndarray:
    """Five points, three of which are there twice."""
    points = rng.uniform(-1.0, 1.0, size=(5, 2))
    return np.concatenate([points, points[:3]])


def _near_twins(rng: np.random.Generator) -> np.ndarray:
    """Four points, each with another within rounding of it."""
    points = rng.uniform(-1.0, 1.0, size=(4, 2))
    return np.concatenate([points, points + 1e-7 * rng.normal(size=(4, 2))])


def _far(rng: np.random.Generator) -> np.ndarray:
    """Return points at which single precision is coarse."""
    return 90.0 + rng.uniform(-1.0, 1.0, size=(6, 2))


@pytest.mark.parametrize("make", [_fence, _grid, _twins, _near_twins, _far])
def test_hulls_are_those_of_shapely(make: Callable[[np.random.Generator], np.ndarray]):
    """Points in any order, turned by any angle, on lines or at one place: their outline, and no room beyond theirs."""
    rng = np.random.default_rng(5)
    rows = []
    for _ in range(1000):
        points, angle = rng.permutation(make(rng)), rng.uniform(0.0, 2.0 * np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        rows.append(points if make is _far else points @ turn.T)
    given = np.array(rows, np.float32)
    count, size = given.shape[:2]
    num, hull = wp.zeros(count, dtype=int), wp.full((count, size + 1), wp.vec2(7.0, 7.0), dtype=wp.vec2)
    wp.launch(_surround, dim=count, inputs=[wp.array(given, dtype=wp.vec2), num, hull])
    corners = hull.numpy()
    assert (corners[:, -1] == 7.0).all()
    for points, n, row in zip(given.astype(float), num.numpy(), corners.astype(float), strict=True):
        exact = shapely.MultiPoint(points).convex_hull
        found = shapely.Polygon(row[:n])
        assert found.exterior.is_ccw
        assert found.buffer(0).symmetric_difference(exact).area < 2e-6
