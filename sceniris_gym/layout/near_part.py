"""Long boxes are cut down to what is near: beside a wall of ten metres a gap of 10 um is lost in rounding."""

import warp as wp

from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.layout.convex import Shape, separated
from sceniris_gym.layout.transforms import Pose

wp.set_module_options({"enable_backward": False})

_BOX = wp.constant(int(PieceType.BOX))
_SPACE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
# What is cut off lies this much [m] beyond all that could matter.
_BEYOND = wp.constant(1.0e-3)


@wp.func
def _near_part(shape: Shape, at: wp.vec3, reach: float):
    """What of a box lies within `reach` [m] of a point along each of its axes, and the centre of that in its frame.

    It has negative sizes if nothing does. Other shapes stay as they are.
    """
    part = shape
    middle = wp.vec3(0.0)
    if shape.kind == _BOX:
        low = wp.max(-shape.size, at - wp.vec3(reach))
        high = wp.min(shape.size, at + wp.vec3(reach))
        part.size = 0.5 * (high - low)
        middle = 0.5 * (high + low)
    return part, middle


@wp.func
def near_parts_separated(
    vert: wp.array(dtype=wp.vec3),
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
    part_a, middle_a = _near_part(a, rel.pos, radius_b + reach)
    part_b, middle_b = _near_part(b, -(wp.transpose(rel.rot) * rel.pos), radius_a + reach)
    if wp.min(wp.min(part_a.size), wp.min(part_b.size)) < 0.0:
        return True
    near = Pose()
    near.rot = rel.rot
    near.pos = rel.pos + rel.rot * middle_b - middle_a
    return separated(vert, part_a, part_b, near, _SPACE, margin)
