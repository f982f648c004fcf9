"""Defaults of a task, and checks of its first results: the error names task, method and form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from sceniris_gym.errors import TaskError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.task import Task, regrouped
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach

ALL = torch.zeros(3, 7)
EACH = torch.zeros(3)
OBSERVATION = "should return {group: {name: tensor of shape (3, ...)}}"
REWARD = "should return {name: tensor of shape (3,)}"
FLAGS = "should return a bool tensor of shape (3,)"


def test_actions_go_over_the_ranges_of_the_controls():
    """From end to end; of the worlds only what lies on their device is read, so that nothing is copied there."""
    limits = torch.tensor([[-2.0, 2.0], [0.0, 0.04]])
    state = SimpleNamespace(ctrl=torch.zeros(3, 2), control_range=limits)
    Task().apply(state, torch.tensor([[-1.0, -1.0], [0.0, 0.0], [1.0, 0.5]]))  # pyrefly: ignore[bad-argument-type]
    torch.testing.assert_close(state.ctrl, torch.tensor([[-2.0, 0.0], [0.0, 0.02], [2.0, 0.03]]))


def test_what_the_critic_sees_is_regrouped():
    """The policy sees what it names, in that order; the critic sees it too, and then what is named for it alone."""
    a, b, c = (torch.full((2, 1), value) for value in (1.0, 2.0, 3.0))
    seen = {"policy": {"a": a}, "critic": {"a": a, "b": b, "c": c, "d": a}}
    shown = regrouped(seen, policy=("c", "a"), more=("b",))
    assert list(shown["policy"]) == ["c", "a"]
    assert list(shown["critic"]) == ["c", "a", "b"]
    assert all(shown["critic"][name] is value for name, value in (("a", a), ("b", b), ("c", c)))


def task(method: str, value: Any) -> Reach:
    """Return a reaching task of which one method returns `value`."""
    made = Reach()
    setattr(made, method, lambda *_: value)
    return made


@pytest.mark.parametrize(
    ("observation", "got"),
    [
        (ALL, "returned a float32 tensor of shape (3, 7)"),
        ({"policy": ALL}, "returned {'policy': a float32 tensor of shape (3, 7)}"),
        ({"policy": {"a": ALL, "b": ALL[0]}}, "returned {'policy': {'b': a float32 tensor of shape (7,)}}"),
        ({"policy": {"a": torch.tensor(1)}}, "returned {'policy': {'a': an int64 tensor of shape ()}}"),
        ({"policy": {"a": [1.0] * 3}}, "returned {'policy': {'a': a list}}"),
        ({"policy": {}}, "returned {'policy': an empty dict}"),
        ({}, "returned an empty dict"),
        (None, "returned a NoneType"),
    ],
)
def test_an_observation_of_another_form_is_refused_when_the_environment_is_made(
    reach_scene: CompiledScene, observation: Any, got: str
):
    """Groups of named tensors with a row for each world, and none of them empty."""
    with pytest.raises(TaskError) as caught:
        SceneVectorEnv(task("observe", observation), 3, scene=reach_scene)
    assert str(caught.value).startswith(f"Reach.observe {got}, ")
    assert OBSERVATION in str(caught.value)


@pytest.mark.parametrize(
    ("method", "value", "got", "form"),
    [
        ("reward", EACH, "a float32 tensor of shape (3,)", REWARD),
        ("reward", {"near": ALL}, "{'near': a float32 tensor of shape (3, 7)}", REWARD),
        ("reward", {"near": 1.0}, "{'near': a float}", REWARD),
        ("reward", {}, "an empty dict", REWARD),
        ("success", EACH, "a float32 tensor of shape (3,)", FLAGS),
        ("success", torch.tensor(True), "a bool tensor of shape ()", FLAGS),
        ("terminated", {"a": EACH > 0}, "a dict", FLAGS),
    ],
)
def test_an_outcome_of_another_form_is_refused_in_the_first_step(
    reach_scene: CompiledScene, method: str, value: Any, got: str, form: str
):
    """Named terms of the reward, and flags, with an entry for each world."""
    envs = SceneVectorEnv(task(method, value), 3, scene=reach_scene)
    envs.reset(seed=0)
    with pytest.raises(TaskError) as caught:
        envs.step(torch.zeros(3, 5))
    assert str(caught.value) == f"Reach.{method} returned {got}, but {form}."


@pytest.mark.parametrize("name", ["episodes", "length", "return", "success"])
def test_a_term_of_the_reward_is_not_named_like_a_statistic(reach_scene: CompiledScene, name: str):
    """It would take the statistic's place in a log."""
    envs = SceneVectorEnv(task("reward", {"near": EACH, name: EACH}), 3, scene=reach_scene)
    envs.reset(seed=0)
    with pytest.raises(TaskError, match=f"^Reach.reward returned a term named '{name}', .*such as '{name}_reward'"):
        envs.step(torch.zeros(3, 5))
