"""Device code of `relations`: enclose the region of a relation in convex pieces, and test a point exactly.

The region of a relation with a direction and distances is a sector of a ring around the anchor. The sector is cut into
slices of at most 30 degrees, or of less if the ring is thin. Four half-planes enclose each slice: two are bounded
by the rays on its sides, one by a chord of the inner circle, and one by a tangent of the outer circle. Slices are
disjoint, so their areas add up. Together, the slices exceed the sector by less than the area of the sector. If a drawn
point is outside the sector, another point is drawn.
"""

import math

import warp as wp

from sceniris_gym.config.bounds import MAX_ANCHORS
from sceniris_gym.config.relations import RelationType
from sceniris_gym.device.transforms import angle_of, unit_circle
from sceniris_gym.placement.placed import (
    Placed,
    bounds_distance,
    bounds_extent,
    bounds_offset,
    bounds_radius,
    is_there,
    placed,
    rotated,
    rotated_to,
)
from sceniris_gym.placement.polygons import HalfPlane, convex_hull, cross2
from sceniris_gym.program.device import FRAME_SUPPORT, FRAME_WORLD, FREE, OWN_WIDTH, Program

_PI = wp.constant(math.pi)
_NO_LIMIT = wp.constant(1.0e29)
# If the hull of anchors is thinner than this [m], they count as collinear, and their region is a strip. If anchors are
# no further apart than this, they count as one point, and their region is a square along the world's axes.
_THIN = wp.constant(1.0e-3)
# The region of `beside` is a line, or a point for joined sites. Both are drawn as strips of this half width [m]. Five
# times this width counts as a violation.
INACTIVE = wp.constant(-1)
"""Value in place of the number of half-planes, for a relation with too few present anchors."""
_LINE = wp.constant(2.0e-5)
# If a point is within this distance [m] of an anchor, the direction from the anchor to the point is only rounding.
_NO_DIRECTION = wp.constant(1.0e-5)


@wp.struct
class ResolvedRelation:
    """The region of one relation in one world, seen from above.

    A sector has all points at distances from `low` to `high` [m] from `apex`, in directions up to `half_angle` [rad]
    to both sides of `axis` [rad]. Convex pieces enclose the sector. A strip or a line extends along the unit
    vector `along`, from `low` to `high` [m] as measured from `apex`, and by `half` [m] to both sides of this direction.
    A hull has `hullnum` corners in a separate array. All pieces lie within `reach` [m] of `apex`. A `reach` of 1e29
    (`_NO_LIMIT`) means that no such distance is computed.
    """

    active: bool
    hullnum: int
    apex: wp.vec2
    axis: float
    half_angle: float
    along: wp.vec2
    low: float
    high: float
    half: float
    reach: float


@wp.func
def load_placed(pivot_pose: wp.array[wp.vec4], bounds: wp.array[wp.vec4], column: int) -> Placed:
    """Return the object in a column of `pivot_pose` (x, y, z, heading) and `bounds` (low x, low y, high x, high y)."""
    return placed(wp.vec2(pivot_pose[column][0], pivot_pose[column][1]), pivot_pose[column][3], bounds[column])


@wp.func
def _strip(apex: wp.vec2, along: wp.vec2, low: float, high: float, half: float, reach: float) -> ResolvedRelation:
    """Return a strip as the region of a relation, seen from above.

    Args:
        apex: Origin of the strip [m].
        along: Unit vector along the strip.
        low: Beginning of the strip, as a distance from `apex` along `along` [m].
        high: End of the strip, measured in the same way [m].
        half: Half of the strip's width [m].
        reach: Radius of a circle around `apex` that encloses the strip [m], or `_NO_LIMIT`.
    """
    return ResolvedRelation(True, 0, apex, 0.0, 0.0, along, low, high, half, reach)


