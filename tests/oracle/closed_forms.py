"""Inverse kinematics of three arms in closed form, from their published or stated dimensions.

Each function takes poses of the last joint's frame, shape (M, 4, 4), and returns all branches of joints, shape
(M, C, n), in turns as they come, with the excess (M, C): by how much a cosine had to be cut off to be one. Where the
excess is 0 the joints are exact solutions; where it is small they are near to the arm's reach.
"""

from __future__ import annotations

import numpy as np

# Craig's table of the Franka Emika Panda, from the manufacturer: a [m], alpha [rad], d [m].
PANDA = [
    (0.0, 0.0, 0.333),
    (0.0, -np.pi / 2, 0.0),
    (0.0, np.pi / 2, 0.316),
    (0.0825, np.pi / 2, 0.0),
    (-0.0825, -np.pi / 2, 0.384),
    (0.0, np.pi / 2, 0.0),
    (0.088, np.pi / 2, 0.0),
]
# Denavit-Hartenberg table of the UR5e, from the manufacturer: d [m], a [m], alpha [rad].
UR5E = [
    (0.1625, 0.0, np.pi / 2),
    (0.0, -0.425, 0.0),
    (0.0, -0.3922, 0.0),
    (0.1333, 0.0, np.pi / 2),
    (0.0997, 0.0, -np.pi / 2),
    (0.0996, 0.0, 0.0),
]
# Heron, straight up: heights of shoulder and elbow and wrist above each other [m]; axes z, y, y, z, y, z.
HERON = (0.24, 0.32, 0.30)


def rot_x(angle) -> np.ndarray:
    """Rotations about x, shape (..., 3, 3)."""
    c, s, one, nil = np.cos(angle), np.sin(angle), np.ones_like(angle, float), np.zeros_like(angle, float)
    return _matrix([[one, nil, nil], [nil, c, -s], [nil, s, c]])


def rot_y(angle) -> np.ndarray:
    """Rotations about y, shape (..., 3, 3)."""
    c, s, one, nil = np.cos(angle), np.sin(angle), np.ones_like(angle, float), np.zeros_like(angle, float)
    return _matrix([[c, nil, s], [nil, one, nil], [-s, nil, c]])


def rot_z(angle) -> np.ndarray:
    """Rotations about z, shape (..., 3, 3)."""
    c, s, one, nil = np.cos(angle), np.sin(angle), np.ones_like(angle, float), np.zeros_like(angle, float)
    return _matrix([[c, -s, nil], [s, c, nil], [nil, nil, one]])


def last_frame_at_zero(name: str) -> np.ndarray:
    """Pose of the last joint's frame in the base's with all joints at zero, shape (4, 4)."""
    pose = np.eye(4)
    if name == "heron":
        pose[2, 3] = sum(HERON)
    elif name == "panda":
        for a, alpha, d in PANDA:
            pose = pose @ _transform(rot_x(alpha), [a, 0, 0]) @ _transform(np.eye(3), [0, 0, d])
    else:
        for d, a, alpha in UR5E:
            pose = pose @ _transform(rot_x(alpha), [a, 0, d])
    return pose


