"""Small convex polygons on the device: clipped by half-planes, measured, drawn from.

A polygon is a run of corners [m], counter-clockwise, in a lane's own array: where it begins, and how many of them
count. It has room for `MAX_CORNERS`.
"""

import warp as wp

from sceniris_gym.scene.limits import MAX_CORNERS

_MAX_CORNERS = wp.constant(MAX_CORNERS)


@wp.struct
class HalfPlane:
    """The points x with normal . (x - origin) <= offset."""

    normal: wp.vec2
    origin: wp.vec2
    offset: float


@wp.func
def half_plane(normal: wp.vec2, origin: wp.vec2, offset: float) -> HalfPlane:
    """The half-plane of these fields."""
    h = HalfPlane()
    h.normal = normal
    h.origin = origin
    h.offset = offset
    return h


@wp.func
def cross2(a: wp.vec2, b: wp.vec2) -> float:
    """The z component of the cross product of two plane vectors."""
    return a[0] * b[1] - a[1] * b[0]


@wp.func
def set_triangle(p: wp.array(dtype=wp.vec2), first: int, a: wp.vec2, b: wp.vec2, c: wp.vec2) -> int:
    """Put a triangle, turned counter-clockwise, into `p` from `first` on. Returns its number of corners."""
    p[first] = a
    if cross2(b - a, c - a) >= 0.0:
        p[first + 1] = b
        p[first + 2] = c
    else:
        p[first + 1] = c
        p[first + 2] = b
    return 3


@wp.func
def clip(p: wp.array(dtype=wp.vec2), first: int, num: int, h: HalfPlane, to: int) -> int:
    """Cut the polygon at `first` down to a half-plane, and put it at `to`. Returns how many corners are left.

    I. Sutherland, G. Hodgman, "Reentrant polygon clipping", CACM 17(1), 1974.
    """
    left = int(0)
    a = wp.vec2(0.0, 0.0)
    ha = float(0.0)
    if num > 0:
        a = p[first + num - 1]
        ha = wp.dot(h.normal, a - h.origin) - h.offset
    for i in range(num):
        b = p[first + i]
        hb = wp.dot(h.normal, b - h.origin) - h.offset
        if ((ha < 0.0 and hb > 0.0) or (ha > 0.0 and hb < 0.0)) and left < _MAX_CORNERS:
            p[to + left] = a + (b - a) * (ha / (ha - hb))
            left += 1
        if hb <= 0.0 and left < _MAX_CORNERS:
            p[to + left] = b
            left += 1
        a = b
        ha = hb
    return left


@wp.func
def area(p: wp.array(dtype=wp.vec2), first: int, num: int) -> float:
    """Area [m^2]."""
    total = float(0.0)
    for i in range(first + 2, first + num):
        total += cross2(p[i - 1] - p[first], p[i] - p[first])
    return 0.5 * total


@wp.func
def draw_in_polygon(p: wp.array(dtype=wp.vec2), first: int, num: int, pick: float, u: float, v: float) -> wp.vec2:
    """A uniform point from three uniform numbers: a triangle of the fan by area, then a point of it."""
    left = 2.0 * pick * area(p, first, num)
    chosen = first + num - 1
    for i in range(first + 2, first + num):
        part = cross2(p[i - 1] - p[first], p[i] - p[first])
        if left < part and i < chosen:
            chosen = i
        left -= part
    s = wp.sqrt(u)
    return (1.0 - s) * p[first] + s * (1.0 - v) * p[chosen - 1] + s * v * p[chosen]