@wp.func
def _between(width: float, points: wp.array[wp.vec2], num: int, hull: wp.array[wp.vec2]) -> ResolvedRelation:
    """Return the region of `between`: the hull of the anchors' pivots, a strip, or a square.

    If the pivots lie on a line, the region is a strip along this line. If they coincide, it is a square.

    Args:
        width: Width of the strip, and side of the square [m].
        points: Pivots of the present anchors [m].
        num: Number of the present anchors.
        hull: Out: the corners of the hull [m].
    """
    a = int(0)
    b = int(0)
    longest = float(0.0)
    for i in range(num):
        for j in range(i):
            length = wp.length(points[i] - points[j])
            if length > longest:
                longest = length
                a = i
                b = j
    half = 0.5 * width
    s = _strip(0.5 * (points[a] + points[b]), wp.vec2(1.0, 0.0), -half, half, half, _NO_LIMIT)
    if longest > _THIN:
        s = _strip(points[a], (points[b] - points[a]) / longest, 0.0, longest, half, _NO_LIMIT)
    s.active = num >= 2
    left = float(0.0)
    right = float(0.0)
    for i in range(num):
        off = cross2(s.along, points[i] - s.apex)
        left = wp.max(left, off)
        right = wp.min(right, off)
    if left - right > _THIN:
        s.hullnum = convex_hull(points, num, hull)
    return s


@wp.func
def _with_bounds(p: Placed, bounds: wp.vec4) -> Placed:
    """Return an object with other bounds, or as it is if these bounds are empty."""
    if bounds[0] <= bounds[2]:
        return Placed(p.at, p.axis, wp.vec2(bounds[0], bounds[1]), wp.vec2(bounds[2], bounds[3]))
    return p


@wp.func
def _beside(program: Program, rel: int, own: Placed, anchor: Placed, axis: float) -> ResolvedRelation:
    """Return the region of `beside` without sites: a line of pivot positions.

    At each position on this line, the bounds of the anchor and of the object are as far apart in the direction `axis`
    as the relation's `gap` demands. Along the line, the narrower bounds stay within the span of the wider bounds, or
    with `align` in line with one end or with the middle of the anchor's bounds.

    Args:
        program: The scene, as device code reads it.
        rel: Number of the relation.
        own: The object to place.
        anchor: The object next to which it is placed.
        axis: Direction from the anchor to the object [rad].
    """
    side = rotated(wp.vec2(1.0, 0.0), axis)
    along = wp.vec2(-side[1], side[0])
    offset = bounds_extent(anchor, side)[1] + program.rel_beside[rel][0] - bounds_extent(own, side)[0]
    wide = bounds_extent(anchor, along)
    narrow = bounds_extent(own, along)
    low = wp.min(wide[0] - narrow[0], wide[1] - narrow[1])
    high = wp.max(wide[0] - narrow[0], wide[1] - narrow[1])
    align = program.rel_beside[rel][1]
    if align != FREE:
        right = wide[0] - narrow[0]
        low = right + 0.5 * (align + 1.0) * (wide[1] - narrow[1] - right)
        high = low
    # extend both ends, because the line shrinks to a point if both bounds are equally wide
    low -= _LINE
    high += _LINE
    return _strip(anchor.at + side * offset, along, low, high, _LINE, _NO_LIMIT)


@wp.func
def _joined(site: wp.vec3, its: wp.vec3, own: Placed, anchor: Placed) -> ResolvedRelation:
    """Return the region of `beside` with sites: the only pivot position at which the two sites meet.

    If the relation has a gap, the object's site meets a point at this distance from the anchor's site.
    """
    from_anchor = rotated_to(wp.vec2(its[0], its[1]), anchor.axis)
    apex = anchor.at + from_anchor - rotated_to(wp.vec2(site[0], site[1]), own.axis)
    return _strip(apex, wp.vec2(1.0, 0.0), -_LINE, _LINE, _LINE, 2.0 * _LINE)


