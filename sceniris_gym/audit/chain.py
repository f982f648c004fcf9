"""Forward and inverse kinematics in torch, with which the audit judges the reach of an arm.

Nothing is shared with reach/solve.py, the kinematics in Warp of resets and maps. The chain is one of
pytorch-kinematics, made from the bodies of an MjModel. The MJCF reader of that library does not do: it fails on joints
under MuJoCo 4, supports one joint per body, and gives hinges without limits the range (0, 0).
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytorch_kinematics as pk
import torch
from pytorch_kinematics.frame import Frame, Joint, Link

from sceniris_gym.audit.geometry import frame

POSITION = 1e-3
"""Greatest distance [m] of the TCP from a pose that counts as reached."""
ROTATION = np.radians(0.5)
"""Greatest angle [rad] between the two."""
# A radian of error counts as much as this many metres, about half the length of an arm's link.
_LEVER = 0.3
# Damping of a step: a share of the squared error, plus a constant for singular poses.
_DAMPING, _LEAST_DAMPING = 0.1, 1.0e-6
_LONGEST_STEP = 1.0  # [rad, m]


class Chain:
    """The kinematics of an arm, for batches, in float64. Forward kinematics agree with MuJoCo's to 1e-14 m.

    Args:
        mjm: The model with the arm.
        root: Id of the arm's base body.
        site: Id of the site that is its TCP.

    Attributes:
        joints: Ids of its n joints, from the base to the TCP, shape (n,).
        lower, upper: Their limits [rad, m], shape (n,). -inf and inf without limits.
    """

    def __init__(self, mjm: mujoco.MjModel, root: int, site: int) -> None:
        self.joints = joints_between(mjm, root, int(mjm.site_bodyid[site]))
        limited = mjm.jnt_limited[self.joints].astype(bool)
        low, high = mjm.jnt_range[self.joints].T
        self.lower = torch.as_tensor(np.where(limited, low, -np.inf))
        self.upper = torch.as_tensor(np.where(limited, high, np.inf))
        self._ref = torch.as_tensor(mjm.qpos0[mjm.jnt_qposadr[self.joints]])
        self._slide = torch.as_tensor(mjm.jnt_type[self.joints] == mujoco.mjtJoint.mjJNT_SLIDE)
        self.serial = pk.SerialChain(_tree(mjm, root, site), "tcp", dtype=torch.float64)

    def fk(self, q: torch.Tensor) -> torch.Tensor:
        """Return poses of the TCP in the base frame, shape (N, 4, 4), at joints of shape (N, n) [rad, m]."""
        return self.serial.forward_kinematics_tensor(q - self._ref)[-1]

    def ik(self, poses: torch.Tensor, starts: torch.Tensor, iterations: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Find joints for TCP poses by damped least squares within limits, one start after the other.

        Args:
            poses: TCP poses in the base frame, shape (N, 4, 4).
            starts: Joints to start from, at least one, tried in this order for every pose, shape (K, n).
            iterations: Number of steps from each start.

        Returns:
            Joints [rad, m] within limits, shape (N, n): a solution, or the closest joints found; and whether their TCP
            is within POSITION and ROTATION of the pose, shape (N,), bool.
        """
        best = self._within(starts[:1]).repeat(len(poses), 1)
        error = torch.full((len(poses),), torch.inf, dtype=torch.float64)
        ok = torch.zeros(len(poses), dtype=torch.bool)
        for start in starts:
            pending = torch.nonzero(~ok).squeeze(1)
            if len(pending) == 0:
                break
            q = self.refine(poses[pending], start.repeat(len(pending), 1), iterations)
            distance, angle = self.errors(poses[pending], q)
            found = (distance < POSITION) & (angle < ROTATION)
            left = torch.where(found, 0.0, distance + _LEVER * angle)
            closer = left < error[pending]
            error[pending[closer]], best[pending[closer]] = left[closer], q[closer]
            ok[pending] = found
        return best, ok

    def refine(self, poses: torch.Tensor, q: torch.Tensor, iterations: int) -> torch.Tensor:
        """Return joints (N, n) moved towards TCP poses (N, 4, 4) within limits.

        Damping shrinks with the squared error (T. Sugihara, "Solvability-unconcerned inverse kinematics by the
        Levenberg-Marquardt method", IEEE Transactions on Robotics 27, 2011). A step leaves out joints that it would
        push beyond a limit. Hinges without limits come back in [-pi, pi].
        """
        q = self._within(q)
        lever = torch.tensor([1.0, 1.0, 1.0, _LEVER, _LEVER, _LEVER], dtype=torch.float64)
        eye = torch.eye(6, dtype=torch.float64)
        for _ in range(iterations):
            jacobian, at = self.serial.jacobian_tensor(q - self._ref, ret_eef_pose=True)
            e = lever * _difference(at, poses)
            jacobian = lever[:, None] * jacobian
            down = torch.einsum("nij,ni->nj", jacobian, e)
            stuck = ((q <= self.lower) & (down < 0.0)) | ((q >= self.upper) & (down > 0.0))
            jacobian = torch.where(stuck[:, None, :], 0.0, jacobian)
            damping = _DAMPING * (e * e).sum(1) + _LEAST_DAMPING
            y = torch.linalg.solve(jacobian @ jacobian.mT + damping[:, None, None] * eye, e)
            step = torch.einsum("nij,ni->nj", jacobian, y)
            step = step * torch.clamp(_LONGEST_STEP / step.abs().amax(1, keepdim=True).clamp(min=1e-12), max=1.0)
            q = torch.clamp(q + step, self.lower, self.upper)
        return self._within(q)

    def errors(self, poses: torch.Tensor, q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return distances [m] and angles [rad], (N,), between the TCP at joints (N, n) and poses (N, 4, 4)."""
        e = _difference(self.fk(q), poses)
        return e[:, :3].norm(dim=1), e[:, 3:].norm(dim=1)

    def random_joints(self, num: int, seed: int = 0) -> torch.Tensor:
        """Return joints drawn uniformly within limits (-pi to pi for a hinge without), shape (num, n)."""
        lower = torch.where(torch.isfinite(self.lower), self.lower, -torch.pi)
        upper = torch.where(torch.isfinite(self.upper), self.upper, torch.pi)
        draws = torch.rand((num, len(lower)), dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
        return lower + draws * (upper - lower)

    def _within(self, q: torch.Tensor) -> torch.Tensor:
        """Return joints clamped to limits, hinges without limits wrapped to [-pi, pi]."""
        turns = torch.where(torch.isfinite(self.lower) | self._slide, 0.0, torch.round(q / (2.0 * torch.pi)))
        return torch.clamp(q - 2.0 * torch.pi * turns, self.lower, self.upper)


def joints_between(mjm: mujoco.MjModel, root: int, body: int) -> np.ndarray:
    """Return the ids of the joints between a root and a body below it, from the root on."""
    found: list[int] = []
    while body != root:
        first = int(mjm.body_jntadr[body])
        found[:0] = range(first, first + int(mjm.body_jntnum[body]))
        body = int(mjm.body_parentid[body])
    return np.array(found, int)


def _tree(mjm: mujoco.MjModel, root: int, site: int) -> pk.Chain:
    """Return an arm as frames of pytorch-kinematics: a fixed base, one frame per joint, and the fixed TCP."""
    path = [int(mjm.site_bodyid[site])]
    while path[-1] != root:
        path.append(int(mjm.body_parentid[path[-1]]))
    top = tip = Frame("base", link=Link("base"), joint=Joint("base"))
    offset = np.eye(4)  # from the last frame
    for body in path[-2::-1]:
        offset = offset @ frame(mjm.body_pos[body], mjm.body_quat[body])
        first = int(mjm.body_jntadr[body])
        for i in range(first, first + int(mjm.body_jntnum[body])):
            to_anchor, back = np.eye(4), np.eye(4)
            to_anchor[:3, 3], back[:3, 3] = mjm.jnt_pos[i], -mjm.jnt_pos[i]
            kind = "prismatic" if mjm.jnt_type[i] == mujoco.mjtJoint.mjJNT_SLIDE else "revolute"
            axis = torch.as_tensor(mjm.jnt_axis[i])
            tip = _added(tip, f"joint {i}", offset @ to_anchor, kind, axis)
            offset = back
    _added(tip, "tcp", offset @ frame(mjm.site_pos[site], mjm.site_quat[site]), "fixed", None)
    return pk.Chain(top, dtype=torch.float64)


def _added(tip: Frame, name: str, offset: np.ndarray, kind: str, axis: torch.Tensor | None) -> Frame:
    """Add a frame to the end of a chain, and return it."""
    moved = pk.Transform3d(matrix=torch.as_tensor(offset), dtype=torch.float64)
    joint = Joint(name, moved, kind, axis, torch.float64)
    added = Frame(name, link=Link(name), joint=joint)
    tip.add_child(added)
    return added


def _difference(at: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Return the translation [m] and rotation vector [rad] from poses `at` to `wanted`, base frame, shape (N, 6)."""
    turn = wanted[:, :3, :3] @ at[:, :3, :3].mT
    quat = pk.matrix_to_quaternion(turn)
    quat = torch.where(quat[:, :1] < 0.0, -quat, quat)
    sine = quat[:, 1:].norm(dim=1, keepdim=True)
    scale = torch.where(sine > 1e-9, 2.0 * torch.atan2(sine, quat[:, :1]) / sine.clamp(min=1e-9), 2.0)
    return torch.cat([wanted[:, :3, 3] - at[:, :3, 3], scale * quat[:, 1:]], dim=1)
