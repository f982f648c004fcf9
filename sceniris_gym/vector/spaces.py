"""Observations as one flat tensor per group, and the Gymnasium spaces of observations and actions."""

from __future__ import annotations

import numpy as np
import torch
from gymnasium import spaces
from torch import Tensor

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.vector.task import Observation

Names = dict[str, list[tuple[str, tuple[int, ...]]]]
"""Group -> (name, shape in one world) of its tensors, in the order in which they are concatenated."""


def chosen(observation: Observation, groups: tuple[str, ...] | None) -> Observation:
    """Return the named groups of an observation, in that order; None is all.

    Raises:
        UnknownNameError: There is no such group.
    """
    if groups is None:
        return observation
    for group in groups:
        if group not in observation:
            raise UnknownNameError("observation group", str(group), "observation_groups", observation)
    return {group: observation[group] for group in groups}


def flatten(observation: Observation, out: dict[str, Tensor] | None = None) -> dict[str, Tensor]:
    """Concatenate the tensors of each group: shape (num_envs, size), float32.

    Args:
        observation: An observation of a task.
        out: Tensors to write to; None makes new ones.
    """
    return {
        group: torch.cat(
            [t.reshape(len(t), -1).float() for t in tensors.values()], dim=1, out=None if out is None else out[group]
        )
        for group, tensors in observation.items()
    }


def names_of(observation: Observation) -> Names:
    """Return the names and shapes of the parts of each flat group, in order."""
    return {group: [(name, tuple(t.shape[1:])) for name, t in named.items()] for group, named in observation.items()}


def observation_space(observation: dict[str, Tensor]) -> spaces.Dict:
    """Return the space of one world for flat groups of shape (num_envs, size)."""
    return spaces.Dict({g: spaces.Box(-np.inf, np.inf, t.shape[1:], np.float32) for g, t in observation.items()})


def action_space(size: int) -> spaces.Box:
    """Return the space of one world's actions: `size` numbers in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (size,), np.float32)
