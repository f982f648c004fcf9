"""Boxes: what of them is near, and the axes that tell two of them apart.

Beside a wall of ten metres a gap of 10 um is lost in rounding, and rounding may lead the general test astray before it
finds one: it calls some boxes of decimetres in contact that are 10 to 100 um apart.
"""

import warp as wp

from sceniris_gym.collide.axes import absolute, gap_across_edges, gap_at_faces
from sceniris_gym.collide.convex import Shape, separated
from sceniris_gym.device.transforms import Pose
from sceniris_gym.geometry.pieces import PieceType

wp.set_module_options({"enable_backward": False})

_SPACE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
# What is cut off lies this much [m] beyond all that could matter.
_BEYOND = wp.constant(1.0e-3)
# Of sums of six products in single precision, in shares of what is multiplied.
_ROUNDING = wp.constant(4.0e-7)


@wp.func
def _near_part(shape: Shape, at: wp.vec3, reach: float):
    """What of a box lies within `reach` [m] of a point along each of its axes, the centre of that in its frame, and
    whether there is any. Other shapes stay as they are.
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
    """Is there an axis along which two boxes, each centred in its frame, are further apart than `margin` [m]?

    Axes across two edges count as far as their length is known: the less, the more parallel the edges are.
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
    """Is the distance between two shapes above `margin` [m], 0 or more? `rel` is the pose of `b` in the frame of `a`.

    Each lies within its radius [m] of its frame's origin.
    """
    reach = margin + _BEYOND
    part_a, middle_a, some_a = _near_part(a, rel.pos, radius_b + reach)
    part_b, middle_b, some_b = _near_part(b, -(wp.transpose(rel.rot) * rel.pos), radius_a + reach)
    if not some_a or not some_b:
        return True
    near = Pose()
    near.rot = rel.rot
    near.pos = rel.pos + rel.rot * middle_b - middle_a
    if a.kind == PieceType.BOX and b.kind == PieceType.BOX:
        if _boxes_apart(part_a.size, part_b.size, near, margin):
            return True
    return separated(vert, part_a, part_b, near, _SPACE, margin)
