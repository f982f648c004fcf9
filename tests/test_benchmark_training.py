"""The scripts behind the figures on training: sources of layouts, bad resets, stopping and going on."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rsl_rl")

from benchmarks import curves, honest_resets, layout_sources, reset_cost, train_rsl_rl
from sceniris_gym.layout.build import build_world
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.scene.world import World
from sceniris_gym.vector.vector_env import SceneVectorEnv


@pytest.fixture(scope="module")
def world() -> World:
    """Return the World of TabletopReach-v0."""
    return build_world("tabletop_reach", "cpu", bank_size=8)


def test_a_bank_holds_valid_layouts_and_is_replayed_in_turn(world: World):
    """World with seed s gets row s + episode; two rows of one bank are two layouts."""
    rows = layout_sources.valid_rows(world, 3, seed=100)
    assert rows.qpos.shape == (3, world.mjm.nq)
    assert len(np.unique(rows.qpos, axis=0)) == 3
    generator = layout_sources.replayed(rows)(world, 2)
    generator.reseed([1, 2])
    for episode in range(4):
        generator.generate()
        expected = rows.qpos[[(1 + episode) % 3, (2 + episode) % 3]]
        np.testing.assert_array_equal(generator.layouts.qpos.numpy(), expected)


def test_replayed_episodes_are_those_that_would_be_made(world: World):
    """Row i * number + e is episode e of seed i, to the bit."""
    rows = layout_sources.episodes(world, [5, 90], 3)
    generator = LayoutGenerator(world, 2, seed=[5, 90])
    for episode in range(3):
        generator.generate()
        np.testing.assert_array_equal(generator.layouts.qpos.numpy(), rows.qpos[[episode, 3 + episode]])


def test_placement_without_checks_takes_the_first_candidate(world: World):
    """No candidate collides any more, and objects lie where the first ones were drawn; the World stays as it was."""
    plain = build_world(train_rsl_rl.scene_of("TabletopReach-v0", reachable=False), "cpu", bank_size=8)
    generator = layout_sources.uniform()(plain, 64)
    generator.reseed(np.arange(64))
    generator.generate()
    checked = LayoutGenerator(plain, 64, seed=0)
    checked.generate()
    assert not any(causes["collision"] for causes in generator.rejection_counts().values())
    assert any(causes["collision"] for causes in checked.rejection_counts().values())
    same = (generator.layouts.qpos.numpy() == checked.layouts.qpos.numpy()).all(axis=1)
    first = checked.layouts.attempts.numpy() == generator.layouts.attempts.numpy()
    np.testing.assert_array_equal(same, first)
    assert first.any()
    assert not first.all()


def test_bad_resets_are_counted(world: World):
    """None of the generator's, some of those without checks; contacts with the support are no fault."""
    options = honest_resets.Options(num_envs=48, nconmax=64, njmax=256)
    good, pairs = honest_resets.Judge(world, LayoutGenerator(world, 48), options).look(0)
    assert (good["layouts"], good["either"]) == (48, 0)
    assert not pairs
    drawn = LayoutGenerator(layout_sources.unchecked(world), 48)
    bad, pairs = honest_resets.Judge(world, drawn, options).look(0)
    assert 2 <= bad["in_contact"] <= bad["either"]
    assert not any("table" in pair for pair in pairs)
    assert honest_resets.supports(world)["can"] == "table"


def test_the_word_reachable_can_be_left_out():
    """The rest of the scene is the same."""
    scenes = [train_rsl_rl.scene_of("TabletopReach-v0", reachable=reachable) for reachable in (True, False)]
    assert [bool(scene.objects["can"].reachable) for scene in scenes] == [True, False]
    assert scenes[0].objects["can"].region == scenes[1].objects["can"].region


@pytest.mark.slow
def test_a_training_stops_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The second run adds to the log of the first one and goes on counting; the table has both kinds of layouts."""
    monkeypatch.setattr(train_rsl_rl, "make_env", partial(train_rsl_rl.make_env, max_episode_steps=10))
    arguments: dict[str, Any] = {"task": "TabletopReach-v0", "num_envs": 4, "out": tmp_path / "fresh_0", "every": 1}
    train_rsl_rl.Run(train_rsl_rl.Options(**arguments, million_steps=1e-4, device="cpu")).go()
    first = (tmp_path / "fresh_0" / "log.jsonl").read_text()
    train_rsl_rl.Run(train_rsl_rl.Options(**arguments, million_steps=2e-4, device="cpu", resume=True)).go()
    lines = (tmp_path / "fresh_0" / "log.jsonl").read_text()
    assert lines.startswith(first)
    told = [json.loads(line) for line in lines.splitlines()]
    assert [line["env_steps"] for line in told if line["kind"] == "train"] == [96, 192, 288]
    judged = [line for line in told if line["kind"] == "eval"]
    assert len(judged) == 2
    assert {"valid", "unfiltered"} <= set(judged[0])
    assert judged[0]["valid"]["unfinished"] == 0
    uniform = train_rsl_rl.Run(train_rsl_rl.Options(**arguments, uniform=True, device="cpu"))
    assert not any(any(causes.values()) for causes in uniform.env.unwrapped.randomizer.rejection_counts().values())
    table = curves.table(curves.read(tmp_path))
    assert "| fresh | 1 | 0 M | 0.0% | 0.0% | not all |" in table


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
    fresh, replayed, fixed = kept[:3]
    states = [envs.batch.data.qpos.numpy() for envs in (fresh, replayed, fixed)]
    np.testing.assert_array_equal(states[0], states[1])
    assert (states[0] != states[2]).any()
    answer = json.loads((tmp_path / "cost.json").read_text())
    assert set(answer["ratio_median"]) == {"fresh / replayed", "fresh / fixed"}
