"""Sensing: noise, delay and dropout of what a policy observes."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from sceniris_gym.config.settings import as_config
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError
from sceniris_gym.vector.sensing import Sensing
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task
from sceniris_gym.vector.vector_env import SceneVectorEnv

SCENE = {"floor": {"size": [1.0, 1.0]}, "objects": {"can": {"asset": "can", "on": "floor"}}, "bank": 4}


class Clock(Task):
    """Observes the time, and a table with nothing in its first row."""

    scene = "mid"
    action_size = 1

    def apply(self, s: State, action: Tensor) -> None:
        """Do nothing."""

    def observe(self, s: State) -> Observation:
        """Return the steps so far from 1 on, as one, as two numbers, and in a table; and a 0 of its own."""
        steps = s.elapsed[:, None] + 1.0
        rows = torch.stack([torch.zeros(s.num_envs, 2), torch.cat([steps, 0.0 * steps], dim=1)], dim=1)
        seen = {"time": steps, "two": torch.cat([steps, 2.0 * steps], dim=1), "rows": rows, "zero": 0.0 * steps}
        return {"policy": seen, "critic": seen}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return nothing."""
        return {"nothing": torch.zeros(s.num_envs)}

    def success(self, s: State) -> Tensor:
        """Return no worlds."""
        return torch.zeros(s.num_envs, dtype=torch.bool)


def make(sensing: Any, num_envs: int = 8, **kwargs: Any) -> SceneVectorEnv:
    """Return environments of the clock."""
    return SceneVectorEnv(Clock, num_envs, scene=SCENE, device="cpu", sensing=sensing, **kwargs)


def run(envs: SceneVectorEnv, steps: int, seed: int = 5) -> tuple[Tensor, Tensor]:
    """Return both groups of all steps, each (steps + 1, num_envs, 8)."""
    seen = [envs.reset(seed=seed)[0]]
    seen += [envs.step(torch.zeros(envs.num_envs, 1))[0] for _ in range(steps)]
    policy, critic = (torch.stack([each[group] for each in seen]) for group in ("policy", "critic"))
    return policy, critic


def test_noise_is_gaussian_of_the_given_deviation_and_spares_what_is_masked():
    """Mean and deviation of 64 worlds' noise, also where the value is 0; rows of zeros stay so."""
    policy, critic = run(make({"noise": {"time": 0.1, "rows": 0.1, "zero": 0.1}}, 64), 200)
    for place in (0, 5, 6, 7):
        noise = (policy - critic)[:, :, place]
        assert abs(float(noise.mean())) < 0.004
        assert float(noise.std()) == pytest.approx(0.1, rel=0.03)
        assert float((noise.abs() < 0.1).float().mean()) == pytest.approx(0.683, abs=0.015)
    assert torch.equal(policy[:, :, 1:5], critic[:, :, 1:5])
    steps = torch.arange(1.0, 202.0)[:, None].expand(-1, 64)
    assert torch.equal(critic[:, :, 0], steps)


def test_everything_depends_on_seed_episode_and_step_alone():
    """Other numbers of worlds see the same; another seed does not."""
    sensing = Sensing(noise={"two": 0.5}, delay=(0, 3), dropout=0.3)
    few, many = run(make(sensing, 3), 20)[0], run(make(sensing, 8), 20)[0]
    assert torch.equal(few, many[:, :3])
    assert not torch.equal(few, run(make(sensing, 3), 20, seed=900)[0])


def test_a_delay_is_drawn_for_an_episode():
    """Every world sees what was a fixed number of steps ago, each number in turn; at first it sees the first step."""
    policy, critic = run(make({"delay": [1, 3]}, 64), 12)
    late = critic[-1, :, 0] - policy[-1, :, 0]
    assert set(late.tolist()) == {1.0, 2.0, 3.0}
    steps = torch.arange(13.0)[:, None]
    assert torch.equal(policy[:, :, 0], (steps - late).clamp(min=0.0) + 1.0)
    assert torch.equal(policy[:, :, 2], 2.0 * policy[:, :, 0])


def test_what_drops_out_is_seen_again():
    """Each name by itself, as often as asked, and never in the first step; what is not late is not dropped."""
    policy, critic = run(make(Sensing(dropout=0.25, late=("time",)), 64), 200)
    assert torch.equal(policy[:, :, 1:], critic[:, :, 1:])
    lost = policy[1:, :, 0] == policy[:-1, :, 0]
    assert float(lost.float().mean()) == pytest.approx(0.25, abs=0.02)
    assert torch.equal(policy[1:, :, 0][~lost], critic[1:, :, 0][~lost])
    assert torch.equal(policy[0], critic[0])
    both = run(make(Sensing(dropout=0.25), 64), 100)[0]
    lost = (both[1:] == both[:-1])[:, :, :3]
    assert torch.equal(lost[:, :, 1], lost[:, :, 2])
    assert not torch.equal(lost[:, :, 0], lost[:, :, 1])


