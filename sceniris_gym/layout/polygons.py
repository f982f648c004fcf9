"""Small convex polygons on the device: clipped by half-planes, measured, drawn from."""

import warp as wp

from sceniris_gym.scene.device import MAX_CORNERS

_Corners = wp.types.vector(length=2 * MAX_CORNERS, dtype=float)


@wp.struct
class Polygon:
    """Corners [m] in counter-clockwise order, xy one after the other."""

    corners: _Corners
    num: int


@wp.func
def corner(p: Polygon, i: int) -> wp.vec2:
    """Corner `i` of a polygon."""
    return wp.vec2(p.corners[2 * i], p.corners[2 * i + 1])


@wp.func
def push_corner(p: Polygon, c: wp.vec2) -> Polygon:
    """The polygon with one corner more."""
    if p.num < wp.static(MAX_CORNERS):
        p.corners[2 * p.num] = c[0]
        p.corners[2 * p.num + 1] = c[1]
        p.num += 1
    return p


@wp.func
def cross2(a: wp.vec2, b: wp.vec2) -> float:
    """The z component of the cross product of two plane vectors."""
    return a[0] * b[1] - a[1] * b[0]


@wp.func
def triangle(a: wp.vec2, b: wp.vec2, c: wp.vec2) -> Polygon:
    """A triangle as a polygon, turned counter-clockwise."""
    p = Polygon()
    p.num = int(0)
    p = push_corner(p, a)
    if cross2(b - a, c - a) >= 0.0:
        p = push_corner(p, b)
        p = push_corner(p, c)
    else:
        p = push_corner(p, c)
        p = push_corner(p, b)
    return p


@wp.func
def clip(p: Polygon, normal: wp.vec2, origin: wp.vec2, offset: float) -> Polygon:
    """The part of a convex polygon with normal . (x - origin) <= offset.

    I. Sutherland, G. Hodgman, "Reentrant polygon clipping", CACM 17(1), 1974.
    """
    q = Polygon()
    q.num = int(0)
    for i in range(p.num):
        a = corner(p, i)
        b = corner(p, (i + 1) % p.num)
        ha = wp.dot(normal, a - origin) - offset
        hb = wp.dot(normal, b - origin) - offset
        if ha <= 0.0:
            q = push_corner(q, a)
        if (ha < 0.0 and hb > 0.0) or (ha > 0.0 and hb < 0.0):
            q = push_corner(q, a + (b - a) * (ha / (ha - hb)))
    return q


@wp.func
def area(p: Polygon) -> float:
    """Area [m^2]."""
    total = float(0.0)
    for i in range(2, p.num):
        total += cross2(corner(p, i - 1) - corner(p, 0), corner(p, i) - corner(p, 0))
    return 0.5 * total


@wp.func
def draw_in_polygon(p: Polygon, pick: float, u: float, v: float) -> wp.vec2:
    """A uniform point from three uniform numbers: a triangle of the fan by area, then a point of it."""
    left = 2.0 * pick * area(p)
    chosen = p.num - 1
    for i in range(2, p.num):
        part = cross2(corner(p, i - 1) - corner(p, 0), corner(p, i) - corner(p, 0))
        if left < part and i < chosen:
            chosen = i
        left -= part
    s = wp.sqrt(u)
    return (1.0 - s) * corner(p, 0) + s * (1.0 - v) * corner(p, chosen - 1) + s * v * corner(p, chosen)
