"""`PositionActuators`: the position actuators of some joints, found by what they move, as targets of these joints."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import ArmError
from sceniris_gym.reach.arm import joint_label
from sceniris_gym.sim.rest import affine_law, rest_map
from sceniris_gym.sim.versions import actuator_controls
from sceniris_gym.vector.readings import as_columns


class PositionActuators:
    """The position actuators of some joints, one each, whatever their names, gears and tendons.

    A control `bias + scale * q` holds its joint at q (see `rest_map`).

    Args:
        mjm: The model.
        joints: Ids of the joints.
        device: Torch device.
        where: Begins errors.

    Attributes:
        lower, upper: Limits of the targets [rad or m], those of the controls and of the joints, shape (njoint,).

    Raises:
        ArmError: A joint that has no position actuator of its own, or several.
    """

    def __init__(self, mjm: mujoco.MjModel, joints: Sequence[int], device: torch.device, where: str) -> None:
        def tensor(values: np.ndarray) -> Tensor:
            return torch.tensor(values, dtype=torch.float32, device=device)

        rest = rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")
        (constants, matrix), controls, columns = affine_law(rest, mjm.nq), [], mjm.jnt_qposadr[list(joints)]
        alone = np.count_nonzero(matrix[: mjm.nu], axis=1) == 1
        owner = np.repeat(np.arange(len(mjm.actuator_trntype)), actuator_controls(mjm)[1])
        for joint, column in zip(joints, columns, strict=True):
            found = np.flatnonzero(alone & (matrix[: mjm.nu, column] != 0.0)).tolist()
            _check_number(mjm, joint, [int(owner[e]) for e in found], where)
            controls += found
        self._mjm, self._joints, self._actuators = mjm, list(joints), owner[controls]
        self._scale, bias = matrix[controls, columns], constants[controls]
        ends = np.sort(
            [(limit[controls] - bias) / self._scale for limit in (rest.lower.numpy(), rest.upper.numpy())], axis=0
        )
        limited = mjm.jnt_limited[self._joints].astype(bool)[:, None]
        own = np.where(limited, mjm.jnt_range[self._joints], [-np.inf, np.inf]).T
        self.lower, self.upper = tensor(np.maximum(ends[0], own[0])), tensor(np.minimum(ends[1], own[1]))
        self._columns = as_columns(controls, device)
        self._law = tensor(bias), tensor(self._scale)

    def targets(self, ctrl: Tensor) -> Tensor:
        """Return the targets that controls (num_envs, nu) stand for [rad or m], shape (num_envs, njoint)."""
        bias, scale = self._law
        return (ctrl[:, self._columns] - bias) / scale

    def set_targets(self, ctrl: Tensor, targets: Tensor) -> None:
        """Write the controls of targets (num_envs, njoint), kept within their limits, into `ctrl` (num_envs, nu)."""
        bias, scale = self._law
        ctrl[:, self._columns] = bias + scale * targets.clamp(self.lower, self.upper)

    def full_leads(self, speed: np.ndarray) -> np.ndarray:
        """Return how far joints lag behind their targets at full force and speed [rad or m], shape (njoint,).

        The joint's damping d alone then balances the full torque T, so the speed is v = T / d. With the gear g from
        joint to actuator, the actuator's own law T / g = kp g lead - kv g v gives lead = T / (kp g^2) + kv v / kp. The
        lead is infinite where nothing limits the force.

        Args:
            speed: The full speed of joints without damping [rad/s or m/s], shape (njoint,).
        """
        mjm, i, joints = self._mjm, self._actuators, self._joints
        stiffness, speed_gain = -mjm.actuator_biasprm[i, 1], -mjm.actuator_biasprm[i, 2]
        gear = np.abs(self._scale * mjm.actuator_gainprm[i, 0] / stiffness)
        force = np.where(mjm.actuator_forcelimited[i], mjm.actuator_forcerange[i, 1], np.inf)
        own = np.where(mjm.jnt_actfrclimited[joints], mjm.jnt_actfrcrange[joints, 1], np.inf)
        torque = np.minimum(force * gear, own)
        damping = mjm.dof_damping[mjm.jnt_dofadr[joints]]
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = np.where(damping > 0.0, torque / damping, speed)
            lag = np.where(speed_gain > 0.0, speed_gain * speed / stiffness, 0.0)
        return torque / (stiffness * gear**2) + lag


def _check_number(mjm: mujoco.MjModel, joint: int, found: Sequence[int], where: str) -> None:
    """Check that one position actuator of those that were found moves a joint."""
    if len(found) == 1:
        return
    name = mjm.joint(joint).name
    if found:
        names = ", ".join(repr(mjm.actuator(i).name or i) for i in found)
        has = f"has {len(found)}: {names}. Keep one of them."
    else:
        add = "Add" if name else "Name it, and add"
        has = f"has none. {add} <position joint='{name or '...'}' kp='...' ctrlrange='...'/>."
    raise ArmError(f"{where}: {joint_label(mjm, joint)} should have one position actuator of its own, but {has}")
