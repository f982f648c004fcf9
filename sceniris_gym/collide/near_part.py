"""Near parts of large boxes, and the separating-axis test of two boxes.

A gap of 10 um beside a wall of ten metres is lost in rounding. Rounding can also stop the general test before it finds
a gap: it reports contact for some boxes of decimetres that are 10 to 100 um apart.
"""

import warp as wp

from sceniris_gym.collide.axes import absolute, gap_across_edges, gap_at_faces
from sceniris_gym.collide.convex import Shape, separated
from sceniris_gym.device.transforms import Pose
from sceniris_gym.geometry.pieces import PieceType

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_SPACE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
# Everything that is cut off is at least this much [m] further away than the margin.
_BEYOND = wp.constant(1.0e-3)
# Rounding of a sum of six products in single precision, relative to the sum of lengths.
_ROUNDING = wp.constant(4.0e-7)


@wp.func
def _near_part(shape: Shape, at: wp.vec3, reach: float):
    """Return the part of a box within `reach` [m] of a point along each axis, its centre, and False if there is none.

    Point and centre are in the box's frame. Shapes of any other kind are returned whole.
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

    The cross product of two edges is the shorter, and rounding weighs the more, the more parallel they are.
    """
    t = rel.pos
    r = rel.rot
    f = absolute(r)
    if gap_at_faces(ha, hb, t, f) > margin:
        return True
    tb = wp.transpose(r) * t
    if gap_at_faces(hb, ha, tb, wp.transpose(f)) > margin:
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
    vert: wp.array[wp.vec3],
    a: Shape,
    b: Shape,
    radius_a: float,
    radius_b: float,
    rel: Pose,
    margin: float,
) -> bool:
    """Test whether the distance between two shapes is above `margin` [m], 0 or more.

    `rel` is the pose of `b` in the frame of `a`. Each shape lies within its radius [m] of the origin of its frame.
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
