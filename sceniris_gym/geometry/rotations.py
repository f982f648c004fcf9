"""Unit quaternions (wxyz) and poses as matrices, computed by MuJoCo."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np


def matrix(quat: np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a wxyz quaternion."""
    return _computed(9, mujoco.mju_quat2Mat, np.asarray(quat, float)).reshape(3, 3)


def pose_matrix(pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Return a pose, position [m] and wxyz quaternion, as a homogeneous matrix (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix(quat), pos
    return pose


def product(first: np.ndarray, then: np.ndarray) -> np.ndarray:
    """Return the product of two wxyz quaternions."""
    return _computed(4, mujoco.mju_mulQuat, first, then)


def of_angles(angles: np.ndarray) -> np.ndarray:
    """Return the wxyz quaternion of rotations by angles [rad], (3,), about x, then y, then z of the fixed frame."""
    return _computed(4, mujoco.mju_euler2Quat, angles, "XYZ")


def quaternion(mat: np.ndarray) -> np.ndarray:
    """Return the wxyz quaternion of a rotation matrix (3, 3)."""
    return _computed(4, mujoco.mju_mat2Quat, np.ascontiguousarray(mat, float).ravel())


def _computed(size: int, function: Callable[..., None], *inputs: Any) -> np.ndarray:
    """Call a function of MuJoCo, and return the result, shape (size,), that it writes into its first argument."""
    result = np.empty(size)
    function(result, *inputs)
    return result
