"""Converts and multiplies rotations and poses with MuJoCo. Quaternions are unit quaternions (wxyz)."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np


def matrix(quat: np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a wxyz quaternion."""
    return _computed(9, mujoco.mju_quat2Mat, np.asarray(quat, float)).reshape(3, 3)


def pose_matrix(pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Return the pose with a position [m] and a wxyz quaternion as a homogeneous matrix (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix(quat), pos
    return pose


def product(first: np.ndarray, then: np.ndarray) -> np.ndarray:
    """Return the product first * then of two wxyz quaternions."""
    return _computed(4, mujoco.mju_mulQuat, first, then)


def of_angles(angles: np.ndarray) -> np.ndarray:
    """Rotate about the fixed x axis, then y, then z, by `angles` [rad], shape (3,). Return the wxyz quaternion."""
    return _computed(4, mujoco.mju_euler2Quat, angles, "XYZ")


def quaternion(mat: np.ndarray) -> np.ndarray:
    """Return the wxyz quaternion of a rotation matrix (3, 3)."""
    return _computed(4, mujoco.mju_mat2Quat, np.ascontiguousarray(mat, float).ravel())


def _computed(size: int, function: Callable[..., None], *inputs: Any) -> np.ndarray:
    """Call a MuJoCo function that writes its result into its first argument, and return this result, shape (size,)."""
    result = np.empty(size)
    function(result, *inputs)
    return result
