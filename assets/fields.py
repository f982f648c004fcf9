"""Solids from signed distance fields (negative inside): rounded bodies that blend, like cast housings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import manifold3d
import numpy as np

Point = tuple[float, float, float]
Field = Callable[[float, float, float], float]


def rod(start: Point, end: Point, radius: float, tip: float | None = None, edge: float = 0.012) -> Field:
    """A round bar from ``start`` to ``end`` [m], tapered from ``radius`` to ``tip``, with rims rounded by ``edge``."""
    length = math.dist(start, end)
    ax, ay, az = start
    ux, uy, uz = ((b - a) / length for a, b in zip(start, end, strict=True))
    slope = ((radius if tip is None else tip) - radius) / length

    def distance(x: float, y: float, z: float) -> float:
        x, y, z = x - ax, y - ay, z - az
        along = x * ux + y * uy + z * uz
        across = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
        side = across - (radius + slope * min(max(along, 0.0), length)) + edge
        ends = abs(along - 0.5 * length) - 0.5 * length + edge
        return math.hypot(max(side, 0.0), max(ends, 0.0)) + min(max(side, ends), 0.0) - edge

    return distance


def block(low: Point, high: Point, edge: float) -> Field:
    """A box between two corners [m] with edges rounded by ``edge``."""
    cx, cy, cz = (0.5 * (a + b) for a, b in zip(low, high, strict=True))
    hx, hy, hz = (0.5 * (b - a) - edge for a, b in zip(low, high, strict=True))

    def distance(x: float, y: float, z: float) -> float:
        x, y, z = abs(x - cx) - hx, abs(y - cy) - hy, abs(z - cz) - hz
        return math.hypot(max(x, 0.0), max(y, 0.0), max(z, 0.0)) + min(max(x, y, z), 0.0) - edge

    return distance


def flow(fields: Sequence[Field], fillet: float) -> Field:
    """Union of all fields, with fillets of about ``fillet`` [m] (a polynomial smooth minimum)."""

    def distance(x: float, y: float, z: float) -> float:
        value = fields[0](x, y, z)
        for field in fields[1:]:
            other = field(x, y, z)
            overlap = max(fillet - abs(value - other), 0.0)
            value = min(value, other) - 0.25 * overlap * overlap / fillet
        return value

    return distance


def carve(
    field: Field, low: Sequence[float], high: Sequence[float], edge: float, tolerance: float
) -> manifold3d.Manifold:
    """The solid where ``field`` is negative, within the corners ``low`` and ``high`` [m].

    Triangles have sides of about ``edge`` [m]. Flat areas are then simplified within ``tolerance`` [m].
    """
    body = manifold3d.Manifold.level_set(
        lambda x, y, z: -field(x, y, z), [*np.asarray(low, float), *np.asarray(high, float)], edge
    )
    return body.simplify(tolerance)
