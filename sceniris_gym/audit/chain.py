"""Forward and inverse kinematics in NumPy, to judge the reach of an arm.

This code shares nothing with reach/solve.py, the Warp kinematics of resets and maps. Forward kinematics are the product
of exponentials (R. W. Brockett, "Robotic manipulators and the product of exponentials formula", 1984), with the joint
axes that MuJoCo C computes at `qpos0`.
"""

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
        root: Id of the arm's base body.
        site: Id of the site that is the arm's TCP.

    Attributes:
        joints: Ids of the n joints from the base to the TCP, shape (n,).
        lower, upper: Limits of the joints [rad or m], shape (n,). -inf and inf for joints without limits.
    """

    def __init__(self, mjm: mujoco.MjModel, root: int, site: int) -> None:
        path = [int(mjm.site_bodyid[site])]
        while path[-1] != root:
            path.append(int(mjm.body_parentid[path[-1]]))
        self.joints = np.flatnonzero(np.isin(mjm.jnt_bodyid, path[:-1]))
        limited = mjm.jnt_limited[self.joints].astype(bool)
        low, high = mjm.jnt_range[self.joints].T
        self.lower, self.upper = np.where(limited, low, -np.inf), np.where(limited, high, np.inf)
        self._ref = mjm.qpos0[mjm.jnt_qposadr[self.joints]]
        self._slide = mjm.jnt_type[self.joints] == mujoco.mjtJoint.mjJNT_SLIDE
        data = mujoco.MjData(mjm)
        mujoco.mj_kinematics(mjm, data)
        base = data.xmat[root].reshape(3, 3)
        self._tcp = np.eye(4)
        self._tcp[:3, :3] = base.T @ data.site_xmat[site].reshape(3, 3)
        self._tcp[:3, 3] = base.T @ (data.site_xpos[site] - data.xpos[root])
        # The twist of a hinge is its axis and its moment about the base. The twist of a slide is only its axis.
        axis, anchor = data.xaxis[self.joints] @ base, (data.xanchor[self.joints] - data.xpos[root]) @ base
        self._twist = np.zeros((len(self.joints), 4, 4))
        self._twist[:, :3, :3] = np.where(self._slide[:, None, None], 0.0, np.cross(axis[:, None], -np.eye(3)))
        self._twist[:, :3, 3] = np.where(self._slide[:, None], axis, np.cross(anchor, axis))

    def fk(self, q: np.ndarray) -> np.ndarray:
        """Return TCP poses in the base frame, shape (N, 4, 4), for joint positions [rad or m], shape (N, n)."""
        return self._placed(q)[0]

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
        lower = np.where(np.isfinite(self.lower), self.lower, -np.pi)
        upper = np.where(np.isfinite(self.upper), self.upper, np.pi)
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
            at, jacobian = self._placed(q)
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

    def _placed(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return TCP poses (N, 4, 4) and their Jacobians (N, 6, n) at joint positions (N, n), in the base frame."""
        change = q - self._ref
        sine, versine = np.where(self._slide, change, np.sin(change)), 1.0 - np.cos(change)
        motion = np.eye(4) + sine[..., None, None] * self._twist + versine[..., None, None] * self._twist @ self._twist
        at, moved = np.tile(np.eye(4), (len(q), 1, 1)), np.zeros((*q.shape, 4, 4))
        for i, twist in enumerate(self._twist):
            moved[:, i] = at @ twist @ np.linalg.inv(at)
            at = at @ motion[:, i]
        at = at @ self._tcp
        along, around = (moved @ at[:, None, :, 3:])[:, :, :3, 0], moved[:, :, [2, 0, 1], [1, 2, 0]]
        return at, np.concatenate([along, around], axis=2).transpose(0, 2, 1)

    def _within(self, q: np.ndarray) -> np.ndarray:
        """Return joint positions clamped to their limits. Hinges without limits are wrapped to [-pi, pi] instead."""
        laps = np.where(np.isfinite(self.lower) | self._slide, 0.0, np.round(q / (2.0 * np.pi)))
        return np.clip(q - 2.0 * np.pi * laps, self.lower, self.upper)


def _difference(at: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the translation [m] and rotation vector [rad] from poses `at` to `wanted`, base frame, shape (N, 6)."""
    rotation = Rotation.from_matrix(wanted[:, :3, :3] @ at[:, :3, :3].transpose(0, 2, 1))
    return np.hstack([wanted[:, :3, 3] - at[:, :3, 3], rotation.as_rotvec()])
