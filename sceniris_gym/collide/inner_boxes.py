"""Cores of convex pieces, boxes inside of them: where two overlap the pieces do, and nothing else has to be asked."""

import warp as wp

from sceniris_gym.collide.axes import absolute, gap_across_edges, gap_at_faces
from sceniris_gym.device.transforms import Pose, apply, compose, pose_of, relative
from sceniris_gym.program.device import Program

wp.set_module_options({"enable_backward": False})

# Edges are in parallel up to an angle of 1.4e-3, that of this cosine; three pairs of edges may be so at once.
_PARALLEL = wp.constant(1.0 - 1.0e-6)
# What boxes overlap by along their faces, in shares of the sum of their half diagonals: twice what turning them until
# such edges are in parallel moves them against each other.
_OVERLAP = wp.constant(5.0e-3)
_ROUNDING = wp.constant(1.0e-7)


@wp.func
def boxes_within(ca: wp.vec3, ha: wp.vec3, cb: wp.vec3, hb: wp.vec3, rel: Pose, margin: float) -> bool:
    """Are two boxes (centre, half extents) plainly within `margin` [m] of each other, which may be 0?

    Box b lies in the frame that `rel` places in a's. It is moved towards a by the margin: what overlaps then is no
    further apart than that.

    S. Gottschalk, M. Lin, D. Manocha, "OBBTree", SIGGRAPH 1996, with the axes of both boxes and those across two edges.
    Edges in parallel have no such axis, and where they nearly are rounding decides what it says: it is not asked, and
    the boxes have to overlap so far along the others that it could not say no.
    """
    t = apply(rel, cb) - ca
    t = t * wp.max(1.0 - margin / wp.max(wp.length(t), 1.0e-9), 0.0)
    r = rel.rot
    f = absolute(r)
    deep = _OVERLAP * (wp.length(ha) + wp.length(hb))
    if gap_at_faces(ha, hb, t, f) > -deep:
        return False
    tb = wp.transpose(r) * t
    if gap_at_faces(hb, ha, tb, wp.transpose(f)) > -deep:
        return False
    for i in range(3):
        for j in range(3):
            if f[i, j] < _PARALLEL and gap_across_edges(ha, hb, t, r, f, i, j) > -_ROUNDING:
                return False
    return True


@wp.func
def inner_boxes_within(program: Program, a: int, b: int, rel: Pose, margin: float) -> bool:
    """Are the cores of two pieces plainly within `margin` [m] of each other? `rel` is b's body in the frame of a's."""
    ha = program.inner_half[a]
    hb = program.inner_half[b]
    if ha[0] == 0.0 or hb[0] == 0.0:
        return False
    frame = compose(rel, pose_of(program.piece_pos[b], program.piece_quat[b]))
    frame = relative(pose_of(program.piece_pos[a], program.piece_quat[a]), frame)
    return boxes_within(program.inner_center[a], ha, program.inner_center[b], hb, frame, margin)
