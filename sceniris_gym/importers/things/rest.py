"""The poses in which an asset rests, and how far it moves in each of them in MuJoCo C."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.framing import box_corners
from sceniris_gym.geometry.pieces import extract_pieces, mesh_vertices
from sceniris_gym.geometry.resting_poses import HomeShape
from sceniris_gym.geometry.rotations import matrix

SECONDS, STILL = 0.5, 0.01
"""An asset rests in a pose if no point of its bounds moves by more than 1 cm in half a second."""
_GAP = 0.0005  # m over the floor, as in scenes
_MOST = 6  # poses that are tried, the most probable ones
_STANDING = 0.985  # cosine of 10 degrees: a stable pose this near to the authored one is that one


@dataclass(frozen=True)
class Rest:
    """A resting pose.

    Attributes:
        quat: Orientation of the asset, wxyz, its heading being 0.
        probability: The share of throws after which the asset rests in it.
        moved: The distance that it moves in the half second after it is put down in it [m].
    """

    quat: np.ndarray
    probability: float
    moved: float


def resting_poses(path: Path) -> list[Rest]:
    """Return the most probable poses in which an asset rests; none if it rolls from all of them."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.worldbody.bodies[0].add_freejoint()
    mjm = spec.compile()
    home = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, home)
    mujoco.mj_comPos(mjm, home)
    try:
        poses = HomeShape(home, 1, extract_pieces(mjm, "physics")).stable(str(path))
    except SceneKeyError:  # it rolls, or its centre of mass is outside of it
        return []
    return [Rest(quat, share, moved(path, quat)) for quat, share in poses[:_MOST]]


def stands(rests: list[Rest], up: np.ndarray) -> bool:
    """Return whether this direction in the asset's frame, shape (3,), points up in one of the poses."""
    return any(matrix(rest.quat)[2] @ up > _STANDING for rest in rests)


def moved(path: Path, quat: np.ndarray) -> float:
    """Put an asset on a floor and return how far the corners of its bounds move [m] in half a second.

    Args:
        path: Its MJCF.
        quat: Its orientation, wxyz.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.worldbody.bodies[0].add_freejoint()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0], friction=[0.8, 0.005, 0.0001])
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    data.qpos[3:7] = quat
    mujoco.mj_kinematics(mjm, data)
    points = [
        data.geom_xpos[g] + mesh_vertices(mjm, mjm.geom_dataid[g]) @ data.geom_xmat[g].reshape(3, 3).T
        for g in range(mjm.ngeom)
        if mjm.geom_contype[g] and mjm.geom_dataid[g] >= 0
    ]
    every = np.concatenate(points)
    data.qpos[2] = _GAP - every[:, 2].min()
    low, high = every.min(axis=0), every.max(axis=0)
    local = box_corners(0.5 * (low + high), 0.5 * (high - low)) @ matrix(quat)
    start = data.qpos[:3] + local @ matrix(quat).T
    while data.time < SECONDS:
        mujoco.mj_step(mjm, data)
    end = data.qpos[:3] + local @ matrix(data.qpos[3:7]).T
    return float(np.linalg.norm(end - start, axis=1).max())
