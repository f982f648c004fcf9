"""Separating axes of two boxes: the face normals of both, and the cross products of their edges.

S. Gottschalk, M. Lin, D. Manocha, "OBBTree", SIGGRAPH 1996. The boxes have half extents ha and hb [m]; b is centred at
t and its axes are the columns of r, both in the frame of a.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def absolute(r: wp.mat33) -> wp.mat33:
    """Return the absolute values of the entries of a rotation matrix."""
    return wp.matrix_from_rows(wp.abs(r[0]), wp.abs(r[1]), wp.abs(r[2]))


@wp.func
def gap_at_faces(ha: wp.vec3, hb: wp.vec3, t: wp.vec3, f: wp.mat33) -> float:
    """Return the widest gap [m] along the face normals of a, negative for an overlap; `f` is `absolute(r)`.

    For the face normals of b, pass (hb, ha), t in the frame of b, and the transpose of f.
    """
    return wp.max(wp.abs(t) - ha - f * hb)


@wp.func
def gap_across_edges(ha: wp.vec3, hb: wp.vec3, t: wp.vec3, r: wp.mat33, f: wp.mat33, i: int, j: int) -> float:
    """Return the gap [m] along the cross product of edge i of a and edge j of b, times that product's length (<= 1)."""
    i1 = (i + 1) % 3
    i2 = (i + 2) % 3
    j1 = (j + 1) % 3
    j2 = (j + 2) % 3
    reach = ha[i1] * f[i2, j] + ha[i2] * f[i1, j] + hb[j1] * f[i, j2] + hb[j2] * f[i, j1]
    return wp.abs(t[i2] * r[i1, j] - t[i1] * r[i2, j]) - reach
