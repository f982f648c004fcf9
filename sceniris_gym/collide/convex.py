"""Test whether two convex pieces are further apart than a margin. The same test detects penetration.

E. Gilbert, D. Johnson, S. Keerthi, "A fast procedure for computing the distance between complex objects", IEEE J.
Robotics and Automation 4(2), 1988. This procedure (GJK) searches for the point of the Minkowski difference of the
pieces that is nearest to the origin. It ends early here, because only yes or no matters. If the support point of the
Minkowski difference in some direction shows that the whole difference lies beyond the margin, the pieces are separated.
If a point of the difference lies within the margin of the origin, the pieces are in contact. If one piece contains the
other, the origin lies inside the difference, which also counts as contact.
"""

import warp as wp

from sceniris_gym.device.transforms import Pose, apply
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Program

# Greatest final difference [m] of lower and upper bound: ten times the float32 rounding in a scene of 1 m, and a tenth
# of the error that a wrong rejection may have.
_TOLERANCE = wp.constant(1.0e-6)
# A tetrahedron is flat if its height is below this fraction of its longest edge.
_FLAT = wp.constant(1.0e-4)
# Number of restarts after rounding has stopped progress.
_MAX_RESTARTS = wp.constant(3)
# If the gap between the bounds [m] is below this, no restart is needed.
_SETTLED = wp.constant(1.0e-5)
# Polytopes take fewer than 20 iterations. After this number, the distance of a cylinder or ellipsoid is far more
# accurate than 0.1 mm.
_MAX_ITERATIONS = wp.constant(48)


@wp.struct
class Shape:
    """A convex shape: all points within `radius` [m] of a convex core."""

    kind: int
    size: wp.vec3
    vertadr: int
    vertnum: int
    radius: float


@wp.func
def piece_shape(program: Program, piece: int) -> Shape:
    """Return the shape of a convex piece.

    A point with a radius represents a sphere exactly, and a segment with a radius represents a capsule exactly.
    """
    s = Shape()  # pyrefly: ignore[missing-argument]
    s.kind = program.piece_type[piece]
    s.size = program.piece_size[piece]
    s.vertadr = program.piece_vertadr[piece]
    s.vertnum = program.piece_vertnum[piece]
    if s.kind == PieceType.SPHERE or s.kind == PieceType.CAPSULE:
        s.radius = s.size[0]
    return s


@wp.func
def segment_shape(half_length: float) -> Shape:
    """Return a segment along the x axis of its frame, with the origin in the middle. `half_length` is in metres."""
    return Shape(kind=PieceType.SEGMENT, size=wp.vec3(half_length, 0.0, 0.0), vertadr=0, vertnum=0, radius=0.0)


@wp.func
def support(vert: wp.array[wp.vec3], s: Shape, d: wp.vec3) -> wp.vec3:
    """Return the support point of a shape's core: the core's furthest point along `d`.

    The point and `d` are in the shape's frame.
    """
    best = wp.vec3(0.0, 0.0, 0.0)
    if s.kind == PieceType.BOX:
        best = wp.vec3(wp.sign(d[0]) * s.size[0], wp.sign(d[1]) * s.size[1], wp.sign(d[2]) * s.size[2])
    elif s.kind == PieceType.CAPSULE:
        best = wp.vec3(0.0, 0.0, wp.sign(d[2]) * s.size[1])
    elif s.kind == PieceType.SEGMENT:
        best = wp.vec3(wp.sign(d[0]) * s.size[0], 0.0, 0.0)
    elif s.kind == PieceType.CYLINDER:
        radial = wp.sqrt(d[0] * d[0] + d[1] * d[1])
        scale = s.size[0] / wp.max(radial, 1.0e-12)
        best = wp.vec3(d[0] * scale, d[1] * scale, wp.sign(d[2]) * s.size[1])
    elif s.kind == PieceType.ELLIPSOID:
        scaled = wp.cw_mul(s.size, d)
        best = wp.cw_mul(s.size, scaled) / wp.max(wp.length(scaled), 1.0e-12)
    elif s.kind != PieceType.SPHERE:
        top = float(-1.0e30)
        for i in range(s.vertnum):
            v = vert[s.vertadr + i]
            height = wp.dot(v, d)
            if height > top:
                top = height
                best = v
    return best


