"""Where the objects of a world stand: what relations see of those that were placed before."""

import warp as wp

from sceniris_gym.layout.transforms import unit_circle


@wp.struct
class Placed:
    """One object seen from above: its pivot [m], its heading [rad], and its bounds in that heading around the pivot."""

    at: wp.vec2
    heading: float
    low: wp.vec2
    high: wp.vec2


@wp.func
def turned(v: wp.vec2, angle: float) -> wp.vec2:
    """A plane vector turned counter-clockwise by `angle` [rad]."""
    to = unit_circle(angle)
    return wp.vec2(to[0] * v[0] - to[1] * v[1], to[1] * v[0] + to[0] * v[1])


@wp.func
def bounds_corner(p: Placed, i: int) -> wp.vec2:
    """Corner `i` (0 to 3, counter-clockwise) of an object's bounds in the world."""
    x = p.low[0]
    y = p.low[1]
    if i == 1 or i == 2:
        x = p.high[0]
    if i >= 2:
        y = p.high[1]
    return p.at + turned(wp.vec2(x, y), p.heading)


@wp.func
def bounds_radius(p: Placed) -> float:
    """Distance [m] from the pivot to the furthest corner of the bounds."""
    x = wp.max(wp.abs(p.low[0]), wp.abs(p.high[0]))
    y = wp.max(wp.abs(p.low[1]), wp.abs(p.high[1]))
    return wp.sqrt(x * x + y * y)


@wp.func
def bounds_extent(p: Placed, direction: wp.vec2) -> wp.vec2:
    """Least and greatest extent [m] of the bounds along a unit vector, counted from the pivot."""
    low = float(1.0e30)
    high = float(-1.0e30)
    for i in range(4):
        along = wp.dot(bounds_corner(p, i) - p.at, direction)
        low = wp.min(low, along)
        high = wp.max(high, along)
    return wp.vec2(low, high)


@wp.func
def _outside_sq(p: Placed, x: wp.vec2) -> float:
    """Squared distance of a point from the bounds, 0 inside."""
    local = turned(x - p.at, -p.heading)
    dx = wp.max(wp.max(p.low[0] - local[0], local[0] - p.high[0]), 0.0)
    dy = wp.max(wp.max(p.low[1] - local[1], local[1] - p.high[1]), 0.0)
    return dx * dx + dy * dy


@wp.func
def bounds_offset(p: Placed) -> float:
    """How far [m] the pivot is outside of the bounds, where drawn joints carried all of an object away from it."""
    return wp.sqrt(_outside_sq(p, p.at))


@wp.func
def _apart_along(a: Placed, b: Placed, direction: wp.vec2) -> bool:
    shift = wp.dot(b.at - a.at, direction)
    ea = bounds_extent(a, direction)
    eb = bounds_extent(b, direction)
    return ea[1] < shift + eb[0] or shift + eb[1] < ea[0]


@wp.func
def bounds_distance(a: Placed, b: Placed) -> float:
    """Distance [m] of two bounds seen from above; 0 if they overlap.

    Two convex polygons that are apart are closest at a corner of one of them.
    """
    axis_a = turned(wp.vec2(1.0, 0.0), a.heading)
    axis_b = turned(wp.vec2(1.0, 0.0), b.heading)
    apart = (
        _apart_along(a, b, axis_a)
        or _apart_along(a, b, wp.vec2(-axis_a[1], axis_a[0]))
        or _apart_along(a, b, axis_b)
        or _apart_along(a, b, wp.vec2(-axis_b[1], axis_b[0]))
    )
    if not apart:
        return 0.0
    best = float(1.0e30)
    for i in range(4):
        best = wp.min(best, wp.min(_outside_sq(a, bounds_corner(b, i)), _outside_sq(b, bounds_corner(a, i))))
    return wp.sqrt(best)
