"""`BaseFrame`: poses and velocities in the frame of the robot's base, which does not move."""

from __future__ import annotations

import mujoco
import numpy as np
import torch
from torch import Tensor

from sceniris_gym.scene.model import SceneModel
from sceniris_gym.vector.rotations import transform

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


class BaseFrame:
    """The frame of the robot's base; the world frame in a scene without a robot.

    A change of frame is linear in position and quaternion, and so is a constant rotation relative to the body. A pose
    therefore takes one product with a 7 x 7 matrix, and a pair of vectors one with a 6 x 6 matrix. The matrices are
    computed once.

    Args:
        scene: The scene; its robot's base does not move.
        device: Torch device.
    """

    def __init__(self, scene: SceneModel, device: torch.device) -> None:
        self._device = device
        position, quat = _base_pose(scene)
        self._to_base = quat * [1.0, -1.0, -1.0, -1.0]
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, self._to_base)
        self._turn = matrix.reshape(3, 3)
        self._offset = self._tensor(np.concatenate([-self._turn @ position, np.zeros(4)]))
        self._pair = self._tensor(_block(self._turn, self._turn))
        self.body = self.seen(UPRIGHT)

    def seen(self, quat: np.ndarray) -> Tensor:
        """Return the map that `pose` takes for a frame turned by `quat` (wxyz) relative to its body, shape (7, 7)."""
        columns = np.zeros((4, 4))
        for column, unit in zip(columns, np.eye(4), strict=True):
            mujoco.mju_mulQuat(column, self._to_base, unit)
            mujoco.mju_mulQuat(column, column.copy(), quat)
        return self._tensor(_block(self._turn, columns.T))

    def pose(self, position: Tensor, quat: Tensor, seen: Tensor | None = None) -> Tensor:
        """Return poses in the base frame, shape (..., 7).

        Args:
            position: Positions in the world frame [m], shape (..., 3).
            quat: Orientations of the bodies in the world frame (wxyz), shape (..., 4).
            seen: A map from `seen`; None is the frame of the body itself.
        """
        return transform(self.body if seen is None else seen, torch.cat([position, quat], dim=-1)) + self._offset

    def vectors(self, first: Tensor, second: Tensor) -> Tensor:
        """Return two vectors of the world frame, each of shape (..., 3), in the base frame: shape (..., 6)."""
        return transform(self._pair, torch.cat([first, second], dim=-1))

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.tensor(array, dtype=torch.float32, device=self._device)


def _block(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    size = len(first) + len(second)
    matrix = np.zeros((size, size))
    matrix[: len(first), : len(first)], matrix[len(first) :, len(first) :] = first, second
    return matrix


def _base_pose(scene: SceneModel) -> tuple[np.ndarray, np.ndarray]:
    """Return position and orientation (wxyz) of the robot's base in the world frame; the identity without a robot."""
    body = scene.bodies.get("robot")
    if body is None:
        return np.zeros(3), UPRIGHT
    data = mujoco.MjData(scene.mjm)
    mujoco.mj_kinematics(scene.mjm, data)
    return data.xpos[body].copy(), data.xquat[body].copy()