@wp.func(inline=False)
def least_extent(vert: wp.array[wp.vec3], s: Shape, frame: Pose, along: wp.vec3) -> float:
    """Return the least coordinate [m] of a shape along the unit vector `along`.

    `frame` is the pose of the shape in a parent frame. `along` and the coordinate are in the parent frame.
    """
    down = -(wp.transpose(frame.rot) * along)
    return wp.dot(along, apply(frame, support(vert, s, down))) - s.radius


@wp.func
def _closest_on_segment(a: wp.vec3, b: wp.vec3):
    """Return the point of segment ab nearest to the origin, and a bit mask of the vertices that determine it.

    Bit 0 stands for `a`, and bit 1 for `b`. If the point is between the two vertices, both bits are set.
    """
    ab = b - a
    t = -wp.dot(a, ab)
    if t <= 0.0:
        return a, 1
    length_sq = wp.dot(ab, ab)
    if t >= length_sq:
        return b, 2
    return a + ab * (t / length_sq), 3


@wp.func
def _nearer(a: wp.vec3, bits_a: int, b: wp.vec3, bits_b: int):
    """Return the point that is nearer to the origin, and its bit mask. If both are equally near, return `a`."""
    if wp.dot(b, b) < wp.dot(a, a):
        return b, bits_b
    return a, bits_a


