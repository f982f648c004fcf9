"""Training: stopping, going on, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("rsl_rl")

from benchmarks import curves
from sceniris_gym.errors import ArgumentError
from sceniris_gym.files import as_json
from sceniris_gym.levels.curriculum import LevelReplay
from sceniris_gym.progress import listening
from sceniris_gym.training import task_scenes, train
from sceniris_gym.training.settings import SETTINGS, Options, source_hash
from tests.training.scenes import reach_scene


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Iterator[train.Run]:
    """Return a run of two worlds with a checkpoint of its start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "make_env", partial(task_scenes.make_env, max_episode_steps=2))
        patch.setattr(train, "judges_of", lambda *_: {})
        patch.setattr(train, "compile_scene", lambda *_: reach_scene())
        small: dict[str, Any] = {"num_envs": 2, "device": "cpu", "changes": ("steps=4", "hidden=[8]", "epochs=1")}
        run = train.Run(Options("TabletopReach-v0", out=tmp_path_factory.mktemp("begun"), **small))
        run.log.write_text("")
        run._save()
        yield run


@pytest.mark.slow
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def test_a_training_that_is_killed_goes_on_from_its_last_checkpoint(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Whatever the log has of later is cut off; worlds begin their next episodes; the table has what came of it."""
    monkeypatch.setenv("SCENIRIS_GYM_CACHE", str(tmp_path / "cache"))  # two runs compile the same scenes
    monkeypatch.setattr(train, "make_env", partial(task_scenes.make_env, max_episode_steps=10))
    out = tmp_path / "fresh_0"
    common: dict[str, Any] = {
        "task": "TabletopReach-v0",
        "num_envs": 4,
        "layouts": 4,
        "out": out,
        "every": 1,
        "device": device,
    }
    options = Options(**common, million_steps=2e-4, evaluate_every=1000.0, save_every=0.0)
    killed = train.Run(options)

    def kill() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(killed, "_judge", kill)
    with pytest.raises(KeyboardInterrupt):
        killed.go()
    first = (out / "log.jsonl").read_text()
    assert len(first.splitlines()) == 3
    (out / "log.jsonl").write_text(first + '{"kind": "tra')
    saved = torch.load(out / "model.pt", weights_only=False)["infos"]

    again = train.Run(replace(options, resume=True, million_steps=3e-4))
    begun: list[torch.Tensor] = []
    iterate = again._train

    def watch(iterations: int) -> None:
        envs = again.env.unwrapped
        begun.append(torch.stack([envs.state.episode, envs.state.elapsed]).clone())
        iterate(iterations)

    monkeypatch.setattr(again, "_train", watch)
    again.go()
    assert begun[0].tolist() == [(saved["episode"] + 1).tolist(), saved["elapsed"].tolist()]
    assert (begun[1][0] > begun[0][0]).all()
    lines = (out / "log.jsonl").read_text()
    assert lines.startswith("".join(first.splitlines(keepends=True)[:2]))
    told = [json.loads(line, parse_constant=pytest.fail) for line in lines.splitlines()]
    assert [line["env_steps"] for line in told if line["kind"] == "train"] == [96, 192, 288, 384]
    judged = [line for line in told if line["kind"] == "eval"]
    assert len(judged) == 1
    assert {"valid", "unfiltered"} <= set(judged[0])
    assert judged[0]["valid"]["unfinished"] == 0
    table = curves.table(curves.read(tmp_path))
    assert "| TabletopReach-v0 | fresh | 1 | 0.0 M | 0.0% (0.0% to 49.0%) | 0.0% (0.0% to 49.0%) | - |" in table


def test_a_policy_that_sees_images_imitates_a_teacher_that_sees_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The teacher is trained once, by the critic's numbers; a run that is resumed has it in its checkpoint."""
    monkeypatch.setattr(train, "make_env", partial(task_scenes.make_env, max_episode_steps=4))
    monkeypatch.setattr(train, "judges_of", lambda *_: {})
    compiled = reach_scene()
    monkeypatch.setattr(train, "compile_scene", lambda *_: compiled)
    small = ("steps=2", "hidden=[8]", "epochs=1", "teacher=0.001")
    common: dict[str, Any] = {"num_envs": 2, "out": tmp_path, "every": 1, "device": "cpu", "changes": small}
    run = train.Run(Options("TabletopReachPixels-v0", **common, million_steps=4e-6))
    assert run.env.get_observations()["front"].shape == (2, 4, 64, 64)
    monkeypatch.setattr(run, "_judge", lambda: None)
    monkeypatch.setattr(train.settings, "evaluations", lambda _: [{}])
    before = {name: value.clone() for name, value in run.runner.alg.get_policy().state_dict().items()}
    run.go()
    taught = torch.load(tmp_path / "teacher.pt", weights_only=False)["actor_state_dict"]
    saved = torch.load(tmp_path / "model.pt", weights_only=False)
    assert all(torch.equal(value, saved["teacher_state_dict"][name]) for name, value in taught.items())
    assert taught["mlp.0.weight"].shape == (8, 73)
    changed = {
        name.split(".")[1]
        for name, value in saved["student_state_dict"].items()
        if "cnns" in name and not torch.equal(value, before[name])
    }
    assert changed == {"front", "wrist"}
    heard: list[str] = []
    with listening(lambda what, *_: heard.append(what)):
        again = train.Run(Options("TabletopReachPixels-v0", **common, million_steps=8e-6, resume=True))
        monkeypatch.setattr(again, "_judge", lambda: None)
        monkeypatch.setattr(again, "_teach", pytest.fail)
        again.go()
    assert {"first steps", "seconds of training"} <= set(heard)
    assert again.iterations == 2


def test_a_training_ends_within_an_iteration_of_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Of ten iterations a line, each of ten seconds, half a minute takes three; the line is of these."""
    monkeypatch.setattr(train, "make_env", partial(task_scenes.make_env, max_episode_steps=2))
    monkeypatch.setattr(train, "judges_of", lambda *_: {})
    monkeypatch.setattr(train, "compile_scene", lambda *_: reach_scene())
    small: dict[str, Any] = {"num_envs": 2, "device": "cpu", "changes": ("steps=4", "hidden=[8]", "epochs=1")}
    run = train.Run(Options("TabletopReach-v0", out=tmp_path, minutes=0.5, every=10, **small))
    monkeypatch.setattr(run, "_judge", lambda: None)
    monkeypatch.setattr(train.settings, "evaluations", lambda _: [{}])
    monkeypatch.setattr(run, "_clock", partial(next, count(0.0, 10.0)))
    run.go()
    (line,) = map(json.loads, run.log.read_text().splitlines())
    assert (run.iterations, line["seconds"], line["env_steps"], line["steps_per_second"]) == (3, 30.0, 24, 1)


def test_levels_go_on_with_a_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """All of the buffer, and the levels that were chosen for the next episodes."""
    monkeypatch.setattr(train, "make_env", partial(task_scenes.make_env, max_episode_steps=2))
    monkeypatch.setattr(train, "judges_of", lambda *_: {})
    compiled = reach_scene()
    monkeypatch.setattr(train, "compile_scene", lambda *_: compiled)
    common: dict[str, Any] = {"num_envs": 3, "out": tmp_path, "every": 1, "device": "cpu", "curriculum": "failure"}
    options = Options("TabletopReach-v0", **common, changes=("steps=4", "hidden=[8]", "epochs=1"), million_steps=48e-6)
    run = train.Run(options)
    monkeypatch.setattr(run, "_judge", lambda: None)
    monkeypatch.setattr(train.settings, "evaluations", lambda _: [{}])
    run.go()
    kept = torch.load(tmp_path / "model.pt", weights_only=True)["infos"]["levels"]
    again = train.Run(replace(options, resume=True))
    again._load()
    envs = again.env.unwrapped
    assert envs.randomizer.levels is not None
    state = envs.randomizer.levels.state()
    for name in ("seed", "value", "age", "cumulative", "level"):
        wanted = (kept["next_level"] if name == "level" else kept[name]).numpy()
        np.testing.assert_array_equal(state[name], wanted, err_msg=name)
    assert envs.state.seed.tolist() == kept["next_seed"].to(torch.int64).tolist()
    assert envs.randomizer.levels.size >= 6


@pytest.mark.parametrize("wrong", [{"seconds": "x"}, {"elapsed": 5}, {"log_size": "x"}, {"episode": torch.zeros(7)}])
def test_a_run_does_not_go_on_from_progress_that_no_run_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: dict[str, Any], begun: train.Run
):
    """A checkpoint that was edited is told by its name."""
    stored = torch.load(begun.checkpoint, weights_only=True)
    stored["infos"] |= wrong
    torch.save(stored, tmp_path / "model.pt")
    (tmp_path / "log.jsonl").write_bytes(begun.log.read_bytes())
    monkeypatch.setattr(begun, "checkpoint", tmp_path / "model.pt")
    monkeypatch.setattr(begun, "log", tmp_path / "log.jsonl")
    with pytest.raises(ArgumentError, match=r"model\.pt: should be a file of 'sceniris-gym train'"):
        begun._load()


def test_a_run_does_not_go_on_from_another_one(tmp_path: Path):
    """The first option that differs is named; how long it runs may be another."""
    options = Options("TabletopReach-v0", out=tmp_path, bank=16)
    settings, known = asdict(SETTINGS["TabletopReach-v0"]), {"hash": source_hash()}
    told = {"options": asdict(options), "settings": settings, "sources": known}
    (tmp_path / "config.json").write_text(as_json(told))
    (tmp_path / "model.pt").touch()
    with pytest.raises(ArgumentError, match=r"options\.bank = 16, not 256"):
        train.Run(replace(options, resume=True, minutes=9.0, bank=256))


def test_a_bank_has_layouts_and_is_not_uniform():
    """Refused before anything is compiled."""
    for bank, uniform in ((0, False), (-3, False), (4, True)):
        with pytest.raises(ArgumentError, match="should be 1 or more layouts"):
            train.Run(Options("TabletopReach-v0", bank=bank, uniform=uniform))


def test_a_run_does_not_go_on_from_one_of_other_sources(tmp_path: Path):
    """Results of two versions are not mixed."""
    options = Options("TabletopReach-v0", out=tmp_path / "third")
    settings = asdict(SETTINGS["TabletopReach-v0"])
    told = {"options": asdict(options), "settings": settings, "sources": {"hash": "b"}}
    options.out.mkdir()
    (options.out / "config.json").write_text(as_json(told))
    (options.out / "model.pt").touch()
    with pytest.raises(ArgumentError, match=r"sources\.hash = 'b', not"):
        train.Run(replace(options, resume=True))


def test_a_curriculum_also_chooses_from_a_bank(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Neither option is silently left out."""
    given: dict[str, Any] = {}
    monkeypatch.setattr(train, "compile_scene", lambda *_: reach_scene())
    monkeypatch.setattr(train, "judges_of", lambda *_: {})
    monkeypatch.setattr(
        train, "make_env", lambda *at, **words: given.update(words) or task_scenes.make_env(*at, **words)
    )
    options = Options("TabletopReach-v0", out=tmp_path, num_envs=2, device="cpu", curriculum="failure", bank=4)
    run = train.Run(options)
    assert given["layout_source"] is not None
    assert given["curriculum"] == LevelReplay("failure")
    assert run.env.unwrapped.randomizer.levels is not None
