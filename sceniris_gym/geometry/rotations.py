"""Unit quaternions (wxyz) and poses as matrices, computed by MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np


def matrix(quat: np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a wxyz quaternion."""
    mat = np.empty(9)
    mujoco.mju_quat2Mat(mat, np.asarray(quat, float))
    return mat.reshape(3, 3)


def pose_matrix(pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Return a pose, position [m] and wxyz quaternion, as a homogeneous matrix (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix(quat), pos
    return pose


def product(first: np.ndarray, then: np.ndarray) -> np.ndarray:
    """Return the product of two wxyz quaternions."""
    quat = np.empty(4)
    mujoco.mju_mulQuat(quat, first, then)
    return quat


def of_angles(angles: np.ndarray) -> np.ndarray:
    """Return the wxyz quaternion of turns by angles [rad], shape (3,), about x, then y, then z of the fixed frame."""
    quat = np.empty(4)
    mujoco.mju_euler2Quat(quat, angles, "XYZ")
    return quat


def quaternion(mat: np.ndarray) -> np.ndarray:
    """Return the wxyz quaternion of a rotation matrix (3, 3)."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(mat, float).ravel())
    return quat
