"""RRT-Connect [Kuffner and LaValle 2000] from a start to any of several goals, with collisions from MuJoCo C."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

import mujoco
import numpy as np

STEP = 0.02
"""Distance of the tests on an edge, as the greatest change of a joint [rad or m]."""
_EXTENSION = 0.3


class Arm:
    """An arm in one layout, whose robot touches something at some joints or does not.

    Args:
        mjm: The model. It is copied.
        qpos: The state of the layout, with open fingers, shape (nq,).
        mocap: Positions and orientations of the mocap bodies.
        home: The model's start pose. Parts of the robot that are near each other there may be so anywhere.
        robot: Bodies of the robot.
        hand: Its bodies that may touch the target, if `near` is asked with `grasping`.
        target: Bodies of the target.
        adr: Addresses of the joints in qpos, shape (n,).
        site: The site between the fingertips.
    """

    def __init__(
        self,
        mjm: mujoco.MjModel,
        qpos: np.ndarray,
        mocap: tuple[np.ndarray, np.ndarray],
        home: np.ndarray,
        robot: Iterable[int],
        hand: Iterable[int],
        target: Iterable[int],
        adr: np.ndarray,
        site: int,
    ) -> None:
        self.mjm, self.data = mjm, mujoco.MjData(mjm)
        self._robot, self._hand, self._target = (np.isin(np.arange(mjm.nbody), list(b)) for b in (robot, hand, target))
        self.adr, self._site = adr, site
        joints = [int(np.flatnonzero(mjm.jnt_qposadr == a)[0]) for a in adr]
        self._dof = mjm.jnt_dofadr[joints]
        limited = mjm.jnt_limited[joints].astype(bool)[:, None]
        self.low, self.high = np.where(limited, mjm.jnt_range[joints], [-np.pi, np.pi]).T
        mjm.geom_margin[:] = mjm.geom_gap[:] = 0.0
        self._reach(0.01)
        self.data.qpos[:] = home
        mujoco.mj_kinematics(mjm, self.data)
        mujoco.mj_collision(mjm, self.data)
        pairs = self._robot[mjm.geom_bodyid[self.data.contact.geom]].all(axis=1)
        geoms, dist = self.data.contact.geom[pairs], self.data.contact.dist[pairs]
        self._at_home = {(int(a), int(b)): min(float(d), 0.0) for (a, b), d in zip(geoms, dist, strict=True)}
        self.data.qpos[:], self.data.mocap_pos[:], self.data.mocap_quat[:] = qpos, *mocap

    def _reach(self, margin: float) -> None:
        self.mjm.geom_margin[:] = self.mjm.pair_margin[:] = margin

    def pose(self, joints: np.ndarray) -> None:
        """Move the arm."""
        self.data.qpos[self.adr] = joints
        mujoco.mj_kinematics(self.mjm, self.data)
        mujoco.mj_comPos(self.mjm, self.data)

    def is_free(self, joints: np.ndarray, margin: float, grasping: float | None = None) -> bool:
        """Return whether all distances of the robot are at least a margin [m].

        With `grasping`, this is the margin of the hand, which may touch the target.
        """
        mjm, data = self.mjm, self.data
        self._reach(max(margin, grasping or 0.0, 1e-6))
        self.pose(joints)
        mujoco.mj_collision(mjm, data)
        for (a, b), dist in zip(data.contact.geom.tolist(), data.contact.dist.tolist(), strict=True):
            bodies = mjm.geom_bodyid[[a, b]]
            if not self._robot[bodies].any():
                continue
            least, is_hand = margin, self._hand[bodies].any()
            if grasping is not None and is_hand:
                if self._target[bodies].any():
                    continue
                least = grasping
            if dist < self._at_home.get((a, b), least) - 1e-5:
                return False
        return True

    def edge(self, a: np.ndarray, b: np.ndarray, margin: float, grasping: float | None = None) -> bool:
        """Return whether a straight piece is free at points `STEP` apart, coarse ones first."""
        number = int(np.ceil(np.abs(b - a).max() / STEP)) + 1
        shares = np.linspace(0.0, 1.0, number)
        order = np.argsort((np.arange(number) * 0.618034) % 1.0)
        return all(self.is_free(a + share * (b - a), margin, grasping) for share in shares[order])

    def solve(self, pos: np.ndarray, mat: np.ndarray, joints: np.ndarray) -> np.ndarray | None:
        """Return joints that bring the site to a pose within 0.5 mm and 0.2 degrees, by damped least squares."""
        jac, joints = np.zeros((6, self.mjm.nv)), joints.copy()
        for _ in range(100):
            self.pose(joints)
            own = self.data.site_xmat[self._site].reshape(3, 3)
            turn, quat = np.zeros(3), np.zeros(4)
            mujoco.mju_mat2Quat(quat, (mat @ own.T).ravel())
            mujoco.mju_quat2Vel(turn, quat, 1.0)
            error = np.concatenate([pos - self.data.site_xpos[self._site], turn])
            if np.linalg.norm(error[:3]) < 5e-4 and np.linalg.norm(turn) < 3.5e-3:
                return joints
            mujoco.mj_jacSite(self.mjm, self.data, jac[:3], jac[3:], self._site)
            own_jac = jac[:, self._dof]
            step = own_jac.T @ np.linalg.solve(own_jac @ own_jac.T + 1e-4 * np.eye(6), error)
            joints = np.clip(joints + np.clip(step, -0.3, 0.3), self.low, self.high)
        return None


class _Tree:
    def __init__(self, roots: np.ndarray) -> None:
        self.nodes, self.parents, self.number = np.zeros((100_000, roots.shape[1])), [-1] * len(roots), len(roots)
        self.nodes[: self.number] = roots

    def nearest(self, point: np.ndarray) -> int:
        return int(((self.nodes[: self.number] - point) ** 2).sum(axis=1).argmin())

    def add(self, point: np.ndarray, parent: int) -> int:
        self.nodes[self.number] = point
        self.parents.append(parent)
        self.number += 1
        return self.number - 1

    def way(self, node: int) -> list[np.ndarray]:
        found = []
        while node >= 0:
            found.append(self.nodes[node])
            node = self.parents[node]
        return found


def connect(
    start: np.ndarray,
    goals: np.ndarray,
    edge: Callable[[np.ndarray, np.ndarray], bool],
    low: np.ndarray,
    high: np.ndarray,
    seconds: float,
    seed: int = 0,
) -> np.ndarray | None:
    """Return the corners of a free way from the start to one of the goals, or None if none is found in time.

    Args:
        start: Joints, shape (n,).
        goals: Joints of the goals, shape (ngoal, n). The start and all goals are free.
        edge: Returns whether the straight piece between two points is free.
        low: Lower limits, shape (n,).
        high: Upper limits, shape (n,).
        seconds: Time of this thread's processor [s].
        seed: Seed of the random points.
    """
    rng, end = np.random.default_rng(seed), time.thread_time() + seconds
    trees, turn = [_Tree(start[None]), _Tree(goals)], 0
    while time.thread_time() < end and max(tree.number for tree in trees) < 99_000:
        one, other = trees[turn], trees[1 - turn]
        near = one.nearest(point := rng.uniform(low, high))
        away = point - one.nodes[near]
        new = one.nodes[near] + away * min(1.0, _EXTENSION / np.abs(away).max())
        turn = 1 - turn
        if not edge(one.nodes[near], new):
            continue
        ours, theirs = one.add(new, near), other.nearest(new)
        while time.thread_time() < end and other.number < 99_000:
            away = new - other.nodes[theirs]
            far = np.abs(away).max()
            nearer = other.nodes[theirs] + away * min(1.0, _EXTENSION / max(far, 1e-9))
            if not edge(other.nodes[theirs], nearer):
                break
            if far <= _EXTENSION:
                ways = [one.way(ours), other.way(theirs)]
                first, last = ways if one is trees[0] else ways[::-1]
                return np.array([*first[::-1], *last])
            theirs = other.add(nearer, theirs)
    return None
