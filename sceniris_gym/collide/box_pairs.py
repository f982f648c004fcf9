"""Distance tests of boxes and convex pieces: by separating axes, by near parts of large boxes, and by inner boxes.

The separating axes are the face normals of both boxes, and the cross products of their edges: S. Gottschalk, M. Lin, D.
Manocha, "OBBTree", SIGGRAPH 1996. Box a has the half extents `ha` [m], and box b has `hb` [m]. In the frame of a, the
centre of b is at `t` [m], and the columns of `r` are the axes of b.

Rounding hides small gaps. Next to a box of ten metres, such as a wall, rounding hides a gap of 10 um. A large box is
therefore cut to the part that is near the other shape. Because of rounding, the general test of two convex pieces
(`collide.convex.separated`) also reports contact for some boxes that are decimetres wide and 10 to 100 um apart. Two
boxes are therefore tested on their separating axes first.

Some convex pieces have an inner box, which lies inside the piece. If the inner boxes of two pieces overlap, the pieces
overlap too. A test of the inner boxes proves this faster than a test of the pieces.
"""

import warp as wp

from sceniris_gym.collide.convex import Shape, separated
from sceniris_gym.device.transforms import Pose, apply, compose, pose_of, relative
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Program

_SPACE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
# The parts that are cut off are further away than the margin, by at least this distance [m].
_BEYOND = wp.constant(1.0e-3)
# Rounding error of a sum of six products in single precision, relative to the sum of lengths.
_ROUNDING = wp.constant(4.0e-7)

# Edges count as parallel if the cosine of their angle is above this (1.4e-3 rad). Up to three pairs of edges may be
# parallel at once.
_PARALLEL = wp.constant(1.0 - 1.0e-6)
# The overlap required along face normals, as a fraction of the sum of the half diagonals: twice the displacement from
# a rotation that makes parallel edges exactly parallel.
_OVERLAP = wp.constant(5.0e-3)
_EDGE_ROUNDING = wp.constant(1.0e-7)


@wp.func
def absolute(r: wp.mat33) -> wp.mat33:
    """Return the absolute values of the entries of a rotation matrix."""
    return wp.matrix_from_rows(wp.abs(r[0]), wp.abs(r[1]), wp.abs(r[2]))


@wp.func
def gap_at_faces(ha: wp.vec3, hb: wp.vec3, t: wp.vec3, f: wp.mat33) -> float:
    """Return the widest gap [m] between boxes a and b along the face normals of a, negative if there is no gap.

    `t` [m] is the centre of b in the frame of a. `f` has the absolute values of `r`, the rotation from the frame of b
    to the frame of a. For the face normals of b, pass (hb, ha), `t` rotated into the frame of b, and `f` transposed.
    """
    return wp.max(wp.abs(t) - ha - f * hb)


@wp.func
def gap_across_edges(ha: wp.vec3, hb: wp.vec3, t: wp.vec3, r: wp.mat33, f: wp.mat33, i: int, j: int) -> float:
    """Return the gap [m] between boxes a and b along the cross product of edge i of a and edge j of b.

    The product is not normalised, so the gap is scaled by the length of the product, which is at most 1.

    `t` [m] is the centre of b in the frame of a, and the columns of `r` are the axes of b in this frame. `f` has the
    absolute values of `r`.
    """
    i1 = (i + 1) % 3
    i2 = (i + 2) % 3
    j1 = (j + 1) % 3
    j2 = (j + 2) % 3
    reach = ha[i1] * f[i2, j] + ha[i2] * f[i1, j] + hb[j1] * f[i, j2] + hb[j2] * f[i, j1]
    return wp.abs(t[i2] * r[i1, j] - t[i1] * r[i2, j]) - reach


@wp.func
def _near_part(shape: Shape, at: wp.vec3, reach: float):
    """Cut a box to the part within `reach` [m] of the point `at` along each axis.

    Returns the part, its centre, and whether the box has such a part. `at` and the centre are in the frame of the box.
    A shape that is not a box is returned whole.
    """
    part = shape
    middle = wp.vec3(0.0)
    some = bool(True)
    if shape.kind == PieceType.BOX:
        low = wp.max(-shape.size, at - wp.vec3(reach))
        high = wp.min(shape.size, at + wp.vec3(reach))
        part.size = 0.5 * (high - low)
        middle = 0.5 * (high + low)
        some = wp.min(part.size) >= 0.0
    return part, middle, some


