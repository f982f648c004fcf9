"""A policy for `play` from the folder of a run: small, with layouts, and replaced by better ones only."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest
import torch

from benchmarks.ship_policy import ship
from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.training.policies import policy_of
from sceniris_gym.training.settings import settings_of
from sceniris_gym.viewer.played import PlayedWorld

TASK = "TabletopReach-v0"


def write_run(folder: Path, success: float, scenehash: str) -> Path:
    """Write the folder of a run with a policy of one layer, whose first bias is its success rate."""
    folder.mkdir()
    actor = {"mlp.0.weight": torch.zeros(7, 55), "mlp.0.bias": torch.full((7,), success), "std": torch.ones(7)}
    normal = {f"obs_normalizer.{name}": torch.ones(1, 55) for name in ("_mean", "_std", "_var")}
    torch.save({"actor_state_dict": actor | normal, "critic_state_dict": {}, "iter": 1}, folder / "model.pt")
    config = {"options": {"task": TASK}, "settings": asdict(settings_of(TASK)), "scene": {"hash": scenehash}}
    (folder / "config.json").write_text(json.dumps(config))
    (folder / "log.jsonl").write_text(json.dumps({"kind": "eval", "valid": {"success": success}}) + "\n")
    return folder


def test_the_better_policy_of_two_runs_is_shipped(tmp_path: Path):
    """In half precision, and as `play` reads it; a run on another scene is refused."""
    scenehash = compile_scene("tabletop_reach", "cpu").hash
    good, bad = (write_run(tmp_path / str(share), share, scenehash) for share in (0.75, 0.5))
    assert f"{TASK}, success rate 75.0%" in ship(good, tmp_path)
    assert "stays: its success rate is 75.0%" in ship(bad, tmp_path)
    world, policy = PlayedWorld(tmp_path / "tabletop_reach.pt"), policy_of(str(tmp_path / "tabletop_reach.pt"))
    assert len(world.ids) == 64
    assert policy({"policy": torch.zeros(1, 55)}).tolist() == [[0.75] * 7]
    other = write_run(tmp_path / "other", 0.9, "0123456789abcdef")
    with pytest.raises(SceneMismatchError, match="Train again"):
        ship(other, tmp_path)
