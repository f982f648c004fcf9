"""Paths to grasps walked in MuJoCo C, which shares no code with their search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import torch

from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.reach import ReachingArm
from sceniris_gym.reach.arm import MAX_JOINTS


class PathRow(NamedTuple):
    """A layout with a path to the reach target `column`, whose corners have the shape (5, njoint)."""

    world: int
    column: int
    corners: np.ndarray
    grasp: int
    qpos: np.ndarray
    mocap_pos: np.ndarray
    mocap_quat: np.ndarray


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
    return torch.cat([path, ends], dim=1)[..., :njoint].cpu().numpy()


def rows_of(compiled: CompiledScene, layouts: Layouts) -> list[PathRow]:
    """Return all paths of layouts, target by target."""
    assert compiled.reaching is not None
    names = ("grasp", "qpos", "mocap_pos", "mocap_quat")
    grasp, qpos, pos, quat = (getattr(layouts, name).cpu().numpy() for name in names)
    pos, quat, found = pos[:, : compiled.mjm.nmocap], quat[:, : compiled.mjm.nmocap], []
    for column, target in enumerate(compiled.reaching.targets):
        corners = corners_of(layouts, column, len(compiled.reaching.arm_of(target).arm.joints))
        for i in np.flatnonzero(np.isfinite(corners[:, 0, 0])).tolist():
            found.append(PathRow(i, column, corners[i], int(grasp[i, column]), qpos[i], pos[i], quat[i]))
    return found


def open_fingers(compiled: CompiledScene, one: ReachingArm, opening: float, qpos: np.ndarray) -> None:
    """Write the fingers into `qpos`, 1 cm wider open than a grasp needs. Each is a slide, for half of the gap."""
    mjm, robot = compiled.mjm, compiled.scene.subtree(one.robot)
    slides = np.isin(mjm.jnt_bodyid, robot) & (mjm.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE)
    qpos[np.setdiff1d(mjm.jnt_qposadr[slides], one.arm.qposadr)] = 0.5 * min(opening + 0.01, one.gripper.opening)


class Walker:
    """MuJoCo C's model of a scene, and the bodies of its robots and targets. It can be sent to another process."""

    def __init__(self, compiled: CompiledScene) -> None:
        self.mjm, self.data = compiled.mjm, mujoco.MjData(compiled.mjm)
        assert compiled.reaching is not None
        targets = compiled.reaching.targets
        arms, scene = [compiled.reaching.arm_of(target) for target in targets], compiled.scene
        self.joints = [one.arm.qposadr for one in arms]
        self.robots = [np.isin(np.arange(self.mjm.nbody), scene.subtree(one.robot)) for one in arms]
        self.targets = [np.isin(np.arange(self.mjm.nbody), scene.subtree(target.name)) for target in targets]

    def hit(self, row: PathRow, points: Sequence[int]) -> str:
        """Return the first contact of the robot as text. Only the hand may touch the target, on the last piece.

        Args:
            row: The layout, with open fingers.
            points: Number of points on each of the four pieces.
        """
        mjm, data, robot = self.mjm, self.data, self.robots[row.column]
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = row.qpos, row.mocap_pos, row.mocap_quat
        for piece, number in enumerate(points):
            for share in np.linspace(0.0, 1.0, number):
                data.qpos[self.joints[row.column]] = (1 - share) * row.corners[piece] + share * row.corners[piece + 1]
                mujoco.mj_kinematics(mjm, data)
                mujoco.mj_comPos(mjm, data)
                mujoco.mj_collision(mjm, data)
                pairs = mjm.geom_bodyid[data.contact.geom]
                wrong = robot[pairs].any(axis=1) & (data.contact.dist <= 0.0)
                if piece == 3:
                    wrong &= ~self.targets[row.column][pairs].any(axis=1)
                for i in np.flatnonzero(wrong):
                    return f"{[mjm.body(body).name for body in pairs[i]]} {data.contact.dist[i]}"
        return ""


def opened(compiled: CompiledScene, rows: Sequence[PathRow]) -> list[PathRow]:
    """Return layouts with the fingers open as for their grasps."""
    assert compiled.reaching is not None
    found = []
    for row in rows:
        target, qpos = compiled.reaching.targets[row.column], row.qpos.copy()
        opening = target.grasp_set.grasps[row.grasp].opening
        open_fingers(compiled, compiled.reaching.arm_of(target), opening, qpos)
        found.append(row._replace(qpos=qpos))
    return found


def walked(compiled: CompiledScene, layouts: Layouts, points: int = 101) -> list[Walk]:
    """Walk all paths, at so many points of each piece."""
    assert compiled.reaching is not None
    walker, found, rows = Walker(compiled), [], rows_of(compiled, layouts)
    for row, open_row in zip(rows, opened(compiled, rows), strict=True):
        np.testing.assert_array_equal(row.corners[0], row.qpos[walker.joints[row.column]].astype(np.float32))
        name = compiled.reaching.targets[row.column].name
        found.append(Walk(row.world, name, row.corners, walker.hit(open_row, [points] * 4)))
    return found