@wp.func
def _boxes_apart(ha: wp.vec3, hb: wp.vec3, rel: Pose, margin: float) -> bool:
    """Test whether two boxes, each centred in its frame, have a separating axis with a gap above `margin` [m].

    Two nearly parallel edges have a short cross product, which rounding changes a lot. A gap along a cross product
    therefore has to exceed the margin by the rounding error.
    """
    t = rel.pos
    r = rel.rot
    f = absolute(r)
    if gap_at_faces(ha, hb, t, f) > margin:
        return True
    if gap_at_faces(hb, ha, wp.transpose(r) * t, wp.transpose(f)) > margin:
        return True
    rounding = _ROUNDING * (wp.length(ha) + wp.length(hb) + wp.length(t))
    for i in range(3):
        for j in range(3):
            length = wp.sqrt(wp.max(1.0 - r[i, j] * r[i, j], 0.0))
            if gap_across_edges(ha, hb, t, r, f, i, j) > margin * length + rounding:
                return True
    return False


@wp.func
def near_parts_separated(
    vert: wp.array[wp.vec3], a: Shape, b: Shape, radius_a: float, radius_b: float, rel: Pose, margin: float
) -> bool:
    """Test whether the distance between shapes `a` and `b` is above `margin` [m], which is 0 or more.

    `rel` is the pose of `b` in the frame of `a`. `a` lies within `radius_a` [m] of the origin of its frame, and `b`
    within `radius_b` of the origin of its frame. Only the part of a box near the other shape is tested, because
    rounding hides small gaps next to a large box.
    """
    reach = margin + _BEYOND
    part_a, middle_a, some_a = _near_part(a, rel.pos, radius_b + reach)
    part_b, middle_b, some_b = _near_part(b, -(wp.transpose(rel.rot) * rel.pos), radius_a + reach)
    if not some_a or not some_b:
        return True
    near = Pose(rel.pos + rel.rot * middle_b - middle_a, rel.rot)
    if a.kind == PieceType.BOX and b.kind == PieceType.BOX:
        if _boxes_apart(part_a.size, part_b.size, near, margin):
            return True
    return separated(vert, part_a, part_b, near, _SPACE, margin)


@wp.func
def boxes_within(ca: wp.vec3, ha: wp.vec3, cb: wp.vec3, hb: wp.vec3, rel: Pose, margin: float) -> bool:
    """Test whether two boxes (centre, half extents [m]) are certainly within `margin` [m], 0 or more, of each other.

    Box b is given in a frame whose pose in a's frame is `rel`. The test moves b towards a by the margin. If the boxes
    then overlap, the distance before the move was at most the margin. True is always right, but the test may also
    return False for boxes that are just within the margin.

    The separating axes are from S. Gottschalk, M. Lin, D. Manocha, "OBBTree", SIGGRAPH 1996. The cross product of
    parallel edges is zero, and the cross product of nearly parallel edges is mostly rounding. The test skips both.
    Instead, the boxes have to overlap along their face normals so deeply that a skipped axis could not separate them.
    """
    t = apply(rel, cb) - ca
    t = t * wp.max(1.0 - margin / wp.max(wp.length(t), 1.0e-9), 0.0)
    r = rel.rot
    f = absolute(r)
    deep = _OVERLAP * (wp.length(ha) + wp.length(hb))
    if gap_at_faces(ha, hb, t, f) > -deep:
        return False
    if gap_at_faces(hb, ha, wp.transpose(r) * t, wp.transpose(f)) > -deep:
        return False
    for i in range(3):
        for j in range(3):
            if f[i, j] < _PARALLEL and gap_across_edges(ha, hb, t, r, f, i, j) > -_EDGE_ROUNDING:
                return False
    return True


@wp.func
def inner_boxes_within(program: Program, a: int, b: int, rel: Pose, margin: float) -> bool:
    """Return True if the inner boxes of pieces `a` and `b` prove that the pieces are within `margin` [m] of each other.

    An inner box lies inside its piece. If one of the pieces has no inner box, the result is False. `rel` is the pose of
    b's body in the frame of a's body.
    """
    ha = program.inner_half[a]
    hb = program.inner_half[b]
    if ha[0] == 0.0 or hb[0] == 0.0:
        return False
    frame = compose(rel, pose_of(program.piece_pos[b], program.piece_quat[b]))
    frame = relative(pose_of(program.piece_pos[a], program.piece_quat[a]), frame)
    return boxes_within(program.inner_center[a], ha, program.inner_center[b], hb, frame, margin)
