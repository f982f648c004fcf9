"""`Observer`: the observations of a task as flat groups, with noise of sensors and pictures."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from sceniris_gym.vector import spaces
from sceniris_gym.vector.images import GROUP, Images
from sceniris_gym.vector.sensing import Sensing, Sensors
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task
from sceniris_gym.vector.task_checks import check_observation

PARAMETERS = "parameters"
"""The name of drawn physics and looks in the group `critic`."""


class Observer:
    """Observes the worlds of a task.

    Args:
        task: The task, which knows its state already.
        state: The worlds.
        images: Their pictures, None for none.
        action_size: Length of an action.
        groups: The groups to observe; None is all.
        sensing: Noise, delay and dropout; None for none.
        copy: Return new tensors every time, rather than one of two buffers and the latest pictures.

    Attributes:
        sensors: What `sensing` makes of observations and actions; None for nothing.
        names: Names and shapes of the parts of each flat group, in order.
        space: Space of one world's observations.

    Raises:
        TaskError: The task observes the wrong thing.
        UnknownNameError: It observes no such group.
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
        observation = spaces.chosen(observation, groups)
        flat = spaces.flatten(observation)
        self.names, self.space = spaces.names_of(observation), spaces.observation_space(flat)
        if images is not None:
            self.space[GROUP] = images.space
        self._kept = None if copy else (flat, {group: torch.empty_like(t) for group, t in flat.items()})

    def flat(self, buffer: int) -> dict[str, Tensor]:
        """Return the flat groups, in new tensors or in one of the two buffers."""
        observation = self._of_task()
        if self.sensors is not None:
            observation = self.sensors(self._state, observation)
        observation = spaces.chosen(observation, self._groups)
        return spaces.flatten(observation, None if self._kept is None else self._kept[buffer])

    def pictures(self, mask: Tensor | None = None, *, copy: bool = False) -> dict[str, Any]:
        """Return the group `images` after pictures of the masked worlds, by default of those that are due."""
        if self._images is None:
            return {}
        due = self._images.due(self._state.elapsed) if mask is None else mask
        return {GROUP: self._images.take(due, copy or self._copy)}

    def _of_task(self) -> Observation:
        """Return what the task observes, with the numbers that the scene has drawn in the group `critic`."""
        observation, parameters = self._task.observe(self._state), self._state.parameters
        if parameters is None or "critic" not in observation:
            return observation
        return {**observation, "critic": {**observation["critic"], PARAMETERS: parameters}}
