"""Matrices of quaternions and poses, against scipy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sceniris_gym.geometry.rotations import matrix, pose_matrix


def test_matrices_are_those_of_scipy():
    """Rotations and poses of random quaternions."""
    for quat in np.random.default_rng(0).normal(size=(20, 4)):
        unit = quat / np.linalg.norm(quat)
        wanted = Rotation.from_quat(unit[[1, 2, 3, 0]]).as_matrix()
        np.testing.assert_allclose(matrix(unit), wanted, atol=1e-12)
        pose = pose_matrix(np.array([1.0, 2.0, 3.0]), unit)
        np.testing.assert_allclose(pose[:3, :3], wanted, atol=1e-12)
        np.testing.assert_array_equal(pose[:, 3], [1.0, 2.0, 3.0, 1.0])
        np.testing.assert_array_equal(pose[3], [0.0, 0.0, 0.0, 1.0])
