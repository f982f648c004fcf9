"""Poses on the device, against SciPy's rigid transforms."""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy.spatial.transform import RigidTransform, Rotation

from sceniris_gym.device.transforms import apply, axis_angle_quat, compose, pose_of, quat_mat, quat_z, relative

wp.set_module_options({"enable_backward": False})

N = 500


@wp.kernel
def _all(
    pos: wp.array2d[wp.vec3],
    quat: wp.array2d[wp.vec4],
    v: wp.array[wp.vec3],
    axis: wp.array[wp.vec3],
    angle: wp.array[float],
    # Out:
    composed: wp.array[wp.mat44],
    seen: wp.array[wp.mat44],
    applied: wp.array[wp.vec3],
    turns: wp.array2d[wp.mat33],
):
    i = wp.tid()
    a = pose_of(pos[i, 0], quat[i, 0])
    b = pose_of(pos[i, 1], quat[i, 1])
    ab = compose(a, b)
    in_a = relative(a, b)
    for row in range(3):
        for column in range(3):
            composed[i][row, column] = ab.rot[row, column]
            seen[i][row, column] = in_a.rot[row, column]
        composed[i][row, 3] = ab.pos[row]
        seen[i][row, 3] = in_a.pos[row]
    composed[i][3, 3] = 1.0
    seen[i][3, 3] = 1.0
    applied[i] = apply(a, v[i])
    turns[i, 0] = quat_mat(quat_z(angle[i]))
    turns[i, 1] = quat_mat(axis_angle_quat(axis[i], angle[i]))


def test_poses_and_turns_are_those_of_scipy():
    """Composed, seen from each other, applied to points; turns about z and about any axis, more than full ones too."""
    rng = np.random.default_rng(0)
    pos, v, angle = rng.normal(size=(N, 2, 3)), rng.normal(size=(N, 3)), rng.uniform(-9.0, 9.0, N)
    rots = [Rotation.random(N, rng=rng) for _ in range(2)]
    quat = np.stack([r.as_quat(scalar_first=True) for r in rots], axis=1)
    axis = rng.normal(size=(N, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    kinds = (wp.vec3, wp.vec4, wp.vec3, wp.vec3, float)
    inputs = [wp.array(a, dtype=kind, device="cpu") for a, kind in zip((pos, quat, v, axis, angle), kinds, strict=True)]
    out = [wp.zeros(N, dtype=kind, device="cpu") for kind in (wp.mat44, wp.mat44, wp.vec3)]
    out.append(wp.zeros((N, 2), dtype=wp.mat33, device="cpu"))
    wp.launch(_all, dim=N, inputs=inputs, outputs=out, device="cpu")
    composed, seen, applied, turns = (a.numpy() for a in out)
    a, b = (RigidTransform.from_components(pos[:, k], rots[k]) for k in range(2))
    np.testing.assert_allclose(composed, (a * b).as_matrix(), atol=5e-6)
    np.testing.assert_allclose(seen, (a.inv() * b).as_matrix(), atol=5e-6)
    np.testing.assert_allclose(applied, a.apply(v), atol=5e-6)
    for k, about in enumerate((np.tile([0.0, 0.0, 1.0], (N, 1)), axis)):
        np.testing.assert_allclose(turns[:, k], Rotation.from_rotvec(about * angle[:, None]).as_matrix(), atol=2e-6)
