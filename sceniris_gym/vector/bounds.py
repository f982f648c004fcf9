"""`Bounds`: boxes around bodies, and the heights of their lowest corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.vector import rotations
from sceniris_gym.vector.state import State, find_body


class Bounds:
    """The smallest box around each of several bodies, along the axes of the body's frame.

    It contains the colliding geoms of the body itself, not those of its children. Boxes are computed once, on the host;
    `lowest` does not synchronise with it.

    Args:
        s: The worlds.
        names: Names of bodies.

    Raises:
        UnknownNameError: The scene has no such body.
        NotSupportedError: A body has no geom that collides.
    """

    def __init__(self, s: State, names: Sequence[str]) -> None:
        corners = np.array([_corners(s, name) for name in names])
        lower, upper = torch.tensor(corners, dtype=torch.float32, device=s.device).unbind(dim=1)
        self._middle, self._half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        self._up = torch.tensor([0.0, 0.0, 1.0], device=s.device)

    def lowest(self, poses: Tensor) -> Tensor:
        """Return the height of the lowest corner of each box [m], shape (num_envs, len(names)).

        This is z + r . c - |r| . h, with r the third row of the body's rotation matrix, c the box's centre and h its
        half extents. It is never above the body's lowest point, and is that point's height if the box is level.

        Args:
            poses: Poses of the same names from `State.poses`, shape (num_envs, len(names), 7).
        """
        row = rotations.rotate(rotations.conjugate(poses[..., 3:]), self._up.expand_as(poses[..., :3]))
        return poses[..., 2] + (row * self._middle - row.abs() * self._half).sum(dim=-1)


def _corners(s: State, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper corner of a body's box in its own frame [m], each of shape (3,)."""
    boxes = [piece.bounds() for piece in extract_pieces(s.mjm, "physics", {find_body(s, name, "Bounds")})]
    if not boxes:
        raise NotSupportedError(
            f"scene '{s.scene.config.name}': Bounds: body '{name}' has no geom that collides. Name a body that has one."
        )
    lower, upper = zip(*boxes, strict=True)
    return np.min(lower, axis=0), np.max(upper, axis=0)
