"""`Observer`: turns a task's observations into flat groups, and adds spaces, sensor noise and pictures."""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from torch import Tensor

from sceniris_gym.errors import check_names
from sceniris_gym.vector.images import GROUP, Images
from sceniris_gym.vector.sensing import Sensing, Sensors
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task, check_observation

RANDOMIZED = "randomized"
"""Name under which the group `critic` has the drawn numbers of the physics and the appearance."""
Names = dict[str, list[tuple[str, tuple[int, ...]]]]
"""For each group, the name and the shape in one world of each tensor, in the order of concatenation."""


def chosen(observation: Observation, groups: tuple[str, ...] | None) -> Observation:
    """Return the groups named in `groups`, in this order, or all groups if `groups` is None.

    Raises:
        UnknownNameError: The observation has no such group.
    """
    if groups is None:
        return observation
    check_names("observation group", groups, "observation_groups", observation)
    return {group: observation[group] for group in groups}


def flatten(observation: Observation, out: dict[str, Tensor] | None = None) -> dict[str, Tensor]:
    """Concatenate the tensors of each group to one tensor of shape (num_envs, size), float32.

    Args:
        observation: An observation of a task.
        out: Tensors to write to, or None to allocate new tensors.
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
    """Return the space of one world's observation, for flat groups of shape (num_envs, size)."""
    return spaces.Dict({g: spaces.Box(-np.inf, np.inf, t.shape[1:], np.float32) for g, t in observation.items()})


def action_space(size: int) -> spaces.Box:
    """Return the space of one world's actions: `size` numbers in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (size,), np.float32)


class Observer:
    """Observes the worlds of a task.

    Args:
        task: The task, after `bind`.
        state: The worlds.
        images: Pictures of the worlds, or None.
        action_size: Length of an action.
        groups: The groups to observe, or None for all groups.
        sensing: Noise, delay and dropout, or None.
        copy: Return new tensors in every call. If false, `flat` returns one of two buffers, and `pictures` returns the
            latest pictures. Later calls overwrite both.

    Attributes:
        sensors: The Sensors that apply `sensing` to observations and actions, or None.
        names: Names and shapes of the parts of each flat group, in order.
        space: Space of one world's observations.

    Raises:
        TaskError: The task's observation has a wrong type or shape.
        UnknownNameError: The task's observation lacks a group of `groups`.
    """

    def __init__(
        self,
        task: Task,
        state: State,
        images: Images | None,
        action_size: int,
        *,
        groups: tuple[str, ...] | None,
        sensing: Sensing | None,
        copy: bool,
    ) -> None:
        self._task, self._state, self._images, self._groups, self._copy = task, state, images, groups, copy
        observation = self._of_task()
        check_observation(task, observation, state.num_envs)
        self.sensors = None if sensing is None else Sensors(state, sensing, observation, action_size)
        observation = chosen(observation, groups)
        flat = flatten(observation)
        self.names, self.space = names_of(observation), observation_space(flat)
        if images is not None:
            self.space[GROUP] = images.space
        self._kept = None if copy else (flat, {group: torch.empty_like(t) for group, t in flat.items()})

    def flat(self, buffer: int) -> dict[str, Tensor]:
        """Return the flat groups, in new tensors or in the buffer with the number `buffer`, 0 or 1."""
        observation = self._of_task()
        if self.sensors is not None:
            observation = self.sensors(self._state, observation)
        observation = chosen(observation, self._groups)
        return flatten(observation, None if self._kept is None else self._kept[buffer])

    def pictures(self, mask: Tensor | None = None, *, copy: bool = False) -> dict[str, Any]:
        """Take pictures of the masked worlds (None: all worlds with a picture due), and return the group `images`."""
        if self._images is None:
            return {}
        due = self._images.due(self._state.elapsed) if mask is None else mask
        return {GROUP: self._images.take(due, copy or self._copy)}

    def _of_task(self) -> Observation:
        """Return the task's observation. The group `critic` also gets the numbers that the scene's `randomize` drew."""
        observation, draws = self._task.observe(self._state), self._state.scene.draws
        if not draws or "critic" not in observation:
            return observation
        numbers = torch.cat([self._state.randomized(draw.name) for draw in draws], dim=1)
        return {**observation, "critic": {**observation["critic"], RANDOMIZED: numbers}}
