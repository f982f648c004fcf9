"""The layer of reach: slices of the arms' maps, as pictures at some height in the scene."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

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


@dataclass(frozen=True)
class ReachSlice:
    """A slice of the map of an arm.

    Attributes:
        map: The arm's map.
        body: Id of the arm's base.
    """

    map: ReachMap
    body: int

    @classmethod
    def of(cls, scene: SceneModel) -> list[ReachSlice]:
        """Return a slice for each robot of a scene that has a map."""
        found = []
        for name, robot in scene.config.all_robots.items():
            with contextlib.suppress(ScenirisError):
                reach_map = load_map(robot_arm(scene, name), robot, scene.config.where)
                if reach_map is not None:
                    found.append(cls(reach_map, scene.bodies[name]))
        return found

    @property
    def span(self) -> float:
        """Half the width of the slice [m]."""
        return -self.map.u_low

    def picture(self, data: mujoco.MjData, height: float) -> np.ndarray:
        """Return the picture at a height [m] of the world, (n, n, 4) uint8: more opaque where more approaches reach.

        It is `2 * span` wide, around the axis of the arm's first joint, with the base's y up and its x to the right.
        """
        ticks = (np.arange(_PIXELS) + 0.5) / _PIXELS * 2.0 * self.span - self.span
        across, up = np.meshgrid(ticks, ticks[::-1])
        points = np.stack([across, up, np.full_like(across, height - data.xpos[self.body, 2])], axis=-1)
        share = reached_share(self.map, points + [*self.map.arm.axis_xy, 0.0], _DIRECTIONS, "cpu")
        picture = np.empty((_PIXELS, _PIXELS, 4), np.uint8)
        picture[..., :3] = _FULL
        picture[..., 3] = np.round(_OPACITY * share)
        return picture

    def pose(self, data: mujoco.MjData, height: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the middle of the slice [m] and its orientation (wxyz)."""
        axis = data.xmat[self.body].reshape(3, 3) @ [*self.map.arm.axis_xy, 0.0]
        return np.array([*(data.xpos[self.body] + axis)[:2], height]), data.xquat[self.body]
