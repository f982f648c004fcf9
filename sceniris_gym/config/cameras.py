"""`CameraConfig`, a camera that a scene adds to the world or to a body."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import model_validator

from sceniris_gym.config.fields import Number, Point3, within, wrong
from sceniris_gym.config.section import Section


class CameraConfig(Section):
    """A camera at `pos` that looks at the point `look_at` [m]; the direction `up` points up in its pictures.

    All three are in the frame of `body`, which carries the camera: an object, a robot, or a body inside one as
    `robot/hand`. Without a body they are in the world frame. `up` is by default the z axis, or the x axis for a camera
    that looks along z. `fovy` is the vertical field of view [degrees].
    """

    body: str | None = None
    pos: Point3
    look_at: Point3
    up: Point3 | None = None
    fovy: Annotated[Number, within("field of view")] = 45.0

    @property
    def backward(self) -> np.ndarray:
        """The vector from the point that is looked at to the camera [m], shape (3,)."""
        return np.subtract(self.pos, self.look_at)

    @property
    def upward(self) -> np.ndarray:
        """The direction that points up in pictures, shape (3,)."""
        if self.up is not None:
            return np.array(self.up)
        return np.array([0.0, 0.0, 1.0] if np.abs(self.backward[:2]).max() > 1e-6 else [1.0, 0.0, 0.0])

    @model_validator(mode="after")
    def _looks_somewhere(self) -> CameraConfig:
        if np.linalg.norm(self.backward) < 1e-6:
            raise wrong("should have a 'look_at' that is elsewhere than its 'pos'")
        if np.linalg.norm(np.cross(self.upward, self.backward)) < 1e-6 * np.linalg.norm(self.backward):
            raise wrong("should have an 'up' that is no multiple of the direction in which it looks")
        return self
