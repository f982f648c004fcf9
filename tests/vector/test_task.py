"""Defaults of a task, where its author says nothing."""

from __future__ import annotations

from types import SimpleNamespace

import torch

from sceniris_gym.vector.task import Task, regrouped


def test_actions_go_over_the_ranges_of_the_controls():
    """From end to end; of the worlds only what lies on their device is read, so that nothing is copied there."""
    limits = torch.tensor([[-2.0, 2.0], [0.0, 0.04]])
    state = SimpleNamespace(ctrl=torch.zeros(3, 2), control_range=limits)
    Task().apply(state, torch.tensor([[-1.0, -1.0], [0.0, 0.0], [1.0, 0.5]]))  # type: ignore[arg-type]
    torch.testing.assert_close(state.ctrl, torch.tensor([[-2.0, 0.0], [0.0, 0.02], [2.0, 0.03]]))


def test_what_the_critic_sees_is_regrouped():
    """The policy sees what it names, in that order; the critic sees it too, and then what is named for it alone."""
    a, b, c = (torch.full((2, 1), value) for value in (1.0, 2.0, 3.0))
    seen = {"policy": {"a": a}, "critic": {"a": a, "b": b, "c": c, "d": a}}
    shown = regrouped(seen, policy=("c", "a"), more=("b",))
    assert list(shown["policy"]) == ["c", "a"]
    assert list(shown["critic"]) == ["c", "a", "b"]
    assert all(shown["critic"][name] is value for name, value in (("a", a), ("b", b), ("c", c)))
