"""`Bounds`: boxes around bodies, and the heights of their lowest corners."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from sceniris_gym.vector import rotations
from sceniris_gym.vector.names import find_body
from sceniris_gym.vector.state import State
from sceniris_gym.vector.variants import Boxes


class Bounds:
    """The smallest box around each of several bodies, along the axes of the body's frame.

    It contains the colliding geoms of the body itself, of the variant that a world has, not those of its children.
    Boxes are computed once, on the host; `lowest` does not synchronise with it.

    Args:
        s: The worlds.
        names: Names of bodies.

    Raises:
        UnknownNameError: The scene has no such body.
        NotSupportedError: A body has no geom that collides.
    """

    def __init__(self, s: State, names: Sequence[str]) -> None:
        bodies = [find_body(s.scene, name, "Bounds") for name in names]
        self._boxes = Boxes(s.variants, bodies, f"scene '{s.scene.config.name}': Bounds")
        self._up = torch.tensor([0.0, 0.0, 1.0], device=s.device)

    def lowest(self, poses: Tensor) -> Tensor:
        """Return the height of the lowest corner of each box [m], shape (num_envs, len(names)).

        This is z + r . c - |r| . h, with r the third row of the body's rotation matrix, c the box's centre and h its
        half extents. It is never above the body's lowest point, and is that point's height if the box is level.

        Args:
            poses: Poses of the same names from `State.poses`, shape (num_envs, len(names), 7).
        """
        lower, upper = self._boxes.corners()
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        row = rotations.rotate(rotations.conjugate(poses[..., 3:]), self._up.expand_as(poses[..., :3]))
        return poses[..., 2] + (row * middle - row.abs() * half).sum(dim=-1)
