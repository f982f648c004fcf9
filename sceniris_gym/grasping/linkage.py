"""Grippers with closed loops: positions of the joints in the loops, as polynomials of joints that actuators drive.

Equalities such as `<connect>` close the loops. Newton steps find the positions that satisfy them. In a loop that leaves
a joint free, springs move the joint as far as its limits allow.
"""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.scene.couplings import Coupling, active_equalities, couple, equality_errors, equality_label, follow

_NODES = 17  # positions of a driven joint at which the loops are closed
# Weights of a spring and of the last position, relative to an equality. They move a joint only if the loop does not.
_SPRING, _LAST = 1.0e-5, 1.0e-7
_MOVES = 1.0e-6  # a joint belongs to a loop if it changes an equality by more than this [m/rad]
_KEPT = 1e-4  # m or rad, by which the error of an equality may exceed its error in the start pose
_DISABLED = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)


def loop_couplings(
    mjm: mujoco.MjModel, fingers: np.ndarray, couplings: Sequence[Coupling], home: np.ndarray
) -> tuple[Coupling, ...]:
    """Return couplings that keep the loops of a gripper closed, for joints that no actuator drives.

    A joint in a loop follows the driven joint that moves it farthest. Without a driven joint, the result is empty.

    Args:
        mjm: The model.
        fingers: Ids of the hand's hinges and slides, without joints of the arm.
        couplings: Joints that follow others by the model's joint equalities.
        home: A pose of the model that satisfies the couplings, shape (nq,).
    """
    if all(mjm.eq_type[eq] == mujoco.mjtEq.mjEQ_JOINT for eq in active_equalities(mjm)):
        return ()
    loops = _Loops(mjm, fingers, couplings, home)
    if not loops.driven or not len(loops.passive):
        return ()
    (nodes, paths), found = zip(*(loops.path(driver) for driver in loops.driven), strict=True), []
    for joint, own in zip(loops.passive.tolist(), np.moveaxis(np.array(paths), 2, 0), strict=True):
        i = int(np.ptp(own, axis=1).argmax())
        origin, label = float(nodes[i].mean()), f"the loop of joint '{mjm.joint(joint).name}'"
        offset, a1, a2, a3, a4 = np.polyfit(nodes[i] - origin, own[i], 4)[::-1].tolist()
        coupling = couple(mjm, label, joint, loops.driven[i], origin, offset, (a1, a2, a3, a4))
        found.append(coupling._replace(limits=(-np.inf, np.inf)))  # poses are within the limits
    return tuple(found)


def check_loops(
    mjm: mujoco.MjModel, arm: str, home: np.ndarray, couplings: Sequence[Coupling], adr: np.ndarray, poses: np.ndarray
) -> None:
    """Check that opening a gripper keeps the model's equalities.

    Args:
        mjm: The model.
        arm: Name of the arm, for the error.
        home: A pose of the model, shape (nq,).
        couplings: Couplings of the joints that follow finger joints.
        adr: Addresses in qpos of the finger joints and their followers, shape (nfinger,).
        poses: Positions of these joints [m or rad] from closed to open, shape (n, nfinger).

    Raises:
        NotSupportedError: A pose violates an equality.
    """
    qpos = home.copy()
    follow(couplings, qpos)
    states = np.tile(qpos, (len(poses), 1))
    states[:, adr] = poses
    missed = equality_errors(mjm, states)
    for row, eq in np.argwhere(missed > equality_errors(mjm, qpos[None]) + _KEPT):
        raise NotSupportedError(
            f"arm '{arm}': opening its gripper would break {equality_label(mjm, eq)} by {missed[row, eq]:.3g} "
            "m or rad, because no actuator drives the loop through all of its joints' ranges. Add an actuator of a "
            "joint in the loop and limit this joint to the way from open to closed, add an <equality><joint> that "
            "moves the finger joints in the same way, or leave out 'reachable'."
        )


