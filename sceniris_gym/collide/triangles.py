"""Test whether two triangles are further apart than a margin.

Each edge of a triangle is compared with each edge of the other, and each vertex with the other face. If an edge passes
through the other face, the triangles are in contact.
"""

import warp as wp

# A triangle is thin if its height is below this fraction of its longest edge. Rounding then rotates the cross product
# of two edges, so points far away get wrong heights: by up to 0.6 mm for a sliver of 1 m x 0.1 mm.
_THIN = wp.constant(0.01)
# Below this fraction, the height is only rounding. The triangle has no normal and counts as its three edges.
_FLAT = wp.constant(4.0e-7)
# Squared sine of an angle. Below this value, the quick formula for the nearest points loses too much to rounding.
_NEARLY_PARALLEL = wp.constant(1.0e-4)
# Squared sine of an angle. Below this value, segments count as parallel.
_PARALLEL = wp.constant(1.0e-12)


@wp.func
def _thin_normal(e0: wp.vec3, e1: wp.vec3, e2: wp.vec3) -> wp.vec3:
    """Return the normal of a thin triangle with the consecutive edges e0, e1 and e2, or zero if it has no height.

    The normal is exactly perpendicular to the longest edge, so rounding can only rotate it about this edge. Inside the
    triangle, such a rotation moves the plane by less than the rounding error of a vertex.
    """
    edge = e0
    after = e1
    before = e2
    if wp.dot(e1, e1) > wp.dot(edge, edge):
        edge = e1
        after = e2
        before = e0
    if wp.dot(e2, e2) > wp.dot(edge, edge):
        edge = e2
        after = e0
        before = e1
    side = after
    if wp.dot(before, before) < wp.dot(after, after):
        side = -before  # the shorter side has the smaller rounding
    length_sq = wp.dot(edge, edge)
    if length_sq == 0.0:
        return wp.vec3(0.0)
    height = side - edge * (wp.dot(edge, side) / length_sq)
    if wp.dot(height, height) <= _FLAT * _FLAT * length_sq:
        return wp.vec3(0.0)
    return wp.cross(edge, height)


