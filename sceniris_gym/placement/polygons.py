"""Small convex polygons on the device: around points, clipped by half-planes, measured, drawn from.

A polygon is a lane's own array of `MAX_CORNERS` corners [m], counter-clockwise, and how many of them count.
"""

import warp as wp

from sceniris_gym.config.limits import MAX_CORNERS


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
def _sort_by_height(points: wp.array[wp.vec2], num: int):
    """Sort points from low to high, those of one height from left to right."""
    for i in range(1, num):
        p = points[i]
        j = int(i)
        while j > 0:
            q = points[j - 1]
            if q[1] < p[1] or (q[1] == p[1] and q[0] <= p[0]):
                break
            points[j] = q
            j -= 1
        points[j] = p


@wp.func
def _turn_left(corners: wp.array[wp.vec2], first: int, base: int, num: int, p: wp.vec2) -> int:
    """Drop corners after number `base` until the way on to `p` turns left. Returns how many are left."""
    left = int(num)
    while left > base + 1:
        before = corners[first + left - 2]
        if cross2(corners[first + left - 1] - before, p - before) > 0.0:
            break
        left -= 1
    return left


@wp.func
def convex_hull(points: wp.array[wp.vec2], num: int, corners: wp.array[wp.vec2], first: int) -> int:
    """The convex hull of points, counter-clockwise from the lowest, into `corners` from `first` on.

    The points are sorted in their place. They may coincide or lie on lines, as long as they do not all lie on one.
    Returns the number of corners, at most `num`. A. Andrew, "Another efficient algorithm for convex hulls in two
    dimensions", Information Processing Letters 9(5), 1979; each side of the line from the lowest to the highest point
    is gone along by itself, so that no more room is needed than there are points.
    """
    _sort_by_height(points, num)
    lowest = points[0]
    highest = points[num - 1]
    corners[first] = lowest
    count = int(1)
    for i in range(1, num - 1):
        if cross2(highest - lowest, points[i] - lowest) < 0.0:
            count = _turn_left(corners, first, 0, count, points[i])
            corners[first + count] = points[i]
            count += 1
    count = _turn_left(corners, first, 0, count, highest)
    corners[first + count] = highest
    top = count
    count += 1
    for k in range(1, num - 1):
        i = num - 1 - k
        if cross2(highest - lowest, points[i] - lowest) > 0.0:
            count = _turn_left(corners, first, top, count, points[i])
            corners[first + count] = points[i]
            count += 1
    return _turn_left(corners, first, top, count, lowest)


@wp.func
def set_triangle(p: wp.array[wp.vec2], a: wp.vec2, b: wp.vec2, c: wp.vec2) -> int:
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
def clip(p: wp.array[wp.vec2], num: int, h: HalfPlane) -> int:
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
        if (leaves or enters) and left < MAX_CORNERS:
            p[left] = a + (b - a) * (ha / (ha - hb))
            left += 1
        if hb <= 0.0 and left < MAX_CORNERS:
            p[left] = b
            left += 1
        a = b
        ha = hb
        b = ahead
    return left


@wp.func
def area(p: wp.array[wp.vec2], num: int) -> float:
    """Area [m^2]."""
    total = float(0.0)
    for i in range(2, num):
        total += cross2(p[i - 1] - p[0], p[i] - p[0])
    return 0.5 * total


@wp.func
def draw_in_polygon(p: wp.array[wp.vec2], num: int, pick: float, u: float, v: float) -> wp.vec2:
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
