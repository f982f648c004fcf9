"""Matrices of quaternions and poses, against scipy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sceniris_gym.geometry.rotations import matrix, of_angles, pose_matrix, product, quaternion


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


def test_products_are_those_of_scipy():
    """Of random pairs, by their matrices; back to quaternions, signs apart."""
    for pair in np.random.default_rng(1).normal(size=(20, 2, 4)):
        first, then = pair / np.linalg.norm(pair, axis=1, keepdims=True)
        wanted = (Rotation.from_quat(first[[1, 2, 3, 0]]) * Rotation.from_quat(then[[1, 2, 3, 0]])).as_matrix()
        found = product(first, then)
        np.testing.assert_allclose(matrix(found), wanted, atol=1e-12)
        assert abs(quaternion(wanted) @ found) > 1.0 - 1e-12


def test_angles_turn_about_fixed_axes():
    """About x first, then y, then z."""
    for angles in np.random.default_rng(2).uniform(-np.pi, np.pi, (20, 3)):
        wanted = Rotation.from_euler("xyz", angles).as_matrix()
        np.testing.assert_allclose(matrix(of_angles(angles)), wanted, atol=1e-12)
