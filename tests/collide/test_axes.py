"""Gaps along separating axes, against projections of the corners of both boxes in double precision."""

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.axes import absolute, gap_across_edges, gap_at_faces

wp.set_module_options({"enable_backward": False})

N = 500
CORNERS = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T


@wp.kernel
def _gaps(
    ha: wp.array[wp.vec3],
    hb: wp.array[wp.vec3],
    t: wp.array[wp.vec3],
    r: wp.array[wp.mat33],
    # Out:
    faces: wp.array2d[float],
    edges: wp.array2d[float],
):
    i = wp.tid()
    f = absolute(r[i])
    faces[i, 0] = gap_at_faces(ha[i], hb[i], t[i], f)
    faces[i, 1] = gap_at_faces(hb[i], ha[i], wp.transpose(r[i]) * t[i], wp.transpose(f))
    for j in range(3):
        for k in range(3):
            edges[i, 3 * j + k] = gap_across_edges(ha[i], hb[i], t[i], r[i], f, j, k)


def _gap(axis: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """The gap between two sets of corners along an axis, in units of its length; negative for an overlap."""
    on_a, on_b = a @ axis, b @ axis
    return max(on_b.min() - on_a.max(), on_a.min() - on_b.max())


def test_gaps_are_those_between_projected_corners():
    """Along the face normals of either box, and along each cross product of two edges, parallel ones included."""
    rng = np.random.default_rng(0)
    ha, hb = rng.uniform(0.0, 0.3, (2, N, 3)) * (rng.random((2, N, 3)) < 0.9)
    t = rng.uniform(-0.5, 0.5, (N, 3))
    r = Rotation.random(N, rng=rng).as_matrix()
    r[: N // 10] = np.eye(3)
    faces = wp.zeros((N, 2), dtype=float, device="cpu")
    edges = wp.zeros((N, 9), dtype=float, device="cpu")
    inputs = [wp.array(a, dtype=wp.vec3, device="cpu") for a in (ha, hb, t)]
    inputs.append(wp.array(r, dtype=wp.mat33, device="cpu"))
    wp.launch(_gaps, dim=N, inputs=inputs, outputs=[faces, edges], device="cpu")
    expected_faces, expected_edges = np.empty((N, 2)), np.empty((N, 9))
    for i in range(N):
        a, b = CORNERS * ha[i], CORNERS * hb[i] @ r[i].T + t[i]
        expected_faces[i] = [max(_gap(axis, a, b) for axis in axes) for axes in (np.eye(3), r[i].T)]
        expected_edges[i] = [_gap(np.cross(edge, other), a, b) for edge in np.eye(3) for other in r[i].T]
    np.testing.assert_allclose(faces.numpy(), expected_faces, atol=1e-6)
    np.testing.assert_allclose(edges.numpy(), expected_edges, atol=1e-6)
    assert 0.2 < (expected_faces > 0.0).mean() < 0.8
