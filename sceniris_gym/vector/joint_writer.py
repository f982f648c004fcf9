"""`JointWriter`: sets joint positions, at rest and held by their actuators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import torch
from torch import Tensor

from sceniris_gym.sim.control_history import history_samples
from sceniris_gym.sim.write import rest_map


class Holding(NamedTuple):
    """The controls, and after them the activations, that hold joints at rest: `matrix @ qpos + bias`, within limits.

    Attributes:
        matrix: Shape (nu + na, nq); a row of zeros where nothing is held.
        bias: Shape (nu + na,).
        lower: Lower limits, shape (nu + na,).
        upper: Upper limits, shape (nu + na,).
    """

    matrix: np.ndarray
    bias: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, mjm: mujoco.MjModel) -> Holding:
        """Return those of a model; see `rest_map` for which actuators hold anything."""
        rest = rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")
        matrix = np.zeros((mjm.nu + mjm.na, mjm.nq))
        rows = np.repeat(np.arange(len(matrix)), np.diff(rest.rowadr.numpy()))
        np.add.at(matrix, (rows, rest.qposadr.numpy()), rest.coef.numpy())
        return cls(matrix, rest.bias.numpy(), rest.lower.numpy(), rest.upper.numpy())


class JointWriter:
    """Writer of positions of some hinges and slides, of zero velocities, and of what their actuators hold them by.

    These controls and activations are those that a reset writes.

    Args:
        mjm: The model.
        joints: Ids of the joints.
        device: Torch device.
    """

    def __init__(self, mjm: mujoco.MjModel, joints: Sequence[int], device: torch.device) -> None:
        holding, columns = Holding.of(mjm), [int(mjm.jnt_qposadr[j]) for j in joints]
        held = np.flatnonzero(holding.matrix[:, columns].any(axis=1))
        samples, controls = history_samples(mjm)
        delayed = np.isin(controls, held)
        dofs = [int(mjm.jnt_dofadr[j]) for j in joints]
        self._number = int((held < mjm.nu).sum())
        numbers = (columns, dofs, held[: self._number], held[self._number :] - mjm.nu)
        numbers = (*numbers, samples[delayed], controls[delayed])
        numbers = (torch.as_tensor(np.array(n, int), device=device) for n in numbers)
        self._columns, self._dofs, self._controls, self._activations, self._samples, self._sampled = numbers
        values = (holding.matrix[held].T, holding.bias[held], holding.lower[held], holding.upper[held])
        floats = (torch.tensor(v, dtype=torch.float32, device=device) for v in values)
        self._matrix, self._bias, self._lower, self._upper = floats

    def write(
        self,
        qpos: Tensor,
        qvel: Tensor,
        ctrl: Tensor,
        act: Tensor,
        values: Tensor,
        mask: Tensor,
        history: Tensor | None = None,
    ) -> None:
        """Set the joints of masked worlds to `values` (num_envs, njoint), in place; the other worlds keep theirs.

        `history` is the data's, in which delayed actuators find their controls; a model without delays needs none.
        """
        mask = mask[:, None]
        qpos[:, self._columns] = torch.where(mask, values, qpos[:, self._columns])
        qvel[:, self._dofs] = torch.where(mask, 0.0, qvel[:, self._dofs])
        holding = (qpos @ self._matrix + self._bias).clamp(self._lower, self._upper)
        ctrl[:, self._controls] = torch.where(mask, holding[:, : self._number], ctrl[:, self._controls])
        act[:, self._activations] = torch.where(mask, holding[:, self._number :], act[:, self._activations])
        if history is not None and len(self._samples):
            history[:, self._samples] = torch.where(mask, ctrl[:, self._sampled], history[:, self._samples])
