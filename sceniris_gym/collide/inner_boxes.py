"""Inner boxes of convex pieces: two pieces overlap wherever the boxes inside of them do, which is quick to prove."""

import warp as wp

from sceniris_gym.collide.axes import absolute, gap_across_edges, gap_at_faces
from sceniris_gym.device.transforms import Pose, apply, compose, pose_of, relative
from sceniris_gym.program.device import Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Edges count as parallel up to an angle of 1.4e-3 rad, whose cosine this is; three pairs of edges may be so at once.
_PARALLEL = wp.constant(1.0 - 1.0e-6)
# The overlap required along face normals, as a share of the sum of the half diagonals: twice the displacement from
# turning the boxes until such edges are exactly parallel.
_OVERLAP = wp.constant(5.0e-3)
_ROUNDING = wp.constant(1.0e-7)


@wp.func
def boxes_within(ca: wp.vec3, ha: wp.vec3, cb: wp.vec3, hb: wp.vec3, rel: Pose, margin: float) -> bool:
    """Test whether two boxes (centre, half extents [m]) are certainly within `margin` [m], 0 or more, of each other.

    Box b is given in a frame whose pose in a's frame is `rel`. It is moved towards a by the margin: boxes that overlap
    then are no further apart than that. May return False for boxes that are just within the margin, never the reverse.

    S. Gottschalk, M. Lin, D. Manocha, "OBBTree", SIGGRAPH 1996. Parallel edges have no cross product, and that of
    nearly parallel ones is mostly rounding. Such axes are skipped; instead the boxes have to overlap along their face
    normals by so much that no skipped axis could separate them.
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
    """Test whether inner boxes prove that two pieces are within `margin` [m]; `rel` poses b's body in a's frame."""
    ha = program.inner_half[a]
    hb = program.inner_half[b]
    if ha[0] == 0.0 or hb[0] == 0.0:
        return False
    frame = compose(rel, pose_of(program.piece_pos[b], program.piece_quat[b]))
    frame = relative(pose_of(program.piece_pos[a], program.piece_quat[a]), frame)
    return boxes_within(program.inner_center[a], ha, program.inner_center[b], hb, frame, margin)
