"""Paths to grasps walked in MuJoCo C, which shares no code with their search."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
import torch

from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.arm import MAX_JOINTS


class Walk(NamedTuple):
    """The corners of a path (5, njoint), and the first contact that it should not have, as text."""

    world: int
    name: str
    corners: np.ndarray
    hit: str


def corners_of(layouts: Layouts, column: int, njoint: int) -> np.ndarray:
    """Return start, vias, pre-grasp and grasp of each world, shape (nworld, 5, njoint)."""
    path = layouts.path[:, column].reshape(-1, 3, MAX_JOINTS)
    ends = torch.stack([layouts.pregrasp_qpos[:, column], layouts.grasp_qpos[:, column]], dim=1)
    return torch.cat([path, ends], dim=1)[..., :njoint].numpy()


def walked(compiled: CompiledScene, layouts: Layouts, points: int = 101) -> list[Walk]:
    """Walk all paths, at so many points of each piece. Only the hand may touch the target, on the last piece.

    Each finger is a slide, for half of the gap.
    """
    scene, mjm, data, found = compiled.scene, compiled.mjm, mujoco.MjData(compiled.mjm), []
    assert compiled.reaching is not None
    for column, target in enumerate(compiled.reaching.targets):
        one, own = compiled.reaching.arm_of(target), set(scene.subtree(target.name))
        arm, robot = one.arm, set(scene.subtree(one.robot))
        inner = [j for j in range(mjm.njnt) if mjm.jnt_bodyid[j] in robot and mjm.jnt_type[j] == 2]
        slides = [adr for adr in mjm.jnt_qposadr[inner] if adr not in arm.qposadr]
        corners = corners_of(layouts, column, len(arm.joints))
        for world in np.flatnonzero(np.isfinite(corners[:, 0, 0])).tolist():
            data.qpos[:] = layouts.qpos[world].numpy()
            data.mocap_pos[:] = layouts.mocap_pos[world, : mjm.nmocap].numpy()
            data.mocap_quat[:] = layouts.mocap_quat[world, : mjm.nmocap].numpy()
            np.testing.assert_array_equal(corners[world, 0], data.qpos[arm.qposadr].astype(np.float32))
            grasp = target.grasp_set.grasps[int(layouts.grasp[world, column])]
            data.qpos[slides] = 0.5 * min(grasp.opening + 0.01, one.gripper.opening)
            hits = (
                _hit(mjm, data, robot, own if piece == 3 else set())
                for piece in range(4)
                for share in np.linspace(0.0, 1.0, points)
                if _move(data, arm.qposadr, (1 - share) * corners[world, piece] + share * corners[world, piece + 1])
            )
            found.append(Walk(world, target.name, corners[world], next(filter(None, hits), "")))
    return found


def _move(data: mujoco.MjData, adr: np.ndarray, joints: np.ndarray) -> bool:
    data.qpos[adr] = joints
    return True


def _hit(mjm: mujoco.MjModel, data: mujoco.MjData, robot: set[int], target: set[int]) -> str:
    mujoco.mj_kinematics(mjm, data)
    mujoco.mj_comPos(mjm, data)
    mujoco.mj_collision(mjm, data)
    for pair, dist in zip(mjm.geom_bodyid[data.contact.geom], data.contact.dist, strict=True):
        bodies = set(pair.tolist())
        if bodies & robot and not bodies & target and dist <= 0.0:
            return f"{[mjm.body(body).name for body in pair]} {dist}"
    return ""
