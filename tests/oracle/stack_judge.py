"""MuJoCo C as the judge of what stands: free bodies should stay where a layout has them."""

from __future__ import annotations

import copy
from collections.abc import Iterable

import mujoco
import numpy as np

STILL = 0.01
"""Greatest motion [m] of a body that stands."""
SECONDS = 0.5
"""Time [s] that it is watched."""
_FAR = 1000.0
"""Distance [m] at which a body is out of the way of all others."""


class StackJudge:
    """Replays states of a model.

    Args:
        mjm: The model.

    Attributes:
        bodies: Ids of the bodies with a free joint.
    """

    def __init__(self, mjm: mujoco.MjModel) -> None:
        self._mjm = copy.copy(mjm)
        self._mjm.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # 4.0.0 factorises sparse ones wrongly
        free = mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        self.bodies = mjm.jnt_bodyid[free]
        self._adr = mjm.jnt_qposadr[free]
        self._data = mujoco.MjData(self._mjm)

    def moves(
        self, qpos: np.ndarray, mocap_pos: np.ndarray, mocap_quat: np.ndarray, away: Iterable[int] = ()
    ) -> np.ndarray:
        """Return how far the frame or the centre of mass of each free body gets [m], shape (nfree,).

        Where MuJoCo resets the state, because something becomes too fast, the motion is infinite.

        Args:
            qpos: Joint positions, shape (nq,).
            mocap_pos: Positions of mocap bodies [m], shape (nmocap, 3).
            mocap_quat: Their orientations, shape (nmocap, 4).
            away: Ids of free bodies that are not there; their motion is 0.
        """
        mjm, data = self._mjm, self._data
        mujoco.mj_resetData(mjm, data)
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = qpos, mocap_pos, mocap_quat
        gone = np.isin(self.bodies, list(away))
        for k, adr in enumerate(self._adr[gone]):
            data.qpos[adr : adr + 3] = _FAR * (k + 1), _FAR, _FAR
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_comPos(mjm, data)
        before = self._places(data)
        nstep = round(SECONDS / mjm.opt.timestep)
        mujoco.mj_step(mjm, data, nstep)
        if data.time < (nstep - 0.5) * mjm.opt.timestep:  # MuJoCo has reset what became too fast
            return np.where(gone, 0.0, np.inf)
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_comPos(mjm, data)
        return np.where(gone, 0.0, np.linalg.norm(self._places(data) - before, axis=-1).max(axis=0))

    def _places(self, data: mujoco.MjData) -> np.ndarray:
        """Return the frames' origins and the centres of mass of the free bodies [m], shape (2, nfree, 3)."""
        return np.stack([data.xpos[self.bodies], data.xipos[self.bodies]])
