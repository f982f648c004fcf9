"""Forward and inverse kinematics in float64, to judge the reach of an arm.

This code shares nothing with reach/solve.py, the Warp kinematics of resets and maps. Forward kinematics and Jacobians
come from a SerialChain of pytorch-kinematics, made from the bodies of an MjModel: the MJCF reader of that library fails
on MuJoCo 4, and gives joints without limits the range (0, 0).
"""

from itertools import pairwise

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

POSITION = 1e-3
"""A pose counts as reached if the TCP is nearer to it than this distance [m]."""
ROTATION = np.radians(0.5)
"""A pose counts as reached if the TCP differs from its orientation by less than this angle [rad]."""
_LEVER = 0.3  # m, weight of a radian of error, about half the length of an arm's link
# Damping of a step: a fraction of the squared error, plus a constant for singular poses.
_DAMPING, _LEAST_DAMPING = 0.1, 1.0e-6
_LONGEST_STEP = 1.0  # rad or m, greatest motion of a joint in one step


class Chain:
    """The kinematics of an arm, for batches of joint positions. TCP positions agree with MuJoCo's to 1e-14 m.

    Args:
        mjm: The model with the arm.
        root: Id of the arm's root body.
        site: Id of the site that is the arm's TCP.

    Attributes:
        base: Id of the body without joints that carries the arm: the root body, or its parent.
        joints: Ids of the n joints from the base to the TCP, shape (n,).
        lower, upper: Limits of the joints [rad or m], shape (n,). -inf and inf for joints without limits.
    """

    def __init__(self, mjm: mujoco.MjModel, root: int, site: int) -> None:
        import pytorch_kinematics as pk  # takes seconds, and only the audit of an arm needs it
        import torch

        if mjm.body_jntnum[root] and mjm.jnt_type[mjm.body_jntadr[root]] != mujoco.mjtJoint.mjJNT_FREE:
            root = int(mjm.body_parentid[root])
        self.base, path = root, [int(mjm.site_bodyid[site])]
        while path[-1] != root:
            path.append(int(mjm.body_parentid[path[-1]]))
        self.joints = np.flatnonzero(np.isin(mjm.jnt_bodyid, path[:-1]))
        self._ref = mjm.qpos0[mjm.jnt_qposadr[self.joints]]
        self._slide = mjm.jnt_type[self.joints] == mujoco.mjtJoint.mjJNT_SLIDE
        # All joints of the SerialChain are zero at qpos0, where all frames but the TCP are aligned with the base.
        data = mujoco.MjData(mjm)
        mujoco.mj_kinematics(mjm, data)
        base = data.xmat[root].reshape(3, 3)
        points = np.vstack([data.xpos[root], data.xanchor[self.joints], data.site_xpos[site]]) @ base
        *steps, last = np.diff(points, axis=0)
        frames = [pk.Frame("base")]
        for i, step in zip(self.joints.tolist(), steps, strict=True):
            offset = pk.Transform3d(pos=step, dtype=torch.float64)
            kind = "prismatic" if mjm.jnt_type[i] == mujoco.mjtJoint.mjJNT_SLIDE else "revolute"
            limits = mjm.jnt_range[i] if mjm.jnt_limited[i] else None
            joint = pk.Joint(f"joint {i}", offset, kind, data.xaxis[i] @ base, torch.float64, limits=limits)
            frames.append(pk.Frame(joint.name, joint=joint))
        tcp = pk.Transform3d(pos=last, rot=base.T @ data.site_xmat[site].reshape(3, 3), dtype=torch.float64)
        frames.append(pk.Frame("tcp", pk.Link("tcp", tcp)))
        for parent, child in pairwise(frames):
            parent.add_child(child)
        self._serial = pk.SerialChain(pk.Chain(frames[0], dtype=torch.float64), "tcp", dtype=torch.float64)
        self.lower, self.upper = self._serial.low.numpy(), self._serial.high.numpy()

    def fk(self, q: np.ndarray) -> np.ndarray:
        """Return TCP poses in the base frame, shape (N, 4, 4), for joint positions [rad or m], shape (N, n)."""
        return self.jacobian(q)[0]

    def jacobian(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return TCP poses (N, 4, 4) and their Jacobians (N, 6, n) at joint positions (N, n), in the base frame."""
        jacobian, poses = self._serial.jacobian(q - self._ref, ret_eef_pose=True)
        return poses.numpy(), jacobian.numpy()

    def ik(self, poses: np.ndarray, starts: np.ndarray, iterations: int) -> np.ndarray:
        """Find joint positions for TCP poses, by damped least squares within the joint limits.

        Args:
            poses: TCP poses in the base frame, shape (N, 4, 4).
            starts: Joint positions at the start of the search, shape (K, n). If a pose is not reached from one start,
                the next start is tried.
            iterations: Number of steps from each start.

        Returns:
            Joint positions [rad or m] within limits, shape (N, n), that bring the TCP within POSITION and ROTATION of
            the pose. NaN if no start reaches the pose.
        """
        found = np.full((len(poses), len(self.joints)), np.nan)
        for start in starts:
            pending = np.flatnonzero(np.isnan(found[:, 0]))
            if not len(pending):
                break
            q = self._refined(poses[pending], np.tile(start, (len(pending), 1)), iterations)
            off = _difference(self.fk(q), poses[pending])
            distance, angle = np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)
            ok = (distance < POSITION) & (angle < ROTATION)
            found[pending[ok]] = q[ok]
        return found

    def random_joints(self, num: int, seed: int = 0) -> np.ndarray:
        """Return joint positions drawn uniformly within limits, shape (num, n). Hinges without limits use -pi to pi."""
        lower, upper = np.nan_to_num(self.lower, neginf=-np.pi), np.nan_to_num(self.upper, posinf=np.pi)
        return np.random.default_rng(seed).uniform(lower, upper, (num, len(lower)))

    def _refined(self, poses: np.ndarray, q: np.ndarray, iterations: int) -> np.ndarray:
        """Return joint positions (N, n) after steps from `q` towards TCP poses (N, 4, 4), within limits.

        Damping shrinks with the squared error (T. Sugihara, "Solvability-unconcerned inverse kinematics by the
        Levenberg-Marquardt method", IEEE Transactions on Robotics 27, 2011). A step leaves out joints that it would
        push beyond a limit. Hinges without limits are returned in [-pi, pi].
        """
        q = self._within(q)
        lever = np.array([1.0, 1.0, 1.0, _LEVER, _LEVER, _LEVER])
        for _ in range(iterations):
            at, jacobian = self.jacobian(q)
            e = lever * _difference(at, poses)
            jacobian = lever[:, None] * jacobian
            down = np.einsum("nij,ni->nj", jacobian, e)
            stuck = ((q <= self.lower) & (down < 0.0)) | ((q >= self.upper) & (down > 0.0))
            jacobian = np.where(stuck[:, None, :], 0.0, jacobian)
            damping = _DAMPING * (e * e).sum(1) + _LEAST_DAMPING
            back = jacobian.transpose(0, 2, 1)
            y = np.linalg.solve(jacobian @ back + damping[:, None, None] * np.eye(6), e[..., None])
            step = (back @ y)[..., 0]
            longest = np.abs(step).max(axis=1, keepdims=True)
            q = np.clip(q + step * np.minimum(_LONGEST_STEP / np.maximum(longest, 1e-12), 1.0), self.lower, self.upper)
        return self._within(q)

    def _within(self, q: np.ndarray) -> np.ndarray:
        """Return joint positions clamped to their limits. Hinges without limits are wrapped to [-pi, pi] instead."""
        laps = np.where(np.isfinite(self.lower) | self._slide, 0.0, np.round(q / (2.0 * np.pi)))
        return np.clip(q - 2.0 * np.pi * laps, self.lower, self.upper)


def _difference(at: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the translation [m] and rotation vector [rad] from poses `at` to `wanted`, base frame, shape (N, 6)."""
    rotation = Rotation.from_matrix(wanted[:, :3, :3] @ at[:, :3, :3].transpose(0, 2, 1))
    return np.hstack([wanted[:, :3, 3] - at[:, :3, 3], rotation.as_rotvec()])
