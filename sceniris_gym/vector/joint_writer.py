"""`JointWriter`: sets joint positions, at rest and held by their actuators."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from torch import Tensor

from sceniris_gym.sim.rest import history_samples, rest_map


class JointWriter:
    """Writes the positions of some hinges and slides, zero velocities, and what their actuators hold them by.

    That is controls and activations, as a reset writes them.

    Args:
        mjm: The model.
        joints: Ids of the joints.
        device: Torch device.
    """

    def __init__(self, mjm: mujoco.MjModel, joints: Sequence[int], device: torch.device) -> None:
        rest = rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")
        rowadr, qposadr, coef = rest.rowadr.numpy(), rest.qposadr.numpy(), rest.coef.numpy()
        columns = [int(mjm.jnt_qposadr[j]) for j in joints]
        rows = [slice(rowadr[e], rowadr[e + 1]) for e in range(mjm.nu + mjm.na)]
        held = np.array([e for e, row in enumerate(rows) if np.isin(qposadr[row], columns).any()], int)
        matrix = np.zeros((mjm.nq, len(held)))
        for k, e in enumerate(held):
            np.add.at(matrix[:, k], qposadr[rows[e]], coef[rows[e]])
        samples, controls = history_samples(mjm)
        delayed = np.isin(controls, held)
        dofs = [int(mjm.jnt_dofadr[j]) for j in joints]
        self._number = int((held < mjm.nu).sum())
        numbers = (columns, dofs, held[: self._number], held[self._number :] - mjm.nu)
        numbers = (*numbers, samples[delayed], controls[delayed])
        numbers = (torch.as_tensor(np.array(n, int), device=device) for n in numbers)
        self._columns, self._dofs, self._controls, self._activations, self._samples, self._sampled = numbers
        values = (matrix, *(getattr(rest, name).numpy()[held] for name in ("bias", "lower", "upper")))
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
