"""Statements of a task's docstring about its observations, against the observations themselves."""

from __future__ import annotations

import re
from collections.abc import Sequence

from sceniris_gym.vector.task import Task
from sceniris_gym.vector.vector_env import SceneVectorEnv

ROW = re.compile(r"^\s+\| (\w+) \| (\d+(?:, \d+)*) \|", flags=re.MULTILINE)


def check_stated(task: type[Task], envs: SceneVectorEnv, privileged: Sequence[tuple[str, tuple[int, ...]]]) -> None:
    """Hold names, shapes and sizes of the class docstring against an environment."""
    assert task.__doc__ is not None
    table = [(name, tuple(map(int, shape.split(", ")))) for name, shape in ROW.findall(task.__doc__)]
    assert table == envs.observation_names["policy"]
    assert envs.observation_names["critic"] == [*table, *privileged]
    for group in envs.observation_names:
        size = envs.single_observation_space[group].shape[0]  # pyrefly: ignore[bad-index]
        assert re.search(rf"[Gg]roups? `{group}`[^.:]*, {size} numbers", task.__doc__) or (
            not privileged and re.search(rf"groups `policy` and `critic`, {size} numbers each", task.__doc__)
        )


def values(envs: SceneVectorEnv, observation: dict, name: str, group: str = "policy"):
    """Return a named part of a flat observation, shape (num_envs, ...)."""
    first = 0
    for other, shape in envs.observation_names[group]:
        size = 1
        for length in shape:
            size *= length
        if other == name:
            return observation[group][:, first : first + size].reshape(-1, *shape)
        first += size
    raise AssertionError(f"{name} is not observed")
