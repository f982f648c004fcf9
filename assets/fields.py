"""Solids from signed distance fields (negative inside): rounded bodies that blend, like cast housings."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import manifold3d
import numpy as np

Point = tuple[float, float, float]
# The distances [m] of points with coordinates x, y and z [m], three arrays of one shape.
Field = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def length_of(*components: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors. NumPy's have other last bits, which alter the meshes that ship."""
    return np.array(list(map(math.hypot, *(part.tolist() for part in components))))


def rod(start: Point, end: Point, radius: float, tip: float | None = None, edge: float = 0.012) -> Field:
    """A round bar from ``start`` to ``end`` [m], tapered from ``radius`` to ``tip``, with rims rounded by ``edge``."""
    length = math.dist(start, end)
    ax, ay, az = start
    ux, uy, uz = ((b - a) / length for a, b in zip(start, end, strict=True))
    slope = ((radius if tip is None else tip) - radius) / length

    def distance(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        x, y, z = x - ax, y - ay, z - az
        along = x * ux + y * uy + z * uz
        across = np.sqrt(np.maximum(x * x + y * y + z * z - along * along, 0.0))
        side = across - (radius + slope * np.clip(along, 0.0, length)) + edge
        ends = np.abs(along - 0.5 * length) - 0.5 * length + edge
        outside = length_of(np.maximum(side, 0.0), np.maximum(ends, 0.0))
        return outside + np.minimum(np.maximum(side, ends), 0.0) - edge

    return distance


def block(low: Point, high: Point, edge: float) -> Field:
    """A box between two corners [m] with edges rounded by ``edge``."""
    cx, cy, cz = (0.5 * (a + b) for a, b in zip(low, high, strict=True))
    hx, hy, hz = (0.5 * (b - a) - edge for a, b in zip(low, high, strict=True))

    def distance(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        x, y, z = np.abs(x - cx) - hx, np.abs(y - cy) - hy, np.abs(z - cz) - hz
        outside = length_of(*np.maximum([x, y, z], 0.0))
        return outside + np.minimum(np.maximum(np.maximum(x, y), z), 0.0) - edge

    return distance


def flow(fields: Sequence[Field], fillet: float) -> Field:
    """Union of all fields, with fillets of about ``fillet`` [m] (a polynomial smooth minimum)."""

    def distance(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        value = fields[0](x, y, z)
        for field in fields[1:]:
            other = field(x, y, z)
            overlap = np.maximum(fillet - np.abs(value - other), 0.0)
            value = np.minimum(value, other) - 0.25 * overlap * overlap / fillet
        return value

    return distance


@functools.lru_cache(maxsize=1)  # a link's housing and pieces have the same points
def grid(bounds: tuple[float, ...], edge: float) -> np.ndarray:
    """Return the points (3, n) [m] at which Manifold samples any field, in its order."""
    asked: list[Point] = []

    def ask(x: float, y: float, z: float) -> float:
        asked.append((x, y, z))
        return -1.0

    manifold3d.Manifold.level_set(ask, bounds, edge)
    return np.array(asked).T


def carve(field: Field, low: Point, high: Point, edge: float, tolerance: float) -> manifold3d.Manifold:
    """The solid where ``field`` is negative, within the corners ``low`` and ``high`` [m].

    Triangles have sides of about ``edge`` [m]. Flat areas are then simplified within ``tolerance`` [m].
    """
    bounds = (*low, *high)
    depths = iter((-field(*grid(bounds, edge))).tolist())
    return manifold3d.Manifold.level_set(lambda *_: next(depths), bounds, edge).simplify(tolerance)
