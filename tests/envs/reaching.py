"""Inverse kinematics and collision-free grasps in plain MuJoCo: an oracle for what the arm can reach."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

HOVER = 0.24
WAYPOINTS = 10


@dataclass(frozen=True)
class ScriptedArm:
    """Addresses of the Panda in a scene."""

    model: mujoco.MjModel
    qposadr: np.ndarray
    dofadr: np.ndarray
    limits: np.ndarray
    fingers: np.ndarray
    tcp: int
    bodies: frozenset[int]

    @classmethod
    def of(cls, model: mujoco.MjModel) -> ScriptedArm:
        """Find the arm by its names."""
        joints = [model.joint(f"panda/joint{i}").id for i in range(1, 8)]
        fingers = [model.joint(f"panda/finger_joint{i}").qposadr[0] for i in (1, 2)]
        bodies = frozenset(b for b in range(model.nbody) if model.body(b).name.split("/")[0] == "panda")
        return cls(
            model,
            model.jnt_qposadr[joints],
            model.jnt_dofadr[joints],
            model.jnt_range[joints].T,
            np.array(fingers),
            model.site("panda/tcp").id,
            bodies,
        )


def solve(arm: ScriptedArm, data: mujoco.MjData, pos: np.ndarray, rotation: np.ndarray, start: np.ndarray) -> bool:
    """Bring the tool to a pose by damped least squares, from the joint angles `start`; leave the result in `data`.

    The step is dq = J^T (J J^T + lambda I)^-1 e (Wampler 1986), cut off at 0.3 rad and at the joint limits.
    """
    data.qpos[arm.qposadr] = start
    jacobian = np.zeros((6, arm.model.nv))
    for _ in range(80):
        mujoco.mj_kinematics(arm.model, data)
        mujoco.mj_comPos(arm.model, data)
        axes = data.site_xmat[arm.tcp].reshape(3, 3)
        turn = 0.5 * sum(np.cross(axes[:, i], rotation[:, i]) for i in range(3))
        error = np.concatenate([pos - data.site_xpos[arm.tcp], turn])
        if np.linalg.norm(error[:3]) < 2e-3 and np.linalg.norm(error[3:]) < 2e-2:
            return True
        mujoco.mj_jacSite(arm.model, data, jacobian[:3], jacobian[3:], arm.tcp)
        j = jacobian[:, arm.dofadr]
        dq = j.T @ np.linalg.solve(j @ j.T + 1e-4 * np.eye(6), error)
        dq *= min(1.0, 0.3 / np.abs(dq).max())
        data.qpos[arm.qposadr] = np.clip(data.qpos[arm.qposadr] + dq, *arm.limits)
    return False


def touches(arm: ScriptedArm, data: mujoco.MjData, ignore: int) -> bool:
    """Return whether the arm touches anything but the body `ignore`, by more than 0.5 mm."""
    mujoco.mj_kinematics(arm.model, data)
    mujoco.mj_comPos(arm.model, data)
    mujoco.mj_collision(arm.model, data)
    for contact in data.contact:
        bodies = {int(arm.model.geom_bodyid[contact.geom1]), int(arm.model.geom_bodyid[contact.geom2])}
        if contact.dist < -5e-4 and ignore not in bodies and bodies & arm.bodies:
            return True
    return False


def grasp_rotations(yaw: float) -> list[np.ndarray]:
    """List tool frames that grasp across an axis at `yaw`: from above first, then leaning 14 and 26 degrees any way."""
    found = []
    for lean in (0.0, 0.25, 0.45):
        for azimuth in np.arange(8) * np.pi / 4 if lean else [0.0]:
            for turn in (0.0, np.pi, 0.35, np.pi + 0.35, -0.35, np.pi - 0.35):
                along = np.array([np.cos(yaw + turn), np.sin(yaw + turn), 0.0])
                down = np.array([0.0, 0.0, -1.0])
                frame = np.stack([along, np.cross(down, along), down], axis=1)
                quat, matrix = np.zeros(4), np.zeros(9)
                mujoco.mju_axisAngle2Quat(quat, np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), lean)
                mujoco.mju_quat2Mat(matrix, quat)
                found.append(matrix.reshape(3, 3) @ frame)
    return found


def descent(arm: ScriptedArm, data: mujoco.MjData, body: str, site: str) -> np.ndarray | None:
    """Find joint angles that lead straight down to a grasp of `site`, shape (WAYPOINTS, 7); None where there are none.

    `data` holds the layout. The open hand touches nothing but `body` on its way; only the way is tested that the tool's
    waypoints stand for.
    """
    mujoco.mj_kinematics(arm.model, data)
    target, start = data.site(site).xpos.copy(), data.qpos[arm.qposadr].copy()
    axes = data.body(body).xmat.reshape(3, 3)
    data.qpos[arm.fingers] = 0.04
    ignore = arm.model.body(body).id
    for rotation in grasp_rotations(np.arctan2(axes[1, 0], axes[0, 0])):
        angles, way = start, []
        for height in np.linspace(HOVER, 0.0, WAYPOINTS):
            if not solve(arm, data, target + [0.0, 0.0, height], rotation, angles) or touches(arm, data, ignore):
                break
            angles = data.qpos[arm.qposadr].copy()
            way.append(angles)
        if len(way) == WAYPOINTS:
            return np.stack(way)
    return None
