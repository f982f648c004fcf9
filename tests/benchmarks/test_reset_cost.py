"""The cost of fresh layouts, measured with several environments of each source that take turns."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks import reset_cost
from sceniris_gym.vector.vector_env import SceneVectorEnv


class Instance(SimpleNamespace):
    """An environment without steps, for a `turn` that is replaced."""


def test_the_standard_error_is_the_deviation_of_repeated_measurements():
    """Of 4,000 measurements with 8 instances of each source, and a rate of the machine that drifts by a tenth."""
    rng = np.random.default_rng(0)
    rates, others = (mean * (1.0 + 0.02 * rng.standard_normal((4000, 8))) for mean in (990.0, 1000.0))
    drift = 1.0 + 0.1 * rng.standard_normal((4000, 8))
    found = np.array([reset_cost.ratio(*pair) for pair in zip(rates * drift, others * drift, strict=True)])
    assert found[:, 0].mean() == pytest.approx(0.99, abs=1e-3)
    assert np.sqrt((found[:, 1] ** 2).mean()) == pytest.approx(found[:, 0].std(), rel=0.05)


def test_ratios_and_spreads_are_those_of_handmade_rates():
    """Instances that differ by 2%, and a source that is 1% slower in every round."""
    rates = np.array([102.0, 98.0])
    assert reset_cost.ratio(rates, np.array([100.0, 100.0])) == pytest.approx((1.0, 0.02))
    assert reset_cost.ratio(0.99 * rates, rates) == pytest.approx((0.99, 0.0))
    assert reset_cost.spread(rates) == pytest.approx(0.02 * np.sqrt(2.0))


def test_instances_are_made_and_stepped_in_alternating_order(monkeypatch: pytest.MonkeyPatch):
    """The first turn is an episode that does not count, and the rates are those of the other turns."""
    order: list[str] = []

    def make(name: str) -> Instance:
        order.append(f"make {name}")
        return Instance(name=name, action_space=SimpleNamespace(shape=(3, 2)), device="cpu")

    def turn(envs: Any, actions: Any) -> float:
        order.append(f"{envs.name} {len(actions)}")
        return {"a": 0.5, "b": 0.25}[envs.name] * (1.0 if len(actions) == 5 else 100.0)

    monkeypatch.setattr(reset_cost, "makers", lambda *_: {name: partial(make, name) for name in "ab"})
    monkeypatch.setattr(reset_cost, "compile_scene", lambda *_: None)
    monkeypatch.setattr(reset_cost, "turn", turn)
    found = reset_cost.measure(reset_cost.Options(num_envs=3, instances=2, turns=2, steps=5, episode=7))
    assert {name: rates.tolist() for name, rates in found.items()} == {"a": [30.0, 30.0], "b": [60.0, 60.0]}
    assert order[:8] == ["make a", "make b", "a 7", "b 7", "a 5", "b 5", "b 5", "a 5"]
    assert order[8:] == ["make b", "make a", "b 7", "a 7", "b 5", "a 5", "a 5", "b 5"]


def test_an_instance_that_is_still_in_use_is_told():
    """Its memory would add up over the rounds."""
    instances: Any = {"fresh": Instance(), "replayed": Instance()}
    kept = instances["replayed"]
    with pytest.raises(RuntimeError, match="Instances of replayed should be free after their round"):
        reset_cost.delete(instances)
    assert isinstance(kept, Instance)


def test_one_instance_is_refused(tmp_path: Path):
    """It has no standard error."""
    with pytest.raises(SystemExit, match="--instances should be at least 2, for a standard error, got 1"):
        reset_cost.main(reset_cost.Options(instances=1, out=tmp_path / "cost.json"))


@pytest.mark.slow
def test_the_cost_of_resets_is_measured_on_equal_terms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Fresh and replayed instances go through the same states, and are freed after their round."""
    states: list[np.ndarray] = []

    def keep(envs: SceneVectorEnv, actions: Any) -> float:
        states.append(envs.batch.data.qpos.numpy().copy())
        return turn(envs, actions)

    turn = reset_cost.turn
    monkeypatch.setattr(reset_cost, "turn", keep)
    sizes: dict[str, Any] = {"num_envs": 4, "instances": 2, "turns": 1, "steps": 5, "episode": 5}
    sources: Any = ("fresh", "in_place", "replayed", "fixed")
    options = reset_cost.Options(**sizes, sources=sources, out=tmp_path / "cost.json", device="cpu")
    reset_cost.main(options)
    forth, back = states[4:8], states[12:16]  # of the turn that counts
    for fresh, *same, fixed in (forth, back[::-1]):
        for other in same:
            np.testing.assert_array_equal(fresh, other)
        assert (fresh != fixed).any()
    told = json.loads((tmp_path / "cost.json").read_text())
    compared = {"fresh / in_place", "fresh / replayed", "fresh / fixed"}
    assert set(told["ratio"]) == set(told["standard_error"]) == compared
    assert set(told["spread"]) == set(sources)
    reset_cost.main(options)
    assert len(states) == 16, "a file with the answer is left alone"
    with pytest.raises(SystemExit, match="other options"):
        reset_cost.main(reset_cost.Options(**(sizes | {"num_envs": 8}), out=tmp_path / "cost.json", device="cpu"))
