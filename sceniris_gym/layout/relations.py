"""Spatial relations as regions of the plane: convex pieces that hold them, and the exact test of a point.

A wedge with distances is cut into slices of at most 30 degrees, each held by four half-planes: two rays, a chord inside
the inner circle and a tangent outside the outer one. The slices do not overlap, so areas add up; the little that they
hold too much is drawn again after the exact test.
"""

import math

import warp as wp

from sceniris_gym.layout.placed import Placed, bounds_distance, bounds_extent, bounds_radius, turned
from sceniris_gym.layout.polygons import Polygon, clip, corner, cross2, push_corner
from sceniris_gym.scene.device import FRAME_SUPPORT, FRAME_WORLD, Program, RelationType

_SECTOR = wp.constant(int(RelationType.SECTOR))
_BETWEEN = wp.constant(int(RelationType.BETWEEN))
_FRAME_SUPPORT = wp.constant(FRAME_SUPPORT)
_FRAME_WORLD = wp.constant(FRAME_WORLD)
_PI = wp.constant(math.pi)
# Anchors whose hull is thinner than this [m] are collinear: a strip takes the hull's place.
_THIN = wp.constant(1.0e-3)
# Beside is a line; it is drawn as a strip of this half width [m], a fifth of what a violation would be.
_LINE = wp.constant(2.0e-5)


@wp.struct
class Sight:
    """What one relation comes to in one world.

    A sector: apex, direction of its axis and half angle [rad], circles [m]. A strip or a line: `apex` and the unit
    vector `along`, from `low` to `high` along it and `half` to both sides. A hull: its corners.
    """

    active: bool
    hull: Polygon
    apex: wp.vec2
    axis: float
    half_angle: float
    along: wp.vec2
    low: float
    high: float
    half: float


@wp.func
def load_placed(place: wp.array(dtype=wp.vec4), bounds: wp.array(dtype=wp.vec4), slot: int) -> Placed:
    """The object in a slot of one world, from (x, y, z, heading) and its bounds (low x, low y, high x, high y)."""
    p = Placed()
    p.at = wp.vec2(place[slot][0], place[slot][1])
    p.heading = place[slot][3]
    p.low = wp.vec2(bounds[slot][0], bounds[slot][1])
    p.high = wp.vec2(bounds[slot][2], bounds[slot][3])
    return p


@wp.func
def _hull(points: Polygon) -> Polygon:
    """The convex hull, counter-clockwise (R. Jarvis, Information Processing Letters 2(1), 1973)."""
    start = int(0)
    for i in range(1, points.num):
        a = corner(points, i)
        b = corner(points, start)
        if a[1] < b[1] or (a[1] == b[1] and a[0] < b[0]):
            start = i
    hull = Polygon()
    hull.num = int(0)
    at = start
    for _i in range(points.num):
        hull = push_corner(hull, corner(points, at))
        to = (at + 1) % points.num
        for j in range(points.num):
            if cross2(corner(points, to) - corner(points, at), corner(points, j) - corner(points, at)) < 0.0:
                to = j
        at = to
        if at == start:
            break
    return hull


@wp.func
def _between(program: Program, rel: int, points: Polygon) -> Sight:
    """The hull of the anchors, or a strip around the longest segment if they lie on a line."""
    s = Sight()
    s.active = points.num >= 2
    a = int(0)
    b = int(0)
    longest = float(0.0)
    for i in range(points.num):
        for j in range(i):
            length = wp.length(corner(points, i) - corner(points, j))
            if length > longest:
                longest = length
                a = i
                b = j
    s.apex = corner(points, a)
    s.along = wp.vec2(1.0, 0.0)
    if longest > 0.0:
        s.along = (corner(points, b) - corner(points, a)) / longest
    s.low = float(0.0)
    s.high = longest
    s.half = 0.5 * program.rel_width[rel]
    left = float(0.0)
    right = float(0.0)
    for i in range(points.num):
        off = cross2(s.along, corner(points, i) - s.apex)
        left = wp.max(left, off)
        right = wp.min(right, off)
    s.hull.num = int(0)
    if left - right > _THIN:
        s.hull = _hull(points)
    return s


