"""Small convex polygons on the device: hulls of points, clipping by half-planes, areas, and random points.

A polygon is an array of counter-clockwise corners [m] and the number of corners in use. A single lane uses the array.
"""

import warp as wp


@wp.struct
class HalfPlane:
    """The points x with normal . (x - origin) <= offset."""

    normal: wp.vec2
    origin: wp.vec2
    offset: float


@wp.func
def cross2(a: wp.vec2, b: wp.vec2) -> float:
    """Return the z component of the cross product of two plane vectors."""
    return a[0] * b[1] - a[1] * b[0]


@wp.func
def _sort_by_height(points: wp.array[wp.vec2], num: int):
    """Sort points in place by y, then by x."""
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
def _turn_left(corners: wp.array[wp.vec2], base: int, num: int, p: wp.vec2) -> int:
    """Drop corners from the end of a path until the path would turn left at its last corner to reach `p`.

    Corners with index `base` or lower are kept. Returns the number of remaining corners.
    """
    left = int(num)
    while left > base + 1:
        before = corners[left - 2]
        if cross2(corners[left - 1] - before, p - before) > 0.0:
            break
        left -= 1
    return left


@wp.func
def convex_hull(points: wp.array[wp.vec2], num: int, corners: wp.array[wp.vec2]) -> int:
    """Write the convex hull of `num` points to `corners`, counter-clockwise from the lowest point.

    The function sorts `points` in place. Some points may coincide or lie on a line, but the points must not all lie on
    one line. Returns the number of corners, at most `num`.

    A. Andrew, "Another efficient algorithm for convex hulls in two dimensions", Information Processing Letters 9(5),
    1979. The line from the lowest to the highest point has corners of the hull on both sides. The function finds the
    corners on one side, then the corners on the other, so an array of `num` corners is always large enough.
    """
    _sort_by_height(points, num)
    lowest = points[0]
    highest = points[num - 1]
    corners[0] = lowest
    count = int(1)
    for i in range(1, num - 1):
        if cross2(highest - lowest, points[i] - lowest) < 0.0:
            count = _turn_left(corners, 0, count, points[i])
            corners[count] = points[i]
            count += 1
    count = _turn_left(corners, 0, count, highest)
    corners[count] = highest
    top = count
    count += 1
    for k in range(1, num - 1):
        i = num - 1 - k
        if cross2(highest - lowest, points[i] - lowest) > 0.0:
            count = _turn_left(corners, top, count, points[i])
            corners[count] = points[i]
            count += 1
    return _turn_left(corners, top, count, lowest)


@wp.func
def set_triangle(p: wp.array[wp.vec2], a: wp.vec2, b: wp.vec2, c: wp.vec2) -> int:
    """Write triangle abc to `p` with its corners counter-clockwise. Return 3, the number of corners in use."""
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
    """Clip polygon `p` by a half-plane in place, and return the number of remaining corners.

    I. Sutherland, G. Hodgman, "Reentrant polygon clipping", CACM 17(1), 1974. A convex polygon enters a half-plane at
    most once, so the number of corners written is at most one above the number of corners read. One corner is read in
    advance, so no corner is overwritten before it is read. If rounding makes the polygon enter twice, the second entry
    is ignored.
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
        if (leaves or enters) and left < p.shape[0]:
            p[left] = a + (b - a) * (ha / (ha - hb))
            left += 1
        if hb <= 0.0 and left < p.shape[0]:
            p[left] = b
            left += 1
        a = b
        ha = hb
        b = ahead
    return left


@wp.func
def area(p: wp.array[wp.vec2], num: int) -> float:
    """Return the area [m^2] of a polygon."""
    total = float(0.0)
    for i in range(2, num):
        total += cross2(p[i - 1] - p[0], p[i] - p[0])
    return 0.5 * total


@wp.func
def draw_in_polygon(p: wp.array[wp.vec2], num: int, pick: float, u: float, v: float) -> wp.vec2:
    """Return a uniformly distributed point of the polygon with the `num` corners `p`.

    `pick`, `u` and `v` are uniform random numbers. The fan of triangles around the first corner fills the polygon:
    `pick` chooses one of these triangles, and `u` and `v` choose a point in it.
    """
    left = 2.0 * pick * area(p, num)
    chosen = num - 1
    for i in range(2, num):
        part = cross2(p[i - 1] - p[0], p[i] - p[0])
        if left < part and i < chosen:
            chosen = i
        left -= part
    s = wp.sqrt(u)
    return (1.0 - s) * p[0] + s * (1.0 - v) * p[chosen - 1] + s * v * p[chosen]
