"""Are two triangles further apart than a margin? Edges against edges, vertices against faces, edges through faces."""

import warp as wp


@wp.func
def _segments_within(p: wp.vec3, d1: wp.vec3, q: wp.vec3, d2: wp.vec3, limit_sq: float) -> bool:
    """Are the segments p + [0, 1] d1 and q + [0, 1] d2 within sqrt(limit_sq)?

    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.9.
    """
    r = p - q
    a = wp.dot(d1, d1)
    e = wp.dot(d2, d2)
    b = wp.dot(d1, d2)
    c = wp.dot(d1, r)
    f = wp.dot(d2, r)
    s = float(0.0)
    denominator = a * e - b * b
    if denominator > 1.0e-9 * a * e:
        s = wp.clamp((b * f - c * e) / denominator, 0.0, 1.0)
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
    """Does the line through p along the normal n pass the triangle abc?"""
    return (
        wp.dot(wp.cross(b - a, p - a), n) >= 0.0
        and wp.dot(wp.cross(c - b, p - b), n) >= 0.0
        and wp.dot(wp.cross(a - c, p - c), n) >= 0.0
    )


@wp.func
def _meets_face(
    p: wp.vec3, q: wp.vec3, hp: float, hq: float, a: wp.vec3, b: wp.vec3, c: wp.vec3, n: wp.vec3, limit: float
) -> bool:
    """Is the vertex p within `limit` of the face abc, or does the edge pq pass it? hp, hq, limit: times |n|."""
    if wp.abs(hp) <= limit and _over_face(p, a, b, c, n):
        return True
    if (hp < 0.0 and hq > 0.0) or (hp > 0.0 and hq < 0.0):
        return _over_face(p + (q - p) * (hp / (hp - hq)), a, b, c, n)
    return False


@wp.func
def _all_beyond(h: wp.vec3, limit: float) -> bool:
    return wp.min(h) > limit or wp.max(h) < -limit


@wp.func
def triangles_separated(
    a0: wp.vec3, a1: wp.vec3, a2: wp.vec3, b0: wp.vec3, b1: wp.vec3, b2: wp.vec3, margin: float
) -> bool:
    """Is the distance between the triangles a and b above `margin` [m]? Both in one frame."""
    na = wp.cross(a1 - a0, a2 - a0)
    la = wp.length(na) * margin
    hb = wp.vec3(wp.dot(na, b0 - a0), wp.dot(na, b1 - a0), wp.dot(na, b2 - a0))
    if _all_beyond(hb, la):
        return True
    nb = wp.cross(b1 - b0, b2 - b0)
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
    a01 = a1 - a0
    a12 = a2 - a1
    a20 = a0 - a2
    b01 = b1 - b0
    b12 = b2 - b1
    b20 = b0 - b2
    return not (
        _segments_within(a0, a01, b0, b01, limit_sq)
        or _segments_within(a0, a01, b1, b12, limit_sq)
        or _segments_within(a0, a01, b2, b20, limit_sq)
        or _segments_within(a1, a12, b0, b01, limit_sq)
        or _segments_within(a1, a12, b1, b12, limit_sq)
        or _segments_within(a1, a12, b2, b20, limit_sq)
        or _segments_within(a2, a20, b0, b01, limit_sq)
        or _segments_within(a2, a20, b1, b12, limit_sq)
        or _segments_within(a2, a20, b2, b20, limit_sq)
    )