@wp.func
def look(
    program: Program,
    rel: int,
    own: Placed,
    support_heading: float,
    place: wp.array(dtype=wp.vec4),
    bounds: wp.array(dtype=wp.vec4),
    present: wp.array(dtype=int),
) -> Sight:
    """What a relation comes to for an object (its bounds and heading; where it is does not matter) in one world.

    Absent anchors count as not named; a relation that is left without enough of them is not active.
    """
    adr = program.rel_anchoradr[rel]
    points = Polygon()
    points.num = int(0)
    for i in range(program.rel_anchornum[rel]):
        slot = program.rel_anchor[adr + i]
        if present[slot] != 0:
            points = push_corner(points, wp.vec2(place[slot][0], place[slot][1]))
    if program.rel_type[rel] == _BETWEEN:
        return _between(program, rel, points)

    s = Sight()
    s.hull.num = int(0)
    s.active = points.num > 0
    if not s.active:
        return s
    anchor = load_placed(place, bounds, program.rel_anchor[adr])
    frame = program.rel_frame[rel]
    s.axis = program.rel_heading[rel]
    if frame == _FRAME_SUPPORT:
        s.axis += support_heading
    elif frame != _FRAME_WORLD:
        if present[frame] != 0:
            s.axis += place[frame][3]
        else:
            s.active = False
    s.apex = anchor.at
    if program.rel_type[rel] == _SECTOR:
        s.half_angle = program.rel_half_angle[rel]
        s.low = program.rel_low[rel]
        s.high = program.rel_high[rel]
        if program.rel_bounds[rel] != 0:
            s.high += bounds_radius(anchor) + bounds_radius(own)
        return s

    side = turned(wp.vec2(1.0, 0.0), s.axis)
    across = wp.vec2(-side[1], side[0])
    offset = bounds_extent(anchor, side)[1] + program.rel_gap[rel] - bounds_extent(own, side)[0]
    wide = bounds_extent(anchor, across)
    narrow = bounds_extent(own, across)
    s.apex = anchor.at + side * offset
    s.along = across
    s.low = wp.min(wide[0] - narrow[0], wide[1] - narrow[1])
    s.high = wp.max(wide[0] - narrow[0], wide[1] - narrow[1])
    s.half = _LINE
    return s


@wp.func
def clip_to(program: Program, rel: int, piece: int, s: Sight, p: Polygon) -> Polygon:
    """The part of a polygon in one convex piece of a relation."""
    if not s.active:
        return p
    if program.rel_type[rel] != _SECTOR:
        if s.hull.num > 0:
            for i in range(s.hull.num):
                a = corner(s.hull, i)
                side = corner(s.hull, (i + 1) % s.hull.num) - a
                p = clip(p, wp.vec2(side[1], -side[0]), a, 0.0)
            return p
        across = wp.vec2(-s.along[1], s.along[0])
        p = clip(p, s.along, s.apex, s.high)
        p = clip(p, -s.along, s.apex, -s.low)
        p = clip(p, across, s.apex, s.half)
        return clip(p, -across, s.apex, s.half)

    slice = 2.0 * s.half_angle / float(program.rel_piecenum[rel])
    first = s.axis - s.half_angle + slice * float(piece)
    middle = turned(wp.vec2(1.0, 0.0), first + 0.5 * slice)
    if program.rel_piecenum[rel] > 1 or s.half_angle < _PI:
        p = clip(p, turned(wp.vec2(0.0, -1.0), first), s.apex, 0.0)
        p = clip(p, turned(wp.vec2(0.0, 1.0), first + slice), s.apex, 0.0)
    if s.low > 0.0:
        p = clip(p, -middle, s.apex, -s.low * wp.cos(0.5 * slice))
    if program.rel_high[rel] < 1.0e29:
        p = clip(p, middle, s.apex, s.high)
    return p


@wp.func
def holds(
    program: Program,
    rel: int,
    s: Sight,
    own: Placed,
    place: wp.array(dtype=wp.vec4),
    bounds: wp.array(dtype=wp.vec4),
) -> bool:
    """Does a relation hold exactly, with the object where `own` has it? One of its pieces holds the point already."""
    if not s.active or program.rel_type[rel] != _SECTOR:
        return True
    v = own.at - s.apex
    distance = wp.length(v)
    if program.rel_bounds[rel] != 0:
        distance = bounds_distance(own, load_placed(place, bounds, program.rel_anchor[program.rel_anchoradr[rel]]))
    if distance < program.rel_low[rel] or distance > program.rel_high[rel]:
        return False
    axis = turned(wp.vec2(1.0, 0.0), s.axis)
    return s.half_angle >= _PI or wp.abs(wp.atan2(cross2(axis, v), wp.dot(axis, v))) <= s.half_angle
