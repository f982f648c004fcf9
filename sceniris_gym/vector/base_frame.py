"""`BaseFrame`: the frame of a fixed robot base. `DrawnBaseFrame`: the frame of a base that each layout places."""

import mujoco
import numpy as np
import torch
from torch import Tensor

from sceniris_gym.geometry.rotations import matrix, product
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.vector.rotations import conjugate, multiply, rotate, transform

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


class BaseFrame:
    """The frame of the robot's base, or the world frame in a scene without a robot or with several robots.

    A change of frame is affine in position and quaternion, so its matrices are computed once. Then a pose takes one
    product with a 7 x 7 matrix, and a pair of vectors takes one product with a 6 x 6 matrix. The 7 x 7 matrix can also
    contain a constant rotation relative to the body, such as the rotation of a site.

    Args:
        mjm: The model.
        body: Id of the base, which does not move, or 0 for the world frame.
        device: Torch device.
    """

    def __init__(self, mjm: mujoco.MjModel, body: int, device: torch.device) -> None:
        self._device = device
        data = mujoco.MjData(mjm)
        mujoco.mj_kinematics(mjm, data)
        position, quat = data.xpos[body].copy(), data.xquat[body].copy()
        self._to_base = quat * [1.0, -1.0, -1.0, -1.0]
        self._turn = matrix(self._to_base)
        self._offset = self._tensor(np.concatenate([-self._turn @ position, np.zeros(4)]))
        self._pair = torch.block_diag(self._tensor(self._turn), self._tensor(self._turn))
        self.body = self.seen(UPRIGHT)

    def seen(self, quat: np.ndarray) -> Tensor:
        """Return the matrix (7, 7) that `pose` takes as `seen`, for frames rotated by `quat` (wxyz) from their bodies.

        The matrix converts the pose of such a body in the world frame to the pose of the rotated frame in the base
        frame. `pose` then adds an offset, because the matrix leaves out the base's position.
        """
        columns = [product(product(self._to_base, unit), quat) for unit in np.eye(4)]
        return torch.block_diag(self._tensor(self._turn), self._tensor(np.stack(columns, axis=1)))

    def pose(self, position: Tensor, quat: Tensor, seen: Tensor | None = None) -> Tensor:
        """Return poses in the base frame, shape (..., 7).

        Args:
            position: Positions in the world frame [m], shape (..., 3).
            quat: Orientations of the bodies in the world frame (wxyz), shape (..., 4).
            seen: What the method `seen` returned for a frame that is rotated relative to its body, such as a site. If
                None, the result has the poses of the bodies.
        """
        return transform(self.body if seen is None else seen, torch.cat([position, quat], dim=-1)) + self._offset

    def to_world(self, pose: Tensor) -> Tensor:
        """Convert poses of bodies from the base frame to the world frame, as the inverse of `pose`, shape (..., 7)."""
        return transform(self.body.T, pose - self._offset)

    def vectors(self, first: Tensor, second: Tensor) -> Tensor:
        """Convert two vectors (..., 3) from the world frame to the base frame, joined to shape (..., 6)."""
        return transform(self._pair, torch.cat([first, second], dim=-1))

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.tensor(array, dtype=torch.float32, device=self._device)


class DrawnBaseFrame(BaseFrame):
    """The frame of a robot base that has a separate pose in each world.

    Args:
        position: Positions of the base [m], shape (num_envs, 3). A view of the simulation's state.
        quat: Orientations of the base (wxyz), shape (num_envs, 4). Also a view.
    """

    def __init__(self, position: Tensor, quat: Tensor) -> None:
        self._device, self._at, self._turned = position.device, position, quat
        self.body = self.seen(UPRIGHT)

    def seen(self, quat: np.ndarray) -> Tensor:
        """Return the argument `seen` of `pose`, (4,), for a frame rotated by `quat` (wxyz) from its body."""
        return self._tensor(quat)

    def pose(self, position: Tensor, quat: Tensor, seen: Tensor | None = None) -> Tensor:
        """Return poses in the base frame, as `BaseFrame.pose` does. The first axis is the world index."""
        at, back = self._over(self._at, position), conjugate(self._over(self._turned, quat))
        turned = multiply(multiply(back, quat), self.body if seen is None else seen)
        return torch.cat([rotate(back, position - at), turned], dim=-1)

    def to_world(self, pose: Tensor) -> Tensor:
        """Convert poses of bodies to the world frame, as `BaseFrame.to_world` does."""
        at, turned = self._over(self._at, pose), self._over(self._turned, pose)
        return torch.cat([at + rotate(turned, pose[..., :3]), multiply(turned, pose[..., 3:])], dim=-1)

    def vectors(self, first: Tensor, second: Tensor) -> Tensor:
        """Convert two vectors to the base frame, as `BaseFrame.vectors` does."""
        back = conjugate(self._over(self._turned, first))
        return torch.cat([rotate(back, first), rotate(back, second)], dim=-1)

    def _over(self, base: Tensor, values: Tensor) -> Tensor:
        """Return `base`, shape (num_envs, m), reshaped to broadcast against `values`, shape (num_envs, ..., n)."""
        return base.reshape(len(base), *[1] * (values.ndim - 2), base.shape[-1])


def base_frame(scene: SceneModel, device: torch.device, xpos: Tensor, xquat: Tensor) -> BaseFrame:
    """Return the base frame of a scene's only robot, or the world frame if the scene has no robot or several robots.

    Args:
        scene: The scene.
        device: Torch device.
        xpos: Positions of all bodies [m], shape (num_envs, nbody, 3). A view of the simulation's state.
        xquat: Orientations of all bodies (wxyz), shape (num_envs, nbody, 4). Also a view.
    """
    robots = list(scene.config.all_robots)
    if len(robots) != 1:
        return BaseFrame(scene.mjm, 0, device)
    body = scene.bodies[robots[0]]
    if robots[0] in scene.config.parts:
        return DrawnBaseFrame(xpos[:, body], xquat[:, body])
    return BaseFrame(scene.mjm, body, device)