def heron(last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eight branches: facing or turned away, elbow, wrist."""
    height, upper, fore = HERON
    centre, turn = last[:, :3, 3], last[:, :3, :3]
    z = centre[:, 2] - height
    radius = np.hypot(centre[:, 0], centre[:, 1])
    facing = np.arctan2(centre[:, 1], centre[:, 0])
    bend, excess = _arccos((radius**2 + z**2 - upper**2 - fore**2) / (2 * upper * fore))
    branches = []
    for away in (False, True):
        q1 = facing + np.pi * away
        x = -radius if away else radius
        for q3 in (bend, -bend):
            q2 = np.arctan2(x, z) - np.arctan2(fore * np.sin(q3), upper + fore * np.cos(q3))
            wrist = np.swapaxes(rot_z(q1) @ rot_y(q2 + q3), 1, 2) @ turn
            branches += [np.stack([q1, q2, q3, *zyz], axis=1) for zyz in _zyz(wrist)]
    return np.stack(branches, axis=1), np.repeat(excess[:, None], len(branches), axis=1)


def ur5e(last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eight branches: shoulder, wrist, elbow; after the three parallel axes 2, 3 and 4."""
    d1, d4, d5, d6 = UR5E[0][0], UR5E[3][0], UR5E[4][0], UR5E[5][0]
    a2, a3 = UR5E[1][1], UR5E[2][1]
    turn, pos = last[:, :3, :3], last[:, :3, 3]
    x, y = (pos - d6 * turn[:, :, 2])[:, :2].T
    off, excess1 = _arccos(d4 / np.hypot(x, y))
    branches, excesses = [], []
    for side in (1.0, -1.0):
        q1 = np.arctan2(y, x) + np.pi / 2 + side * off
        parallel = np.stack([np.sin(q1), -np.cos(q1), np.zeros_like(q1)], axis=1)
        seen = np.einsum("mij,mi->mj", turn, parallel)  # the parallel axes in the last frame
        bend, excess5 = _arccos(seen[:, 2])
        for q5 in (bend, -bend):
            sign = np.where(np.sin(q5) < 0.0, -1.0, 1.0)
            q6 = np.arctan2(-sign * seen[:, 1], sign * seen[:, 0])
            frame4 = turn @ rot_z(-q6) @ rot_x(np.full_like(q5, np.pi / 2)) @ rot_z(-q5)
            wrist = pos - d6 * turn[:, :, 2] - d5 * frame4[:, :, 2] - np.array([0.0, 0.0, d1])
            frame1 = rot_z(q1) @ rot_x(np.full_like(q1, np.pi / 2))
            u, v = np.einsum("mij,mi->jm", frame1, wrist)[:2]
            planar = np.swapaxes(frame1, 1, 2) @ frame4
            total = np.arctan2(planar[:, 1, 0], planar[:, 0, 0])
            elbow, excess3 = _arccos((u**2 + v**2 - a2**2 - a3**2) / (2 * a2 * a3))
            for q3 in (elbow, -elbow):
                q2 = np.arctan2(v, u) - np.arctan2(a3 * np.sin(q3), a2 + a3 * np.cos(q3))
                branches.append(np.stack([q1, q2, q3, total - q2 - q3, q5, q6], axis=1))
                excesses.append(np.maximum(np.maximum(excess1, excess3), excess5))
    return np.stack(branches, axis=1), np.stack(excesses, axis=1)


def panda(last: np.ndarray, q7: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eight branches at a given last joint, shape (M,): elbow, wrist, shoulder.

    Shoulder, elbow and wrist lie in one plane, which also holds the axes of upper arm and forearm. The distance from
    shoulder to wrist gives joint 4. The forearm's axis is then at a known angle to the line from wrist to shoulder, and
    at a right angle to the axis of joint 6, which gives joint 6 and the plane.
    """
    offset, upper, fore, reach = PANDA[3][0], PANDA[2][2], PANDA[4][2], PANDA[6][0]
    frame6 = last[:, :3, :3] @ rot_z(-q7) @ rot_x(np.full_like(q7, -np.pi / 2))
    wrist = last[:, :3, 3] - reach * frame6[:, :, 0]
    back = np.array([0.0, 0.0, PANDA[0][2]]) - wrist
    length = np.linalg.norm(back, axis=1)
    back = back / length[:, None]
    near, far = np.hypot(offset, upper), np.hypot(offset, fore)
    between = np.arctan2(fore, -offset) - np.arctan2(-upper, -offset)
    inner, excess4 = _arccos((near**2 + far**2 - length**2) / (2 * near * far))
    u, v = (np.einsum("mi,mi->m", frame6[:, :, k], back) for k in (0, 1))
    flat = np.maximum(np.hypot(u, v), 1e-12)
    branches, excesses = [], []
    for q4 in (inner - between, -inner - between):
        along = (-offset * np.cos(q4) - upper * np.sin(q4) + offset) / length  # the shoulder seen from the wrist,
        up = (offset * np.sin(q4) - upper * np.cos(q4) - fore) / length  # in the frame of joint 4
        swing, excess6 = _arccos(up / flat)
        for side in (1.0, -1.0):
            q6 = np.arctan2(u, v) + side * swing
            c6, s6 = np.cos(q6)[:, None], np.sin(q6)[:, None]
            forearm = s6 * frame6[:, :, 0] + c6 * frame6[:, :, 1]
            x5 = c6 * frame6[:, :, 0] - s6 * frame6[:, :, 1]
            x4 = back - np.einsum("mi,mi->m", back, forearm)[:, None] * forearm
            x4 *= (np.sign(along) / np.maximum(np.linalg.norm(x4, axis=1), 1e-12))[:, None]
            z4 = np.cross(x4, forearm)
            q5 = np.arctan2(-np.einsum("mi,mi->m", x5, z4), np.einsum("mi,mi->m", x5, x4))
            shoulder = np.stack([x4, forearm, z4], axis=2) @ rot_z(-q4) @ rot_x(np.full_like(q4, -np.pi / 2))
            for q1, q2, q3 in _zyz(shoulder):
                branches.append(np.stack([q1, q2, q3, q4, q5, q6, q7], axis=1))
                excesses.append(np.maximum(excess4, excess6))
    return np.stack(branches, axis=1), np.stack(excesses, axis=1)


def _zyz(turn: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Both ways to write rotations as turns about z, y and z."""
    first = np.arctan2(turn[:, 1, 2], turn[:, 0, 2])
    second = np.arctan2(np.hypot(turn[:, 0, 2], turn[:, 1, 2]), turn[:, 2, 2])
    third = np.arctan2(turn[:, 2, 1], -turn[:, 2, 0])
    return [(first, second, third), (first + np.pi, -second, third + np.pi)]


def _arccos(cosine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return angles, and by how much the cosines were too large."""
    cut = np.clip(cosine, -1.0, 1.0)
    return np.arccos(cut), np.abs(cosine - cut)


def _matrix(rows: list[list[np.ndarray]]) -> np.ndarray:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _transform(turn: np.ndarray, pos: list[float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, pos
    return pose