@wp.func
def turn_to_sites(program: Program, obj: int, present: wp.array[int]) -> float:
    """Return the angle [rad] by which an object's heading differs because the anchor's first variant is absent.

    It is 0 for objects that are not joined at sites.
    """
    turn = float(0.0)
    for rel in range(program.obj_reladr[obj], program.obj_reladr[obj] + program.obj_relnum[obj]):
        if program.rel_type[rel] == RelationType.JOINED:
            for i in range(program.rel_anchornum[rel]):
                if is_there(present, program.rel_anchor[program.rel_anchoradr[rel] + i]):
                    turn = program.rel_sites[rel, 1 + i][2]
    return turn


@wp.func
def resolve(
    program: Program,
    worldid: int,
    rel: int,
    own: Placed,
    support_heading: float,
    pivot_pose: wp.array[wp.vec4],
    bounds: wp.array[wp.vec4],
    present: wp.array[int],
    hull: wp.array[wp.vec2],
) -> ResolvedRelation:
    """Return the region of a relation in one world. `own` has the heading and bounds of the object to place.

    Absent anchors are ignored. If too few anchors are present, the returned region has `active` False. If the region is
    a hull, its corners are written to `hull`.
    """
    adr = program.rel_anchoradr[rel]
    points = wp.zeros(shape=(MAX_ANCHORS,), dtype=wp.vec2)
    num = int(0)
    last = int(0)  # of `beside`, the present variant of the anchor, if it has variants
    for i in range(program.rel_anchornum[rel]):
        column = program.rel_anchor[adr + i]
        if is_there(present, column):
            points[num] = wp.vec2(pivot_pose[column][0], pivot_pose[column][1])
            num += 1
            last = i
    if program.rel_type[rel] == RelationType.BETWEEN:
        width = program.rel_width[rel]
        if width == OWN_WIDTH:
            size = own.high - own.low
            width = wp.min(size[0], size[1])
        return _between(width, points, num, hull)

    s = ResolvedRelation()  # pyrefly: ignore[missing-argument]
    s.reach = _NO_LIMIT
    frame = program.rel_frame[rel]
    axis = program.rel_heading[rel]
    s.active = num > 0
    if frame == FRAME_SUPPORT:
        axis += support_heading
    elif frame != FRAME_WORLD:
        axis += pivot_pose[frame][3]
        s.active = s.active and is_there(present, frame)
    if not s.active:
        return s
    anchor = load_placed(pivot_pose, bounds, program.rel_anchor[adr])
    if program.rel_type[rel] == RelationType.JOINED:
        return _joined(program.rel_sites[rel, 0], program.rel_sites[rel, 1 + last], own, anchor)
    if program.rel_type[rel] != RelationType.SECTOR:
        roots = program.rel_root[rel]
        return _beside(program, rel, _with_bounds(own, roots[0]), _with_bounds(anchor, roots[1 + last]), axis)
    s.apex = anchor.at
    s.axis = axis
    s.half_angle = program.rel_half_angle[rel]
    s.low = program.rel_low[worldid, rel]
    s.high = program.rel_high[worldid, rel]
    if program.rel_bounds[rel]:
        s.low -= bounds_offset(anchor) + bounds_offset(own)
        s.high += bounds_radius(anchor) + bounds_radius(own)
    if s.high < _NO_LIMIT:
        # the distance to the meeting point of two slices' tangents, plus more than rounding
        s.reach = 1.001 * s.high / unit_circle(s.half_angle / float(program.rel_piecenum[rel]))[0]
    return s


@wp.func
def depends_on_heading(program: Program, rel: int) -> bool:
    """Return True if the region of a relation depends on the heading of the object to place.

    Other regions depend at most on the object's bounds.
    """
    return program.rel_type[rel] == RelationType.BESIDE or program.rel_type[rel] == RelationType.JOINED


