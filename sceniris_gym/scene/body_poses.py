"""Poses of a body in many layouts at once, by the kinematics of MuJoCo, without a loop over layouts."""

from __future__ import annotations

import mujoco
import numpy as np


def body_poses(
    mjm: mujoco.MjModel, body: int, qpos: np.ndarray, mocap_pos: np.ndarray, mocap_quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions [m] and orientations (wxyz) of a body in the world frame, shapes (nrow, 3) and (nrow, 4).

    Args:
        mjm: The model.
        body: Id of the body.
        qpos: Joint positions, shape (nrow, nq).
        mocap_pos: Positions of mocap bodies, shape (nrow, nmocap, 3).
        mocap_quat: Their orientations, shape (nrow, nmocap, 4).
    """
    chain = []
    while body > 0:
        chain.append(body)
        body = int(mjm.body_parentid[body])
    pos, quat = np.zeros((len(qpos), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(qpos), 1))
    for link in reversed(chain):
        mocap = mjm.body_mocapid[link]
        if mocap >= 0:
            pos, quat = mocap_pos[:, mocap].astype(float), _unit(mocap_quat[:, mocap])
            continue
        pos, quat = pos + rotated(mjm.body_pos[link], quat), product(quat, mjm.body_quat[link])
        for joint in range(mjm.body_jntadr[link], mjm.body_jntadr[link] + mjm.body_jntnum[link]):
            pos, quat = _moved(mjm, joint, qpos, pos, quat)
    return pos, quat


def _moved(
    mjm: mujoco.MjModel, joint: int, qpos: np.ndarray, pos: np.ndarray, quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses after a joint."""
    adr, kind = mjm.jnt_qposadr[joint], mjm.jnt_type[joint]
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        return qpos[:, adr : adr + 3].astype(float), _unit(qpos[:, adr + 3 : adr + 7])
    axis, at = mjm.jnt_axis[joint], mjm.jnt_pos[joint]
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return pos + rotated(axis, quat) * (qpos[:, adr] - mjm.qpos0[adr])[:, None], quat
    if kind == mujoco.mjtJoint.mjJNT_BALL:
        turn = _unit(qpos[:, adr : adr + 4])
    else:
        half = 0.5 * (qpos[:, adr].astype(float) - mjm.qpos0[adr])[:, None]
        turn = np.hstack([np.cos(half), np.sin(half) * axis])
    turned = product(quat, turn)
    return pos + rotated(at, quat) - rotated(at, turned), turned


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of quaternions (wxyz), shape (nrow, 4)."""
    a, b = np.broadcast_arrays(a, b)
    w, v = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(axis=1, keepdims=True), np.cross(a[:, 1:], b[:, 1:])
    return np.hstack([w, v + a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:]])


def rotated(vector: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Return vectors, or one, turned by quaternions (wxyz), shape (nrow, 3)."""
    axis = quat[:, 1:]
    twice = 2.0 * np.cross(axis, np.broadcast_to(vector, axis.shape))
    return vector + quat[:, :1] * twice + np.cross(axis, twice)


def _unit(quat: np.ndarray) -> np.ndarray:
    exact = quat.astype(float)
    return exact / np.linalg.norm(exact, axis=1, keepdims=True)
