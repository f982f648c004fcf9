"""The cost of fresh layouts, measured beside the same layouts from a bank."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import reset_cost
from sceniris_gym.vector.vector_env import SceneVectorEnv


@pytest.mark.slow
def test_the_cost_of_resets_is_measured_on_equal_terms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Fresh and replayed environments go through the same states."""
    kept: list[SceneVectorEnv] = []

    def keep(envs: SceneVectorEnv, actions: Any, steps: int) -> float:
        kept.append(envs)
        return turn(envs, actions, steps)

    turn = reset_cost.turn
    monkeypatch.setattr(reset_cost, "turn", keep)
    reset_cost.main(reset_cost.Options(num_envs=4, rounds=1, episode=10, out=tmp_path / "cost.json", device="cpu"))
    states = [envs.batch.data.qpos.numpy() for envs in kept[:4]]  # fresh, in_place, replayed, fixed
    for same in states[1:3]:
        np.testing.assert_array_equal(states[0], same)
    assert (states[0] != states[3]).any()
    told = (tmp_path / "cost.json").read_text()
    assert set(json.loads(told)["ratio_median"]) == {"fresh / in_place", "fresh / replayed", "fresh / fixed"}
    turns = len(kept)
    reset_cost.main(reset_cost.Options(num_envs=4, rounds=1, episode=10, out=tmp_path / "cost.json", device="cpu"))
    assert (len(kept), (tmp_path / "cost.json").read_text()) == (turns, told), "a file with the answer is left alone"
    with pytest.raises(SystemExit, match="other options"):
        reset_cost.main(reset_cost.Options(num_envs=8, rounds=1, episode=10, out=tmp_path / "cost.json", device="cpu"))
