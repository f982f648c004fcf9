"""Placed objects as relations use them: pivot, heading and bounds, seen from above."""

import warp as wp

from sceniris_gym.device.transforms import unit_circle


@wp.struct
class Placed:
    """An object seen from above: its pivot [m], its x axis, and its bounds [m].

    The bounds are relative to the pivot, and their x axis is the object's x axis.
    """

    at: wp.vec2
    axis: wp.vec2
    low: wp.vec2
    high: wp.vec2


@wp.func
def placed(at: wp.vec2, heading: float, bounds: wp.vec4) -> Placed:
    """Return an object as `Placed`, from its pivot [m], heading [rad] and bounds (low x, low y, high x, high y) [m]."""
    return Placed(at, unit_circle(heading), wp.vec2(bounds[0], bounds[1]), wp.vec2(bounds[2], bounds[3]))


@wp.func
def is_there(present: wp.array[int], column: int) -> bool:
    """Return whether the object of a column is present in its world.

    `present` has a column for each slot. Later columns stand for objects with variants, which are always present.
    """
    if column < present.shape[0]:
        return present[column] != 0
    return True


@wp.func
def rotated_to(v: wp.vec2, to: wp.vec2) -> wp.vec2:
    """Return a plane vector after the rotation that takes the x axis to the unit vector `to`."""
    return wp.vec2(to[0] * v[0] - to[1] * v[1], to[1] * v[0] + to[0] * v[1])


@wp.func
def rotated(v: wp.vec2, angle: float) -> wp.vec2:
    """Return a plane vector rotated counter-clockwise by `angle` [rad]."""
    return rotated_to(v, unit_circle(angle))


@wp.func
def bounds_corner(p: Placed, i: int) -> wp.vec2:
    """Return corner `i` (0 to 3, counter-clockwise) of an object's bounds in the world frame [m]."""
    x = p.low[0]
    y = p.low[1]
    if i == 1 or i == 2:
        x = p.high[0]
    if i >= 2:
        y = p.high[1]
    return p.at + rotated_to(wp.vec2(x, y), p.axis)


@wp.func
def bounds_radius(p: Placed) -> float:
    """Return the distance [m] from the pivot to the furthest corner of the bounds."""
    x = wp.max(wp.abs(p.low[0]), wp.abs(p.high[0]))
    y = wp.max(wp.abs(p.low[1]), wp.abs(p.high[1]))
    return wp.sqrt(x * x + y * y)


@wp.func
def bounds_extent(p: Placed, direction: wp.vec2) -> wp.vec2:
    """Return the least and greatest coordinate [m] of the bounds along a unit vector, relative to the pivot."""
    low = float(1.0e30)
    high = float(-1.0e30)
    for i in range(4):
        along = wp.dot(bounds_corner(p, i) - p.at, direction)
        low = wp.min(low, along)
        high = wp.max(high, along)
    return wp.vec2(low, high)


@wp.func
def _outside_sq(p: Placed, x: wp.vec2) -> float:
    """Return the squared distance [m^2] of a point from the bounds, or 0 for a point inside."""
    local = rotated_to(x - p.at, wp.vec2(p.axis[0], -p.axis[1]))
    dx = wp.max(wp.max(p.low[0] - local[0], local[0] - p.high[0]), 0.0)
    dy = wp.max(wp.max(p.low[1] - local[1], local[1] - p.high[1]), 0.0)
    return dx * dx + dy * dy


@wp.func
def bounds_offset(p: Placed) -> float:
    """Return the distance [m] of an object's pivot from its bounds, or 0 if the pivot is inside the bounds.

    The pivot is outside if drawn joint positions have moved all geometry away from it.
    """
    return wp.sqrt(_outside_sq(p, p.at))


@wp.func
def _apart_along(a: Placed, b: Placed, direction: wp.vec2) -> bool:
    """Test whether there is a gap between the bounds of two objects along a unit vector."""
    shift = wp.dot(b.at - a.at, direction)
    ea = bounds_extent(a, direction)
    eb = bounds_extent(b, direction)
    return ea[1] < shift + eb[0] or shift + eb[1] < ea[0]


@wp.func
def bounds_distance(a: Placed, b: Placed) -> float:
    """Return the distance [m] between the bounds of two objects, seen from above, or 0 if the bounds overlap.

    Two convex polygons that do not overlap are closest at a corner of one of them, so the corners are compared.
    """
    apart = (
        _apart_along(a, b, a.axis)
        or _apart_along(a, b, wp.vec2(-a.axis[1], a.axis[0]))
        or _apart_along(a, b, b.axis)
        or _apart_along(a, b, wp.vec2(-b.axis[1], b.axis[0]))
    )
    if not apart:
        return 0.0
    best = float(1.0e30)
    for i in range(4):
        best = wp.min(best, wp.min(_outside_sq(a, bounds_corner(b, i)), _outside_sq(b, bounds_corner(a, i))))
    return wp.sqrt(best)
