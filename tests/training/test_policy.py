"""`load_policy`: a trained policy acts as in its evaluation, and as its export."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import pytest
import torch

pytest.importorskip("rsl_rl")

from sceniris_gym import evaluate
from sceniris_gym.commands.train import train
from sceniris_gym.errors import ArgumentError
from sceniris_gym.training import load_policy
from sceniris_gym.training.settings import Options
from tests.training.scenes import write_task


def test_a_policy_acts_and_is_exported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The same actions from the export, clipped; `evaluate` takes the policy as it is."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SCENIRIS_GYM_CACHE", str(tmp_path / "cache"))
    task = write_task(tmp_path, "own_task_to_load")
    small = {"num_envs": 2, "layouts": 3, "every": 1, "million_steps": 1e-6, "changes": ("hidden=[8]", "steps=4")}
    train(Options(task, device="cpu", out=tmp_path / "run", **small), quiet=True)
    policy = load_policy(tmp_path / "run", "cpu")
    envs = gymnasium.make_vec(task, num_envs=3, device="cpu", max_episode_steps=3)
    observation, _ = envs.reset(seed=0)
    policy.export(tmp_path / "policy.pt")
    exported = torch.jit.load(str(tmp_path / "policy.pt"))
    with torch.inference_mode():
        wanted = exported(observation["policy"]).clamp(-1.0, 1.0)
    torch.testing.assert_close(policy(observation), wanted)
    assert torch.equal(policy(observation["policy"]), policy(observation))  # as with observation_groups="policy"
    assert len(evaluate(policy, envs, 4)) == 4


def test_a_folder_without_a_run_is_refused(tmp_path: Path):
    """By the name of the missing file."""
    with pytest.raises(ArgumentError, match=r"has no config\.json"):
        load_policy(tmp_path)