@wp.func
def _closest_on_triangle(a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the point of triangle abc nearest to the origin, and a bit mask of the vertices that determine it.

    Bits 0, 1 and 2 stand for `a`, `b` and `c`. C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5. A
    triangle without area is tested as three segments.
    """
    ab = b - a
    ac = c - a
    n = wp.cross(ab, ac)
    nn = wp.dot(n, n)
    # the side of each edge on which the origin lies, seen along the normal
    in_ab = wp.dot(wp.cross(a, ab), n)
    in_bc = wp.dot(wp.cross(b, c - b), n)
    in_ca = wp.dot(wp.cross(c, a - c), n)
    if nn > 1.0e-24 and in_ab >= 0.0 and in_bc >= 0.0 and in_ca >= 0.0:
        return n * (wp.dot(a, n) / nn), 7
    best, bits = _closest_on_segment(a, b)
    v, k = _closest_on_segment(b, c)
    best, bits = _nearer(best, bits, v, k << 1)
    v, k = _closest_on_segment(c, a)
    return _nearer(best, bits, v, ((k & 1) << 2) | (k >> 1))


@wp.func
def _beyond(a: wp.vec3, b: wp.vec3, c: wp.vec3, d: wp.vec3) -> bool:
    """Test whether face abc of a tetrahedron separates the origin from vertex `d`.

    If the tetrahedron is flat, the result is True.
    """
    n = wp.cross(b - a, c - a)
    toward = wp.dot(d - a, n)
    origin = -wp.dot(a, n)
    return origin * toward < 0.0 or toward == 0.0


@wp.func
def _is_flat(a: wp.vec3, b: wp.vec3, c: wp.vec3, d: wp.vec3) -> bool:
    """Test whether a tetrahedron is so flat that rounding decides on which side of a face a point lies."""
    ab = b - a
    ac = c - a
    ad = d - a
    longest = wp.max(wp.max(wp.length(ab), wp.length(ac)), wp.length(ad))
    n = wp.cross(ab, ac)
    widest = wp.max(wp.max(wp.length(n), wp.length(wp.cross(ab, ad))), wp.length(wp.cross(ac, ad)))
    widest = wp.max(widest, wp.length(wp.cross(c - b, d - b)))
    return wp.abs(wp.dot(n, ad)) <= _FLAT * longest * widest


@wp.func
def _closest_on_tetrahedron(p0: wp.vec3, p1: wp.vec3, p2: wp.vec3, p3: wp.vec3):
    """Return the point of a tetrahedron nearest to the origin, and a bit mask of the vertices that determine it.

    Bits 0 to 3 stand for `p0` to `p3`. If the origin lies inside, all four bits are set, and the point has no meaning.
    """
    best = wp.vec3(1.0e15)  # beyond all points
    bits = int(15)
    if _beyond(p0, p1, p2, p3):
        v, k = _closest_on_triangle(p0, p1, p2)
        best, bits = _nearer(best, bits, v, k)
    if _beyond(p0, p1, p3, p2):
        v, k = _closest_on_triangle(p0, p1, p3)
        best, bits = _nearer(best, bits, v, (k & 3) | ((k & 4) << 1))
    if _beyond(p0, p2, p3, p1):
        v, k = _closest_on_triangle(p0, p2, p3)
        best, bits = _nearer(best, bits, v, (k & 1) | ((k & 6) << 1))
    if _beyond(p1, p2, p3, p0):
        v, k = _closest_on_triangle(p1, p2, p3)
        best, bits = _nearer(best, bits, v, k << 1)
    return best, bits


@wp.func
def _kept(p0: wp.vec3, p1: wp.vec3, p2: wp.vec3, p3: wp.vec3, bits: int):
    """Return the vertices of a simplex whose bits are set in `bits`, followed by their number.

    At most three of the four bits are set. The function always returns three vertices. If fewer bits are set, the last
    vertices have no meaning.
    """
    a = p0
    b = p1
    c = p2
    if (bits & 4) == 0:
        c = p3
    if (bits & 2) == 0:
        b = c
        c = p3
    if (bits & 1) == 0:
        a = b
        b = c
        c = p3
    return a, b, c, (bits & 1) + ((bits >> 1) & 1) + ((bits >> 2) & 1) + (bits >> 3)


# A single copy serves covers, footprints and obstacles. With this copy, and with the map tested before the cover, an
# H200 makes 1.065 times the layouts of the scene `mid`.
@wp.func(inline=False)
def separated(vert: wp.array[wp.vec3], sa: Shape, sb: Shape, rel: Pose, mask: wp.vec3, margin: float) -> bool:
    """Test whether the distance between two shapes is above `margin` [m].

    `rel` is the pose of `sb` in the frame of `sa`. `mask` multiplies coordinates in the frame of `sa`: (1, 1, 1) tests
    the shapes in space, and (1, 1, 0) tests their shadows on the xy plane. If the distance is above the margin by less
    than 1 um, the result may still be False.
    """
    limit = margin + sa.radius + sb.radius
    to_b = wp.transpose(rel.rot)
    v = -wp.cw_mul(mask, rel.pos)
    if wp.dot(v, v) < 1.0e-16:
        v = wp.vec3(1.0, 0.0, 0.0)
    p0 = wp.vec3(0.0)
    p1 = wp.vec3(0.0)
    p2 = wp.vec3(0.0)
    p3 = wp.vec3(0.0)
    count = int(0)
    upper = float(1.0e30)
    restarts = int(0)
    for _iteration in range(_MAX_ITERATIONS):
        on_b = rel.pos + rel.rot * support(vert, sb, to_b * v)
        w = wp.cw_mul(mask, support(vert, sa, -v) - on_b)
        lower = wp.dot(v, w) / wp.length(v)
        if lower > limit:
            return True
        if upper - lower < _TOLERANCE:
            return False
        if count == 0:
            p0 = w
        elif count == 1:
            p1 = w
        elif count == 2:
            p2 = w
        else:
            p3 = w
        count += 1

        bits = int(1)
        if count == 1:
            v = p0
        elif count == 2:
            v, bits = _closest_on_segment(p0, p1)
        elif count == 3:
            v, bits = _closest_on_triangle(p0, p1, p2)
        else:
            v, bits = _closest_on_tetrahedron(p0, p1, p2, p3)
            if bits == 15:
                if restarts == _MAX_RESTARTS or not _is_flat(p0, p1, p2, p3):
                    return False  # the origin lies inside
                # in a flat tetrahedron, rounding decides whether the origin is inside: restart from the last point
                restarts += 1
                p0 = w
                v = w
                bits = int(1)
                upper = float(1.0e30)
        p0, p1, p2, count = _kept(p0, p1, p2, p3, bits)

        nearest = wp.length(v)
        if nearest <= limit:
            return False
        if nearest >= upper:  # rounding has stopped all progress
            if restarts == _MAX_RESTARTS or upper - lower < _SETTLED:
                return False
            restarts += 1
            p0 = w
            count = int(1)
            v = w
            nearest = wp.length(w)
        upper = nearest
    return False
