"""The axes that can tell two boxes apart: the faces of both, and those across an edge of each.

S. Gottschalk, M. Lin, D. Manocha, "OBBTree", SIGGRAPH 1996. Boxes have half extents ha and hb [m]; b's centre is at t
and its axes are the columns of r, both in the frame of a.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def absolute(r: wp.mat33) -> wp.mat33:
    """The absolute values of a rotation."""
    return wp.mat33(
        wp.abs(r[0, 0]), wp.abs(r[0, 1]), wp.abs(r[0, 2]),
        wp.abs(r[1, 0]), wp.abs(r[1, 1]), wp.abs(r[1, 2]),
        wp.abs(r[2, 0]), wp.abs(r[2, 1]), wp.abs(r[2, 2]),
    )  # fmt: skip


@wp.func
def gap_at_faces(ha: wp.vec3, hb: wp.vec3, t: wp.vec3, f: wp.mat33) -> float:
    """The widest gap [m] along the axes of a, negative for an overlap. `f` has the absolute values of r.

    Along those of b it is that of (hb, ha), with t in the frame of b and the transpose of f.
    """
    return wp.max(wp.vec3(wp.abs(t[0]), wp.abs(t[1]), wp.abs(t[2])) - ha - f * hb)


@wp.func
def gap_across_edges(ha: wp.vec3, hb: wp.vec3, t: wp.vec3, r: wp.mat33, f: wp.mat33, i: int, j: int) -> float:
    """The gap across edge i of a and edge j of b, in lengths of their cross product, which is at most 1."""
    i1 = (i + 1) % 3
    i2 = (i + 2) % 3
    j1 = (j + 1) % 3
    j2 = (j + 2) % 3
    reach = ha[i1] * f[i2, j] + ha[i2] * f[i1, j] + hb[j1] * f[i, j2] + hb[j2] * f[i, j1]
    return wp.abs(t[i2] * r[i1, j] - t[i1] * r[i2, j]) - reach
