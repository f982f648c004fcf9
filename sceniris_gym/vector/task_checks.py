"""Checks of what the methods of a task return in their first call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

from sceniris_gym.errors import TaskError
from sceniris_gym.vector.statistics import COUNTS
from sceniris_gym.vector.task import Task

TAKEN = (*COUNTS, "return")
"""Names that reward terms cannot have, as statistics and logs use them."""


def check_observation(task: Task, observation: Any, num_envs: int) -> None:
    """Check that an observation is {group: {name: tensor of shape (num_envs, ...)}}.

    Raises:
        TaskError: It is not; the message names the task and what it returned.
    """
    form = f"{{group: {{name: tensor of shape ({num_envs}, ...)}}}}, where an actor sees the group 'policy'"
    _check(task, "observe", observation, form, depth=2, fits=lambda t: t.shape[:1] == (num_envs,))


def check_outcome(task: Task, reward: Any, success: Any, terminated: Any, num_envs: int) -> None:
    """Check that a reward is {name: tensor of shape (num_envs,)} and that flags have shape (num_envs,), bool.

    No reward term may have the name of a statistic.

    Raises:
        TaskError: Something is wrong; the message names the task, the method and what it returned.
    """
    form = f"{{name: tensor of shape ({num_envs},)}}"
    _check(task, "reward", reward, form, depth=1, fits=lambda t: t.shape == (num_envs,))
    for name in TAKEN:
        if name in reward:
            form = f"terms with other names, such as '{name}_reward': {', '.join(TAKEN)} are names of statistics"
            raise TaskError(type(task).__name__, "reward", f"a term named '{name}'", form)
    for method, flags in (("success", success), ("terminated", terminated)):
        form = f"a bool tensor of shape ({num_envs},)"
        _check(task, method, flags, form, depth=0, fits=lambda t: t.shape == (num_envs,) and t.dtype is torch.bool)


def _check(task: Task, method: str, value: Any, form: str, depth: int, fits: Callable[[Tensor], bool]) -> None:
    wrong = _first_wrong(value, depth, fits)
    if wrong is not None:
        raise TaskError(type(task).__name__, method, wrong, form)


def _first_wrong(value: Any, depth: int, fits: Callable[[Tensor], bool]) -> str | None:
    """Describe the first part that is not a mapping down to `depth`, or not a tensor that fits there; else None."""
    if depth == 0:
        return None if isinstance(value, Tensor) and fits(value) else _described(value)
    if not isinstance(value, Mapping) or not value:
        return _described(value)
    parts = ((name, _first_wrong(part, depth - 1, fits)) for name, part in value.items())
    return next((f"{{{name!r}: {wrong}}}" for name, wrong in parts if wrong is not None), None)


def _described(value: Any) -> str:
    if isinstance(value, Tensor):
        name = f"{str(value.dtype).removeprefix('torch.')} tensor of shape {tuple(value.shape)}"
    elif isinstance(value, Mapping) and not value:
        name = f"empty {type(value).__name__}"
    else:
        name = type(value).__name__
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