@wp.func
def _normal(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec3:
    """Return the normal of triangle abc. The length of the normal is twice the area of the triangle.

    If the triangle has no height, the normal is zero.
    """
    ab = b - a
    ac = c - a
    n = wp.cross(ab, ac)
    longest_sq = wp.max(wp.dot(ab, ab), wp.dot(ac, ac))
    if wp.dot(n, n) <= _THIN * _THIN * longest_sq * longest_sq:
        n = _thin_normal(ab, c - b, -ac)
    return n


@wp.func
def _segments_within(p: wp.vec3, p1: wp.vec3, q: wp.vec3, q1: wp.vec3, limit_sq: float) -> bool:
    """Test whether the segments from p to p1 and from q to q1 are at most sqrt(limit_sq) apart.

    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.9.
    """
    d1 = p1 - p
    d2 = q1 - q
    r = p - q
    a = wp.dot(d1, d1)
    e = wp.dot(d2, d2)
    b = wp.dot(d1, d2)
    c = wp.dot(d1, r)
    f = wp.dot(d2, r)
    s = float(0.0)
    denominator = a * e - b * b
    if denominator > _NEARLY_PARALLEL * a * e:
        s = wp.clamp((b * f - c * e) / denominator, 0.0, 1.0)
    else:
        n = wp.cross(d1, d2)  # the same value, without the difference of two nearly equal products
        denominator = wp.dot(n, n)
        if denominator > _PARALLEL * a * e:
            s = wp.clamp(wp.dot(wp.cross(d2, r), n) / denominator, 0.0, 1.0)
    t = float(0.0)
    if e > 0.0:
        t = (b * s + f) / e
    if t < 0.0:
        t = 0.0
        if a > 0.0:
            s = wp.clamp(-c / a, 0.0, 1.0)
    elif t > 1.0:
        t = 1.0
        if a > 0.0:
            s = wp.clamp((b - c) / a, 0.0, 1.0)
    gap = r + d1 * s - d2 * t
    return wp.dot(gap, gap) <= limit_sq


@wp.func
def _over_face(p: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3, n: wp.vec3) -> bool:
    """Test whether the line through p along the normal n passes through the triangle abc."""
    return (
        wp.dot(wp.cross(b - a, p - a), n) >= 0.0
        and wp.dot(wp.cross(c - b, p - b), n) >= 0.0
        and wp.dot(wp.cross(a - c, p - c), n) >= 0.0
    )


@wp.func
def _meets_face(
    p: wp.vec3, q: wp.vec3, hp: float, hq: float, a: wp.vec3, b: wp.vec3, c: wp.vec3, n: wp.vec3, limit: float
) -> bool:
    """Test whether the vertex p is within `limit` of the face abc, or the edge pq passes through this face.

    `n` is the normal of the face. `limit` and the heights `hp` and `hq` of p and q over the face are multiplied by the
    length of `n`. If the face has no normal, the result is False, because a point near the face is then also near an
    edge.
    """
    if wp.abs(hp) < limit and _over_face(p, a, b, c, n):
        return True
    if (hp < 0.0 and hq > 0.0) or (hp > 0.0 and hq < 0.0):
        return _over_face(p + (q - p) * (hp / (hp - hq)), a, b, c, n)
    return False


@wp.func
def _all_beyond(h: wp.vec3, limit: float) -> bool:
    """Test whether three heights are all above `limit`, or all below `-limit`."""
    return wp.min(h) > limit or wp.max(h) < -limit


# Not inlined, like `separated` in `convex.py`. Otherwise the kernel would hold the registers of this function all the
# time.
@wp.func(inline=False)
def triangles_separated(
    a0: wp.vec3, a1: wp.vec3, a2: wp.vec3, b0: wp.vec3, b1: wp.vec3, b2: wp.vec3, margin: float
) -> bool:
    """Test whether the distance between triangles a and b in the same frame is above a positive `margin` [m]."""
    na = _normal(a0, a1, a2)
    la = wp.length(na) * margin
    hb = wp.vec3(wp.dot(na, b0 - a0), wp.dot(na, b1 - a0), wp.dot(na, b2 - a0))
    if _all_beyond(hb, la):
        return True
    nb = _normal(b0, b1, b2)
    lb = wp.length(nb) * margin
    ha = wp.vec3(wp.dot(nb, a0 - b0), wp.dot(nb, a1 - b0), wp.dot(nb, a2 - b0))
    if _all_beyond(ha, lb):
        return True

    if (
        _meets_face(a0, a1, ha[0], ha[1], b0, b1, b2, nb, lb)
        or _meets_face(a1, a2, ha[1], ha[2], b0, b1, b2, nb, lb)
        or _meets_face(a2, a0, ha[2], ha[0], b0, b1, b2, nb, lb)
        or _meets_face(b0, b1, hb[0], hb[1], a0, a1, a2, na, la)
        or _meets_face(b1, b2, hb[1], hb[2], a0, a1, a2, na, la)
        or _meets_face(b2, b0, hb[2], hb[0], a0, a1, a2, na, la)
    ):
        return False

    limit_sq = margin * margin
    return not (
        _segments_within(a0, a1, b0, b1, limit_sq)
        or _segments_within(a0, a1, b1, b2, limit_sq)
        or _segments_within(a0, a1, b2, b0, limit_sq)
        or _segments_within(a1, a2, b0, b1, limit_sq)
        or _segments_within(a1, a2, b1, b2, limit_sq)
        or _segments_within(a1, a2, b2, b0, limit_sq)
        or _segments_within(a2, a0, b0, b1, limit_sq)
        or _segments_within(a2, a0, b1, b2, limit_sq)
        or _segments_within(a2, a0, b2, b0, limit_sq)
    )
