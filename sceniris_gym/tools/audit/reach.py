"""Whether the arm gets to what it is said to reach: by MuJoCo C where joints are given, by other solvers where not.

Arm and hand are taken from the MjModel: the chain from the robot's root body to its site `tcp`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.reach.arm import TCP, Arm
from sceniris_gym.tools.rows import Rows

POSITION = 1e-3  # m
ROTATION = np.radians(0.5)
BACK = 0.08  # m, from the pre-grasp to the grasp along its approach
_LIMIT = 1e-6  # rad or m
_DEEP = 1e-5  # m, by which bodies overlap that touch
_OFF = 0.03  # m, from the TCP of a grasp to the box of some geom of its object
_SOLVED_AT_ONCE = 256


@dataclass(frozen=True)
class Claim:
    """How an object is said to be reached, one entry a row; nan where nothing is said.

    Attributes:
        name: the object.
        tier: "map", "map_strict", "ik" or "clear".
        pose: TCP in the world frame, position [m] and orientation (w, x, y, z), shape (nrow, 7).
        qpos: joints of the arm in the grasp [rad or m], from its base on, shape (nrow, njoint).
        pregrasp_qpos: the same before the grasp.
        fingers: positions of the fingers' joints, shape (nrow, nfinger).
        finger_adr: where they are in qpos, shape (nfinger,).
    """

    name: str
    tier: str
    pose: np.ndarray
    qpos: np.ndarray
    pregrasp_qpos: np.ndarray
    fingers: np.ndarray
    finger_adr: np.ndarray


@dataclass(frozen=True)
class Unreached:
    """An object that is said to be reachable and is not: row, name and why."""

    row: int
    name: str
    cause: str


class ReachAudit:
    """Judges claims of reach.

    Args:
        mjm: the model.
        root: id of the robot's root body.
        bodies: object name -> root body id.
    """

    def __init__(self, mjm: mujoco.MjModel, root: int, bodies: dict[str, int]) -> None:
        self.mjm, self.root, self.data = mjm, root, mujoco.MjData(mjm)
        name = mjm.body(root).name
        self.arm = Arm.from_model(mjm, name, f"{name}/{TCP}")
        self._of = {name: _inside(mjm, body) for name, body in bodies.items()}
        self._robot = _inside(mjm, root)

    def judge(self, rows: Rows, claims: Sequence[Claim], present: dict[str, np.ndarray]) -> list[Unreached]:
        """Check the claims about layouts.

        Args:
            rows: the layouts.
            claims: one for each object that is to be reachable.
            present: object name -> rows in which it is there, shape (nrow,).
        """
        found = []
        for claim in claims:
            poses: dict[int, np.ndarray] = {}
            for row in np.flatnonzero(present[claim.name]).tolist():
                rows.put(self.data, row)
                mujoco.mj_kinematics(self.mjm, self.data)
                cause = self._wrong(claim, row)
                if cause is not None:
                    found.append(Unreached(row, claim.name, cause))
                elif claim.tier in ("map", "map_strict"):
                    poses[row] = np.linalg.inv(self._frame(self.root)) @ _matrix(claim.pose[row])
            found += [Unreached(row, claim.name, "no joints found") for row in self._unsolved(poses)]
        return found

    def _wrong(self, claim: Claim, row: int) -> str | None:
        """What is wrong about a claim in the layout that is posed, but for whether joints can be found."""
        pose = claim.pose[row]
        if np.isnan(pose).any():
            return "no grasp"
        if self._distance(claim.name, pose[:3]) > _OFF:
            return "off the object"
        if claim.tier in ("map", "map_strict"):
            return None
        self.data.qpos[claim.finger_adr] = claim.fingers[row]
        cause = self._wrong_joints(claim, claim.qpos[row], _matrix(pose))
        if cause is None and claim.tier == "clear":
            before = _matrix(pose)
            before[:3, 3] -= BACK * before[:3, 2]
            cause = self._wrong_joints(claim, claim.pregrasp_qpos[row], before)
            return None if cause is None else f"pre-grasp: {cause}"
        return cause

    def _wrong_joints(self, claim: Claim, qpos: np.ndarray, pose: np.ndarray) -> str | None:
        mjm, data, arm = self.mjm, self.data, self.arm
        if np.isnan(qpos).any():
            return "no joints"
        if np.any(qpos < arm.lower - _LIMIT) or np.any(qpos > arm.upper + _LIMIT):
            return "limits"
        data.qpos[arm.qposadr] = qpos
        mujoco.mj_fwdPosition(mjm, data)
        turn = data.site_xmat[arm.tcp_site].reshape(3, 3).T @ pose[:3, :3]
        angle = np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))
        if np.linalg.norm(data.site_xpos[arm.tcp_site] - pose[:3, 3]) > POSITION or angle > ROTATION:
            return "another pose"
        for contact in data.contact[: data.ncon]:
            first, second = (int(mjm.geom_bodyid[g]) for g in contact.geom)
            mine = (first in self._robot) + (second in self._robot)
            if contact.dist > -_DEEP or not mine:
                continue
            if mine == 2:
                return "hits itself"
            if claim.tier == "clear" and not {first, second} & self._of[claim.name]:
                return "hits something"
        return None

    def _distance(self, name: str, point: np.ndarray) -> float:
        """Distance [m] of a point from the nearest of the boxes of an object's geoms; 0 for one without geoms."""
        mjm, data = self.mjm, self.data
        away = [
            np.linalg.norm(
                np.maximum(
                    np.abs(data.geom_xmat[g].reshape(3, 3).T @ (point - data.geom_xpos[g]) - mjm.geom_aabb[g, :3])
                    - mjm.geom_aabb[g, 3:],
                    0.0,
                )
            )
            for g in range(mjm.ngeom)
            if int(mjm.geom_bodyid[g]) in self._of[name]
        ]
        return float(min(away, default=0.0))

    def _unsolved(self, poses: dict[int, np.ndarray]) -> list[int]:
        """The rows for whose TCP poses in the base frame torch finds no joints within limits."""
        if not poses:
            return []
        from sceniris_gym.reach.kinematics import Chain

        chain, rows, missed = Chain(self.arm), np.array(list(poses)), []
        for start in range(0, len(rows), _SOLVED_AT_ONCE):
            some = rows[start : start + _SOLVED_AT_ONCE]
            _, ok = chain.ik(np.stack([poses[int(row)] for row in some]))
            missed += some[~ok.cpu().numpy()].tolist()
        return missed

    def _frame(self, body: int) -> np.ndarray:
        return _matrix(np.concatenate([self.data.xpos[body], self.data.xquat[body]]))


def _inside(mjm: mujoco.MjModel, root: int) -> set[int]:
    """A body and all bodies below it."""
    inside = {root}
    for body in range(root + 1, mjm.nbody):
        if int(mjm.body_parentid[body]) in inside:
            inside.add(body)
    return inside


def _matrix(pose: np.ndarray) -> np.ndarray:
    """A pose (x, y, z, w, x, y, z) as a matrix (4, 4)."""
    frame, mat = np.eye(4), np.zeros(9)
    quat = np.asarray(pose[3:], float)
    mujoco.mju_quat2Mat(mat, quat / np.linalg.norm(quat))
    frame[:3, :3], frame[:3, 3] = mat.reshape(3, 3), pose[:3]
    return frame