def test_a_reset_leaves_what_other_worlds_see():
    """A reset on request or by itself leaves them alone; an episode's last observation is sensed too."""
    sensing = Sensing(noise={"time": 0.1}, delay=(0, 2), dropout=0.2)
    envs = make(sensing, 8)
    policy = run(envs, 5)[0]
    mask = torch.arange(8) < 3
    again, _ = envs.reset(options={"reset_mask": mask})
    assert torch.equal(again["policy"][~mask], policy[-1][~mask])
    assert not torch.equal(again["policy"][mask], policy[-1][mask])
    ended, _ = run(make(sensing, 8, max_episode_steps=5), 5)
    assert (ended[-1, :, 0] < 2.0).all(), "the first step of the next episode"
    envs = make(sensing, 8, max_episode_steps=5)
    envs.reset(seed=5)
    for _ in range(4):
        envs.step(torch.zeros(8, 1))
    info = envs.step(torch.zeros(8, 1))[4]
    assert torch.equal(info["final_obs"]["policy"], policy[-1])


def test_wrong_values_are_named():
    """Names that the policy does not observe, numbers out of range, and other types."""
    for value, text in (
        ({"noise": {"time": -1.0}}, "noise of 'time'"),
        ({"delay": (2, 1)}, "low <= high"),
        ({"dropout": 1.0}, r"\[0, 1\)"),
    ):
        with pytest.raises(ArgumentError, match=text):
            as_config(Sensing, value, "sensing")
    for other, text in (
        (0.1, "a Sensing, a mapping"),
        ({"noise": 0.01}, "noise should map names to numbers"),
        ({"noise": {"time": "a lot"}}, "noise should map names to numbers"),
        ({"delay": 2}, "delay should be a pair"),
        ({"dropout": "x"}, "dropout should be a number"),
        ({"late": "time"}, "late should be a tuple of names"),
    ):
        with pytest.raises(ArgumentTypeError, match=text):
            as_config(Sensing, other, "sensing")
    with pytest.raises(UnknownNameError, match="unknown field 'delays'"):
        as_config(Sensing, {"delays": (0, 1)}, "sensing")
    with pytest.raises(UnknownNameError, match="unknown observation 'tim'"):
        make({"noise": {"tim": 0.1}}, 1)


def test_encoder_biases_last_for_an_episode_and_are_uniform():
    """Each number has its own, within the bound; the next episode has others."""
    envs = make({"encoder_bias": {"two": 0.1}}, 64)
    policy, critic = run(envs, 3)
    bias = (policy - critic)[:, :, 1:3]
    assert torch.allclose(bias[0], bias[3], atol=1e-6)
    assert 0.05 < bias.abs().max() <= 0.1
    assert (bias[0, :, 0] - bias[0, :, 1]).abs().min() > 0.0
    assert abs(bias[0].mean()) < 0.02
    others = [0, *range(3, policy.shape[2])]
    assert torch.equal(policy[:, :, others], critic[:, :, others])
    seen, _ = envs.reset()
    assert ((seen["policy"] - seen["critic"])[:, 1:3] - bias[0]).abs().min() > 0.0


class Echo(Clock):
    """Keeps the actions that arrive."""

    def bind(self, s: State) -> None:
        """Make room for them."""
        self.arrived = torch.zeros(s.num_envs, 1)

    def apply(self, s: State, action: Tensor) -> None:
        """Keep one."""
        self.arrived.copy_(action)


def test_actions_arrive_late():
    """By the delay of the episode; the first one is repeated until then, also after a reset in part."""
    envs = SceneVectorEnv(Echo, 16, scene=SCENE, device="cpu", sensing={"action_delay": [1, 3]})
    envs.reset(seed=1)
    arrived = []
    for step in range(8):
        envs.step(torch.full((16, 1), 0.1 * step))
        arrived.append(envs.task.arrived.clone())  # pyrefly: ignore[missing-attribute]
    found = torch.stack(arrived)[:, :, 0]
    delay = ((0.7 - found[7]) / 0.1).round().long()
    assert set(delay.tolist()) == {1, 2, 3}
    for step in range(8):
        expected = 0.1 * (step - delay).clamp(min=0)
        assert torch.allclose(found[step], expected)
    envs.reset(options={"reset_mask": torch.arange(16) == 0})
    envs.step(torch.full((16, 1), 0.8))
    assert envs.task.arrived[0] == pytest.approx(0.8)  # pyrefly: ignore[missing-attribute]
    assert torch.allclose(envs.task.arrived[1:, 0], 0.8 - 0.1 * delay[1:])  # pyrefly: ignore[missing-attribute]
