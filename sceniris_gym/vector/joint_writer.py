"""`JointWriter`: sets joint positions, at rest and held by their actuators."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import mujoco_warp as mjw
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.sim.rest import RestMap
from sceniris_gym.sim.write import StateWriter, poses_of


class JointWriter:
    """Writer of positions of some hinges and slides, of zero velocities, and of what their actuators hold them by.

    These controls and activations are those that a reset writes; delayed actuators find them in their histories, too.

    Args:
        mjm: The model.
        d: Data of the worlds.
        rest: The controls and activations that hold a pose in each world.
        joints: Ids of the joints.
    """

    def __init__(self, mjm: mujoco.MjModel, d: mjw.Data, rest: RestMap, joints: Sequence[int]) -> None:
        self._qpos = wp.to_torch(d.qpos)
        self._columns = torch.tensor(mjm.jnt_qposadr[list(joints)], dtype=torch.int64, device=self._qpos.device)
        self._mask = torch.zeros(d.nworld, dtype=torch.bool, device=self._qpos.device)
        self._writer = StateWriter(mjm, d, wp.from_torch(self._mask, dtype=wp.bool), rest, joints=joints)
        self._poses = poses_of(d)

    def write(self, qpos: Tensor, mask: Tensor) -> None:
        """Set the joints of masked worlds to `qpos`, shape (num_envs, njoint); the other worlds keep theirs."""
        self._mask.copy_(mask)
        self._qpos[:, self._columns] = torch.where(mask[:, None], qpos, self._qpos[:, self._columns])
        self._writer.launch(self._poses)