@wp.func
def side_num(s: ResolvedRelation) -> int:
    """Return the number of half-planes around each convex piece of a region, or INACTIVE if `active` is False."""
    if not s.active:
        return INACTIVE
    if s.hullnum > 0:
        return s.hullnum
    return 4


@wp.func
def _slice_sides(program: Program, rel: int, s: ResolvedRelation, sides: wp.array[HalfPlane], first: int):
    """Write the four half-planes around each slice of a sector `s` to `sides`, starting at index `first`.

    Two half-planes are bounded by the rays on the sides of the slice, one by a chord of the inner circle, and one by a
    tangent of the outer circle.
    """
    pieces = program.rel_piecenum[rel]
    slice = 2.0 * s.half_angle / float(pieces)
    inner = s.low * unit_circle(0.5 * slice)[0]
    everything = HalfPlane(wp.vec2(0.0), s.apex, 0.0)
    for piece in range(pieces):
        adr = first + 4 * piece
        edge = s.axis - s.half_angle + slice * float(piece)
        for k in range(4):
            sides[adr + k] = everything
        if s.half_angle < _PI or pieces > 1:
            sides[adr] = HalfPlane(rotated(wp.vec2(0.0, -1.0), edge), s.apex, 0.0)
            sides[adr + 1] = HalfPlane(rotated(wp.vec2(0.0, 1.0), edge + slice), s.apex, 0.0)
        middle = rotated(wp.vec2(1.0, 0.0), edge + 0.5 * slice)
        if s.low > 0.0:
            sides[adr + 2] = HalfPlane(-middle, s.apex, -inner)
        if s.high < _NO_LIMIT:
            sides[adr + 3] = HalfPlane(middle, s.apex, s.high)


@wp.func
def write_sides(
    program: Program, rel: int, s: ResolvedRelation, hull: wp.array[wp.vec2], sides: wp.array[HalfPlane], first: int
):
    """Write the half-planes around all convex pieces of the region `s` to `sides`, starting at index `first`."""
    if not s.active:
        return
    if s.hullnum > 0:
        for k in range(s.hullnum):
            a = hull[k]
            edge = hull[(k + 1) % s.hullnum] - a
            sides[first + k] = HalfPlane(wp.vec2(edge[1], -edge[0]), a, 0.0)
    elif program.rel_type[rel] == RelationType.SECTOR:
        _slice_sides(program, rel, s, sides, first)
    else:
        across = wp.vec2(-s.along[1], s.along[0])
        sides[first] = HalfPlane(s.along, s.apex, s.high)
        sides[first + 1] = HalfPlane(-s.along, s.apex, -s.low)
        sides[first + 2] = HalfPlane(across, s.apex, s.half)
        sides[first + 3] = HalfPlane(-across, s.apex, s.half)


@wp.func
def relation_holds(
    program: Program,
    worldid: int,
    rel: int,
    s: ResolvedRelation,
    own: Placed,
    pivot_pose: wp.array[wp.vec4],
    bounds: wp.array[wp.vec4],
) -> bool:
    """Test whether a relation holds exactly for the object `own`, whose pivot already lies in a piece of the region.

    The pieces of a sector enclose more than the sector, so the exact distance and direction are tested. The pieces of
    other regions are exact, so for them the result is True.
    """
    if not s.active or program.rel_type[rel] != RelationType.SECTOR:
        return True
    v = own.at - s.apex
    distance = wp.length(v)
    if program.rel_bounds[rel]:
        distance = bounds_distance(own, load_placed(pivot_pose, bounds, program.rel_anchor[program.rel_anchoradr[rel]]))
    if distance < program.rel_low[worldid, rel] or distance > program.rel_high[worldid, rel]:
        return False
    if s.half_angle >= _PI:
        return True
    if wp.length(v) <= _NO_DIRECTION:
        return False
    axis = rotated(wp.vec2(1.0, 0.0), s.axis)
    return wp.abs(angle_of(wp.dot(axis, v), cross2(axis, v))) <= s.half_angle
