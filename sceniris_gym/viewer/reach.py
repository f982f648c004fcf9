"""The layer of reach: slices of the arms' maps, as pictures at some height in the scene."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.errors import ScenirisError
from sceniris_gym.pictures.reach_picture import reached_share
from sceniris_gym.program.reach import load_map, robot_arm
from sceniris_gym.reach.map import ReachMap
from sceniris_gym.scene.model import SceneModel

_PIXELS = 96
_DIRECTIONS = 48
_FULL = np.array([38.0, 110.0, 190.0])
_OPACITY = 170.0  # of 255, where every direction is reached


class ReachSlice:
    """Slices of the map of an arm.

    Args:
        reach_map: The arm's map.
        body: Id of the arm's base.
        base: Position [m] and orientation of the arm's base.
    """

    def __init__(self, reach_map: ReachMap, body: int, base: tuple[np.ndarray, np.ndarray]) -> None:
        self.map, self.body, self.base = reach_map, body, base
        self.span = -reach_map.u_low

    @classmethod
    def of(cls, scene: SceneModel) -> list[ReachSlice]:
        """Return a slice for each robot of a scene that has a map, with its base at home."""
        data, found = mujoco.MjData(scene.mjm), []
        data.qpos[:] = scene.home_qpos
        mujoco.mj_kinematics(scene.mjm, data)
        for name, robot in scene.config.all_robots.items():
            try:
                reach_map = load_map(robot_arm(scene, name), robot, scene.config.where)
            except ScenirisError:
                continue
            body = scene.bodies[name]
            if reach_map is not None:
                found.append(cls(reach_map, body, (data.xpos[body].copy(), data.xquat[body].copy())))
        return found

    def at(self, data: mujoco.MjData) -> ReachSlice:
        """Return the same slice in the state of a layout, in which the base may stand elsewhere."""
        return ReachSlice(self.map, self.body, (data.xpos[self.body].copy(), data.xquat[self.body].copy()))

    def picture(self, height: float) -> np.ndarray:
        """Return the picture at a height [m] of the world, (n, n, 4) uint8: more opaque where more approaches reach.

        It is `2 * span` wide, around the axis of the arm's first joint, with the base's y up and its x to the right.
        """
        ticks = (np.arange(_PIXELS) + 0.5) / _PIXELS * 2.0 * self.span - self.span
        across, up = np.meshgrid(ticks, ticks[::-1])
        points = np.stack([across, up, np.full_like(across, height - self.base[0][2])], axis=-1)
        share = reached_share(self.map, points + [*self.map.arm.axis_xy, 0.0], _DIRECTIONS, "cpu")
        picture = np.empty((_PIXELS, _PIXELS, 4), np.uint8)
        picture[..., :3] = _FULL
        picture[..., 3] = np.round(_OPACITY * share)
        return picture

    def pose(self, height: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the middle of the slice [m] and its orientation (wxyz)."""
        offset = np.empty(3)
        mujoco.mju_rotVecQuat(offset, np.array([*self.map.arm.axis_xy, 0.0]), self.base[1])
        at = self.base[0] + offset
        return np.array([at[0], at[1], height]), self.base[1]