class _Loops:
    """The closed loops of a hand.

    Args:
        mjm: The model.
        fingers: Ids of the hand's hinges and slides, without joints of the arm.
        couplings: Joints that follow others by the model's joint equalities.
        home: A pose of the model that satisfies the couplings, shape (nq,).

    Attributes:
        passive: Ids of the joints in loops that neither follow others nor are driven, shape (npassive,).
        driven: Ids of the joints with limits that actuators drive, at the joint, by a tendon or by followers.
    """

    def __init__(
        self, mjm: mujoco.MjModel, fingers: np.ndarray, couplings: Sequence[Coupling], home: np.ndarray
    ) -> None:
        self._mjm, self._couplings, self._home = copy.copy(mjm), couplings, home
        self._rows = np.zeros(0, int)
        self._mjm.opt.disableflags |= _DISABLED
        self._mjm.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self._data = mujoco.MjData(self._mjm)
        self._missed(home)
        data, dofs = self._data, mjm.jnt_dofadr[fingers]
        jacobian = np.abs(data.efc_J.reshape(-1, mjm.nv)[: data.nefc][:, dofs]) > _MOVES
        loops = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & jacobian.any(axis=1)
        loops &= mjm.eq_type[data.efc_id * loops] != mujoco.mjtEq.mjEQ_JOINT
        self._rows = np.flatnonzero(loops)
        driven = set(mjm.dof_jntid[data.moment_colind[: data.moment_rownnz.sum()]].tolist())
        for c in reversed(couplings):
            if c.follower in driven and c.driver is not None:
                driven.add(c.driver)
        free = ~np.isin(fingers, [c.follower for c in couplings])
        is_driven = np.isin(fingers, list(driven))
        self.passive = fingers[free & ~is_driven & jacobian[loops].any(axis=0)]
        self.driven = fingers[free & is_driven & mjm.jnt_limited[fingers].astype(bool)].tolist()

    def path(self, driver: int) -> tuple[np.ndarray, np.ndarray]:
        """Move a driven joint through its range, and return positions of the joint and of the passive joints.

        Returns:
            Positions of the driven joint [m or rad], shape (n,), and of the passive joints, shape (n, npassive).
        """
        adr, own = self._mjm.jnt_qposadr[driver], self._mjm.jnt_qposadr[self.passive]
        low, high = self._mjm.jnt_range[driver]
        # Chebyshev's nodes give the least error of a fit
        nodes = 0.5 * (low + high) + 0.5 * (high - low) * np.polynomial.chebyshev.chebpts1(_NODES)
        found, first = np.zeros((_NODES, len(own))), int(np.searchsorted(nodes, self._home[adr]))
        for order in (range(first, _NODES), range(first - 1, -1, -1)):  # away from home, each from the one before
            qpos = self._home.copy()
            for i in order:
                qpos[adr] = nodes[i]
                found[i] = qpos[own] = self._closed(qpos)
        return nodes, found

    def _closed(self, qpos: np.ndarray) -> np.ndarray:
        """Return the positions of the passive joints that close the loops, shape (npassive,), starting from `qpos`."""
        from scipy.optimize import least_squares  # a scene from the cache does not need it

        mjm, qpos = self._mjm, qpos.copy()
        own = mjm.jnt_qposadr[self.passive]
        last, rest, stiff = qpos[own], mjm.qpos_spring[own], mjm.jnt_stiffness[self.passive]
        spring = _SPRING * np.sqrt(stiff / max(stiff.max(), 1e-9))
        limited = mjm.jnt_limited[self.passive].astype(bool)
        low, high = np.where(limited, mjm.jnt_range[self.passive].T, [[-np.inf], [np.inf]])

        def misses(x: np.ndarray) -> np.ndarray:
            qpos[own] = x
            return np.concatenate([self._missed(qpos), spring * (x - rest), _LAST * (x - last)])

        start = np.clip(last, low, high)
        return least_squares(misses, start, bounds=(low, high), xtol=1e-12, ftol=1e-12, gtol=1e-14).x

    def _missed(self, qpos: np.ndarray) -> np.ndarray:
        """Return the errors [m or rad] of the equalities that close the loops, shape (nrow,)."""
        self._data.qpos[:] = qpos
        follow(self._couplings, self._data.qpos)
        mujoco.mj_fwdPosition(self._mjm, self._data)
        return self._data.efc_pos[self._rows]
