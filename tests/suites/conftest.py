"""A small task with most axes: an arm, a cabinet with a drawer, a group of two cans, and a thing with variants."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import gymnasium as gym
import pytest
import torch

from sceniris_gym.suites.making import make
from sceniris_gym.suites.suite import Suite
from tests.vector.conftest import SCENE, Reach

TASK, STEPS = "SuiteReach-v0", 6
CAN = {"asset": "can", "on": "floor", "region": {"box": [[0.5, -0.7], [0.75, -0.3]]}}
OBJECTS = {
    **SCENE["objects"],
    "cabinet": {**SCENE["objects"]["cabinet"], "joints": {"slide": {"fraction": [0.4, 0.9]}}},
    "first": CAN,
    "second": {**CAN, "region": {"box": [[0.5, 0.4], [0.75, 0.75]]}},
    "thing": {"asset": ["tin", "orange"], "on": "floor", "region": {"box": [[-0.75, -0.7], [-0.5, -0.4]]}},
}
WIDE = {
    **SCENE,
    "name": "suite_reach",
    "robot": {"in_model": "arm", "joints": {"arm/pan": {"range": [-0.1, 0.1]}}},
    "objects": OBJECTS,
    "groups": {"cans": {"of": ["first", "second"], "count": [0, 2]}},
    "bank": 8,
}


class Timed(Reach):
    """Success in the second step, and in the last one if the tool is low; worlds end at times that differ."""

    def success(self, s):
        """In the second step, or by the tool's place."""
        return (s.elapsed == 2) | ((s.elapsed >= 4) & (s.site("arm/tcp")[:, 1] > s.pose("block")[:, 1]))

    def terminated(self, s):
        """By the seed."""
        return (s.elapsed >= 4) & (s.seed % 3 == 0)


def act(observation: dict[str, torch.Tensor]) -> torch.Tensor:
    """Act by what the tool is at, row by row."""
    seen = observation["policy"]
    return torch.tanh(3.0 * seen[:, 2:3] * torch.linspace(-1.0, 1.0, 5) + seen[:, :5])


def still(observation: dict[str, torch.Tensor]) -> torch.Tensor:
    """Do not move."""
    return torch.zeros(len(observation["policy"]), 5)


@pytest.fixture(autouse=True)
def task() -> Iterator[str]:
    """Register the task, and return its id."""
    gym.register(
        TASK,
        vector_entry_point="sceniris_gym:SceneVectorEnv",
        max_episode_steps=STEPS,
        kwargs={"task": Timed, "scene": WIDE},
    )
    yield TASK
    gym.registry.pop(TASK)


_made: list[Suite] = []


@pytest.fixture
def suite(tmp_path: Path, task: str) -> Path:
    """Return the file of a suite with two cases for each of two grades, and shifts and turns."""
    if not _made:
        names = ("robot", "clutter", "joint", "variant", "mass", "shift", "turn")
        _made.append(make(task, names, 2, 2, cumulative=True, device="cpu")[0])
    _made[0].write(tmp_path / "suite.jsonl")
    return tmp_path / "suite.jsonl"
