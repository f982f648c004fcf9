"""Quaternions in torch, against MuJoCo and SciPy."""

from __future__ import annotations

import mujoco
import numpy as np
import torch
from scipy.spatial.transform import Rotation

from sceniris_gym.vector import rotations


def test_rotations_agree_with_mujoco():
    """Products, inverses and rotated vectors, one quaternion for many vectors included."""
    rng = np.random.default_rng(0)
    left, right = rng.normal(size=(2, 5, 4))
    left, right = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in (left, right))
    vectors = rng.normal(size=(5, 3))
    product, rotated, back = np.zeros((5, 4)), np.zeros((5, 3)), np.zeros((5, 3))
    for i in range(5):
        mujoco.mju_mulQuat(product[i], left[i], right[i])
        mujoco.mju_rotVecQuat(rotated[i], vectors[i], left[i])
        mujoco.mju_rotVecQuat(back[i], vectors[i], left[0])
    t = torch.as_tensor
    np.testing.assert_allclose(rotations.multiply(t(left), t(right)).numpy(), product, atol=1e-12)
    np.testing.assert_allclose(rotations.rotate(t(left), t(vectors)).numpy(), rotated, atol=1e-12)
    np.testing.assert_allclose(rotations.rotate(t(left[0]), t(vectors)).numpy(), back, atol=1e-12)
    inverse = rotations.conjugate(t(left))
    np.testing.assert_allclose(rotations.rotate(inverse, t(rotated)).numpy(), vectors, atol=1e-12)


def drawn(*shape: int, seed: int = 0) -> tuple[np.ndarray, Rotation]:
    """Return unit quaternions wxyz of a shape, and the same rotations in one row for SciPy."""
    quat = np.random.default_rng(seed).normal(size=(*shape, 4))
    quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
    return quat, Rotation.from_quat(np.roll(quat.reshape(-1, 4), -1, axis=1))


def test_products_of_any_shapes_agree_with_scipy():
    """A row of rotations times a column of them: each with each, as matrices."""
    left, of_left = drawn(3, 1)
    right, of_right = drawn(1, 4, seed=1)
    found = rotations.multiply(torch.as_tensor(left), torch.as_tensor(right)).numpy()
    assert found.shape == (3, 4, 4)
    for i in range(3):
        for j in range(4):
            turned = Rotation.from_quat(np.roll(found[i, j], -1)).as_matrix()
            np.testing.assert_allclose(turned, (of_left[i] * of_right[j]).as_matrix(), atol=1e-12)


def test_rotation_vectors_of_any_length_are_those_of_scipy():
    """0 and beyond a full turn included."""
    vectors = np.random.default_rng(3).normal(size=(9, 3)) * np.linspace(0.0, 9.0, 9)[:, None]
    found = rotations.of_vector(torch.as_tensor(vectors).reshape(3, 3, 3)).reshape(9, 4).numpy()
    turned = Rotation.from_quat(np.roll(found, -1, axis=1)).as_matrix()
    np.testing.assert_allclose(turned, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-12)


def test_matrices_and_vectors_of_any_shapes_are_multiplied():
    """One matrix for many vectors, and one each; not square either."""
    rng = np.random.default_rng(2)
    matrix, vector = rng.normal(size=(5, 2, 3)), rng.normal(size=(5, 3))
    t = torch.as_tensor
    each = rotations.transform(t(matrix), t(vector)).numpy()
    np.testing.assert_allclose(each, np.stack([m @ v for m, v in zip(matrix, vector, strict=True)]))
    np.testing.assert_allclose(rotations.transform(t(matrix[0]), t(vector)).numpy(), vector @ matrix[0].T)


def test_what_was_first_used_under_inference_mode_has_gradients_later():
    """A product in an evaluation does not spoil those in a training."""
    rotations._product.cache_clear()
    one = torch.tensor([1.0, 0.0, 0.0, 0.0])
    with torch.inference_mode():
        rotations.multiply(one, one)
    learnt = torch.tensor([0.6, 0.8, 0.0, 0.0], requires_grad=True)
    rotations.multiply(one, learnt).sum().backward()
    assert learnt.grad is not None
    np.testing.assert_allclose(learnt.grad.numpy(), 1.0)
