"""Small convex polygons on the device: clipped by half-planes, measured, drawn from.

A polygon is a lane's own array of `MAX_CORNERS` corners [m], counter-clockwise, and how many of them count.
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
def set_triangle(p: wp.array(dtype=wp.vec2), a: wp.vec2, b: wp.vec2, c: wp.vec2) -> int:
    """Make `p` a triangle, turned counter-clockwise. Returns its number of corners."""
    p[0] = a
    if cross2(b - a, c - a) >= 0.0:
        p[1] = b
        p[2] = c
    else:
        p[1] = c
        p[2] = b
    return 3


@wp.func
def clip(p: wp.array(dtype=wp.vec2), num: int, h: HalfPlane) -> int:
    """Cut `p` down to a half-plane, in its place. Returns the number of corners that are left.

    I. Sutherland, G. Hodgman, "Reentrant polygon clipping", CACM 17(1), 1974. A convex polygon enters a half-plane at
    most once, so never more than one corner too many is written, and reading one ahead suffices. Where rounding has it
    enter twice, the second entrance is left out.
    """
    left = int(0)
    a = p[wp.max(num - 1, 0)]
    ha = wp.dot(h.normal, a - h.origin) - h.offset
    b = p[0]
    for i in range(num):
        ahead = p[wp.min(i + 1, num - 1)]
        hb = wp.dot(h.normal, b - h.origin) - h.offset
        leaves = ha < 0.0 and hb > 0.0
        enters = ha > 0.0 and hb < 0.0 and left <= i
        if (leaves or enters) and left < _MAX_CORNERS:
            p[left] = a + (b - a) * (ha / (ha - hb))
            left += 1
        if hb <= 0.0 and left < _MAX_CORNERS:
            p[left] = b
            left += 1
        a = b
        ha = hb
        b = ahead
    return left


@wp.func
def area(p: wp.array(dtype=wp.vec2), num: int) -> float:
    """Area [m^2]."""
    total = float(0.0)
    for i in range(2, num):
        total += cross2(p[i - 1] - p[0], p[i] - p[0])
    return 0.5 * total


@wp.func
def draw_in_polygon(p: wp.array(dtype=wp.vec2), num: int, pick: float, u: float, v: float) -> wp.vec2:
    """A uniform point from three uniform numbers: a triangle of the fan by area, then a point of it."""
    left = 2.0 * pick * area(p, num)
    chosen = num - 1
    for i in range(2, num):
        part = cross2(p[i - 1] - p[0], p[i] - p[0])
        if left < part and i < chosen:
            chosen = i
        left -= part
    s = wp.sqrt(u)
    return (1.0 - s) * p[0] + s * (1.0 - v) * p[chosen - 1] + s * v * p[chosen]
