"""Observations as flat groups: named tensors side by side, and the spaces that describe them."""

from __future__ import annotations

import numpy as np
import torch
from gymnasium import spaces
from torch import Tensor

from sceniris_gym.vector.task import Observation

Names = dict[str, list[tuple[str, tuple[int, ...]]]]
"""Group to (name, shape in one world) in the order in which the tensors lie side by side."""


def flatten(observation: Observation, out: dict[str, Tensor] | None = None) -> dict[str, Tensor]:
    """Lay the tensors of each group side by side: shape (num_envs, size), float32.

    Args:
        observation: what a task observes
        out: tensors to write to; new ones when None
    """
    return {
        group: torch.cat(
            [t.reshape(len(t), -1).float() for t in tensors.values()], dim=1, out=None if out is None else out[group]
        )
        for group, tensors in observation.items()
    }


def names_of(observation: Observation) -> Names:
    """Say what lies where in the flat groups."""
    return {group: [(name, tuple(t.shape[1:])) for name, t in named.items()] for group, named in observation.items()}


def observation_space(observation: dict[str, Tensor]) -> spaces.Dict:
    """Return the space of one world for flat groups of shape (num_envs, size)."""
    return spaces.Dict({g: spaces.Box(-np.inf, np.inf, t.shape[1:], np.float32) for g, t in observation.items()})


def action_space(size: int) -> spaces.Box:
    """Return the space of one world's actions: `size` numbers in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (size,), np.float32)
