"""The scripts behind the figures on training: sources of layouts, bad resets, stopping and going on."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tarfile
import time
from collections import Counter
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("rsl_rl")

from benchmarks import curves, honest_resets, physics_options, reset_cost
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ContactBudgetError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training import intervals, judging, layout_sources, sources, task_scenes, train
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.versions import since_4


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of TabletopReach-v0."""
    return compile_scene(SceneConfig.load("tabletop_reach", {"bank": 8}), "cpu")


def test_a_bank_holds_valid_layouts_and_is_replayed_in_turn(compiled: CompiledScene):
    """World with seed s gets row s + episode; two rows of one bank are two layouts."""
    rows = layout_sources.valid_rows(compiled, 3, seed=100)
    assert rows.qpos.shape == (3, compiled.mjm.nq)
    assert len(np.unique(rows.qpos, axis=0)) == 3
    generator = layout_sources.replayed(rows)(compiled, 2)
    generator.reseed([1, 2])
    for episode in range(4):
        generator.generate()
        expected = rows.qpos[[(1 + episode) % 3, (2 + episode) % 3]]
        np.testing.assert_array_equal(generator.layouts.qpos.numpy(), expected)


def test_a_bank_for_training_goes_on_by_the_number_of_worlds(compiled: CompiledScene):
    """Of three worlds one with seed s gets row s + 2 * episode; two rows of one bank are two layouts."""
    rows = layout_sources.valid_rows(compiled, 7, seed=100)
    assert rows.qpos.shape == (7, compiled.mjm.nq)
    assert len(np.unique(rows.qpos, axis=0)) == 7
    generator = layout_sources.bank(rows)(compiled, 3)
    generator.reseed([1, 2, 3])
    for episode in range(4):
        generator.generate()
        expected = rows.qpos[[(seed + 2 * episode) % 7 for seed in (1, 2, 3)]]
        np.testing.assert_array_equal(generator.layouts.qpos.numpy(), expected)


def test_the_entropy_bonus_falls_with_the_steps():
    """Evenly until its last weight, and not at all where a task has none."""
    cooled = replace(train.Settings(), entropy=0.004, last_entropy=0.001, cooling=30.0)
    assert [cooled.entropy_after(n) for n in (0, 10_000_000, 90_000_000)] == pytest.approx([0.004, 0.003, 0.001])
    assert replace(cooled, last_entropy=None).entropy_after(20_000_000) == 0.004


def test_replayed_episodes_are_those_that_would_be_made(compiled: CompiledScene):
    """Row i * number + e is episode e of seed i, to the bit."""
    rows = layout_sources.episodes(compiled, [5, 90], 3)
    generator = LayoutGenerator(compiled, 2, seed=[5, 90])
    for episode in range(3):
        generator.generate()
        np.testing.assert_array_equal(generator.layouts.qpos.numpy(), rows.qpos[[episode, 3 + episode]])


def test_placement_without_checks_takes_the_first_candidate(compiled: CompiledScene):
    """No candidate collides any more, and objects lie where the first ones were drawn; the scene stays as it was."""
    plain = compile_scene(
        SceneConfig.load(task_scenes.scene_of("TabletopReach-v0", reachable=False), {"bank": 8}), "cpu"
    )
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


def test_bad_resets_are_counted(compiled: CompiledScene):
    """None of the generator's, some of those without checks; contacts with the support are no fault."""
    options = honest_resets.Options(num_envs=48, nconmax=64, njmax=256)
    good, pairs = honest_resets.Judge(compiled, LayoutGenerator(compiled, 48), options).look(0)
    assert (good["layouts"], good["either"]) == (48, 0)
    assert not pairs
    drawn = LayoutGenerator(layout_sources.unchecked(compiled), 48)
    bad, pairs = honest_resets.Judge(compiled, drawn, options).look(0)
    assert 2 <= bad["in_contact"] <= bad["either"]
    assert not any("table" in pair for pair in pairs)
    assert honest_resets.supports(compiled)["can"] == "table"


def judge_with_room(compiled: CompiledScene, nconmax: int, njmax: int) -> honest_resets.Judge:
    """Return a judge of unchecked layouts in 48 worlds, with so much room."""
    options = honest_resets.Options(num_envs=48, nconmax=nconmax, njmax=njmax)
    return honest_resets.Judge(compiled, LayoutGenerator(layout_sources.unchecked(compiled), 48), options)


@since_4("mujoco_warp reads beyond its arrays where pairs do not fit")
def test_resets_are_not_judged_where_pairs_did_not_fit(compiled: CompiledScene):
    """Even if all contacts did."""
    pairs = judge_with_room(compiled, nconmax=1, njmax=256)
    with pytest.raises(ContactBudgetError, match="nconmax=1 is too small"):
        pairs.look(0)
    assert pairs.batch.data.nacon.numpy()[0] < 48 < pairs.batch.data.ncollision.numpy()[0], "the contacts alone fit"


def test_resets_are_not_judged_where_a_contact_was_lost(compiled: CompiledScene):
    """Neither where scratch for convex ones or rows do not fit, nor when it happens while they are watched."""
    with pytest.raises(ContactBudgetError, match="njmax=8 is too small"):
        judge_with_room(compiled, nconmax=64, njmax=8).look(0)
    convex = judge_with_room(compiled, nconmax=64, njmax=256)
    convex.batch.data.naccdmax = 1
    with pytest.raises(ContactBudgetError, match="nconmax"):
        convex.look(0)
    other = judge_with_room(compiled, nconmax=64, njmax=256)
    overflow = np.zeros(48, np.int32)
    overflow[5] = honest_resets.OverflowType.EPA_HORIZON
    other.batch.data.overflow.assign(overflow)
    with pytest.raises(RuntimeError, match="EPA_HORIZON"):
        other._touching()


def test_counts_are_kept_for_the_same_options_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A file with the answer is left alone, also with other room; other options are refused; half a line is redone."""
    seeds: list[int] = []

    def look(self: honest_resets.Judge, seed: int) -> tuple[Counter, Counter]:
        seeds.append(seed)
        return Counter(layouts=self.batch.nworld, in_contact=1), Counter()

    monkeypatch.setattr(honest_resets.Judge, "look", look)
    options = honest_resets.Options(
        layouts=8, num_envs=4, tasks=("TabletopReach-v0",), out=tmp_path / "honest.jsonl", device="cpu", njmax=64
    )
    honest_resets.main(options)
    told = options.out.read_text()
    lines = [json.loads(line) for line in told.splitlines()]
    assert [(line["placement"], line["layouts"], line["in_contact"]) for line in lines] == [
        ("fresh", 8, 2),
        ("uniform", 8, 2),
    ]
    honest_resets.main(replace(options, njmax=128))
    for other in ({"layouts": 64}, {"num_envs": 8}, {"seed": 3}):
        with pytest.raises(SystemExit, match="other options"):
            honest_resets.main(replace(options, **other))
    assert (len(seeds), options.out.read_text()) == (4, told)
    options.out.write_text(told[:-20])  # stopped while it wrote the last line
    honest_resets.main(options)
    assert (len(seeds), options.out.read_text()) == (6, told)


def test_doors_and_drawers_are_watched_too():
    """A drawer counts as fast as it slides, a door as its outer edge; the arm does not count, and a NaN is too fast."""
    scene: dict[str, Any] = {
        "floor": {"size": [3.0, 3.0]},
        "robot": {"asset": "panda", "base": [0.0, -1.0, 0.0]},
        "objects": {
            "cabinet": {
                "asset": "cabinet",
                "kind": "fixture",
                "on": "floor",
                "region": {"box": [[-0.8, 0.0], [-0.7, 0.1]]},
            },
            "cupboard": {
                "asset": "cupboard",
                "kind": "fixture",
                "on": "floor",
                "region": {"box": [[0.7, 0.0], [0.8, 0.1]]},
            },
        },
    }
    compiled = compile_scene(SceneConfig.load(scene, {"bank": 4}), "cpu")
    dofs = {compiled.mjm.joint(i).name: int(compiled.mjm.jnt_dofadr[i]) for i in range(compiled.mjm.njnt)}
    options = honest_resets.Options(num_envs=4, nconmax=64, njmax=256)
    judge = honest_resets.Judge(compiled, LayoutGenerator(compiled, 4), options)
    assert set(judge.levers) == {dofs[name] for name in ("cabinet/upper", "cabinet/lower", "cupboard/door")}
    geoms = [
        g for g in range(compiled.mjm.ngeom) if compiled.mjm.body(compiled.mjm.geom_bodyid[g]).name == "cupboard/door"
    ]
    width = max(2.0 * compiled.mjm.geom_aabb[g, 3:].max() for g in geoms)
    assert 0.5 * width < judge.levers[dofs["cupboard/door"]] < 1.5 * width
    qvel = np.zeros((4, compiled.mjm.nv))
    qvel[0, dofs["cabinet/lower"]] = -1.5
    qvel[1, dofs["cupboard/door"]] = 2.0
    qvel[2, dofs["panda/joint1"]] = 3.0
    qvel[3, dofs["cabinet/upper"]] = np.nan
    assert judge.speeds(qvel).tolist() == pytest.approx([1.5, 2.0 * judge.levers[dofs["cupboard/door"]], 0.0, np.inf])


def test_the_word_reachable_can_be_left_out():
    """The rest of the scene is the same."""
    scenes = [task_scenes.scene_of("TabletopReach-v0", reachable=reachable) for reachable in (True, False)]
    assert [bool(scene.objects["can"].reachable) for scene in scenes] == [True, False]
    assert scenes[0].objects["can"].region == scenes[1].objects["can"].region


@pytest.mark.slow
def test_a_training_that_is_killed_goes_on_from_its_last_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Whatever the log has of later is cut off; worlds begin their next episodes; the table has what came of it."""
    monkeypatch.setattr(train, "make_env", partial(task_scenes.make_env, max_episode_steps=10))
    out = tmp_path / "fresh_0"
    common: dict[str, Any] = {
        "task": "TabletopReach-v0",
        "num_envs": 4,
        "layouts": 4,
        "out": out,
        "every": 1,
        "device": "cpu",
    }
    options = train.Options(**common, million_steps=2e-4, evaluate_every=1000.0, save_every=0.0)
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


def test_a_run_does_not_go_on_from_another_one(tmp_path: Path):
    """The first option that differs is named; how long it runs may be another."""
    options = train.Options("TabletopReach-v0", out=tmp_path, bank=16)
    settings, known = asdict(train.SETTINGS["TabletopReach-v0"]), {"hash": sources.source_hash()}
    told = {"options": asdict(options), "settings": settings, "sources": known}
    (tmp_path / "config.json").write_text(train.as_json(told))
    (tmp_path / "model.pt").touch()
    with pytest.raises(SystemExit, match=r"options\.bank = 16, not 256"):
        train.Run(replace(options, resume=True, minutes=9.0, bank=256))


def test_a_task_without_settings_is_not_trained():
    """The error names those that have some."""
    with pytest.raises(SystemExit, match=r"'KitchenReset-v0' with, only for TabletopReach-v0, TabletopReachEasy-v0"):
        train.Run(train.Options("KitchenReset-v0"))


def test_what_is_written_is_strict_json():
    """Numbers that JSON does not have are null."""
    text = train.as_json({"a": [float("nan"), 1.5], "b": {"c": float("inf"), "d": (1, Path("x/y"))}, "e": None})
    assert json.loads(text, parse_constant=pytest.fail) == {
        "a": [None, 1.5],
        "b": {"c": None, "d": [1, "x/y"]},
        "e": None,
    }


def test_placement_without_checks_rejects_nothing():
    """Neither for collisions nor for reach."""
    plain = compile_scene(
        SceneConfig.load(task_scenes.scene_of("TabletopReach-v0", reachable=False), {"bank": 8}), "cpu"
    )
    generator = layout_sources.uniform()(plain, 64)
    generator.generate()
    assert not any(any(causes.values()) for causes in generator.rejection_counts().values())


def test_density_is_about_the_target_that_is_chosen():
    """How many others there are and how near the nearest is, against the qpos of each; itself does not count."""
    compiled = compile_scene(SceneConfig.load("tabletop_lift", {"bank": 8}), "cpu")
    envs = task_scenes.make_env("TabletopLift-v0", 6, compiled)
    envs.reset(seed=3)
    task: Any = envs.task
    chosen = task.chosen
    assert chosen.sum(dim=0).count_nonzero() > 1
    things, nearest = judging.density("TabletopLift-v0", envs.state, chosen)
    qpos, names = envs.batch.data.qpos.numpy(), ("block", "can", "lemon", "tin", "orange")
    at = [compiled.mjm.joint(f"{name}/free").qposadr[0] for name in names]
    for world in range(6):
        target, *_ = np.flatnonzero(chosen[world].numpy())
        flat = np.array([qpos[world, a : a + 2] for a in at])
        away = np.delete(np.linalg.norm(flat - flat[target], axis=1), target)
        assert int(things[world]) == 4
        assert float(nearest[world]) == pytest.approx(away.min(), abs=1e-5)


NEAREST = [50] * 8 + [60] * 8 + [70] * 8 + [80] * 6 + [None] * 10


def write_run(folder: Path, name: str, success: float | None, sources: str = "a", **options: Any) -> None:
    """Write what a training run leaves: 40 layouts judged, half of them with 5 things, half with 9."""
    run = folder / name
    run.mkdir()
    told = {"options": {"task": "ClutterExtract-v0", "seed": 0, **options}, "sources": {"hash": sources}}
    (run / "config.json").write_text(json.dumps(told))
    line: dict[str, Any] = {"kind": "train", "seconds": 9.0, "env_steps": 3_000_000}
    if success is not None:
        hits = round(40 * success)
        told_of = {"success": success, "layouts": 40, "interval": intervals.wilson(hits, 40)}
        judged = dict.fromkeys(("valid", "unfiltered"), told_of)
        each = {"success": [1] * hits + [0] * (40 - hits), "things": [5, 9] * 20, "nearest": NEAREST}
        (run / "judged.json").write_text(json.dumps({"valid": {"each": each}}))
        line |= {"kind": "eval", **judged}
    (run / "log.jsonl").write_text(json.dumps(line) + "\n")


def test_tables_and_picture_are_made_of_the_seeds_that_are_there(tmp_path: Path):
    """Unjudged runs are left out, a time to success says of how many seeds, and the order is that of the sources."""
    write_run(tmp_path, "fresh_0", 0.95, million_steps=3.0)
    write_run(tmp_path, "fresh_1", 0.5, million_steps=3.0, seed=1)
    write_run(tmp_path, "bank_0", 0.25, million_steps=3.0, bank=4096)
    write_run(tmp_path, "bank_1", None, million_steps=3.0, bank=4096, seed=1)
    write_run(tmp_path, "uniform_0", 0.75, million_steps=3.0, uniform=True)
    write_run(tmp_path, "long", 0.85, million_steps=None)
    runs = curves.read(tmp_path)
    _, _, *rows = curves.table([run for run in runs if run.million_steps]).splitlines()
    both = "95.0% (83.5% to 98.6%); 50.0% (35.2% to 64.8%)"
    assert rows == [
        f"| ClutterExtract-v0 | {kind} | 3.0 M | {shares} | {shares} | - |"
        for kind, shares in (
            ("bank of 4,096 | 1", "25.0% (14.2% to 40.2%)"),
            ("fresh | 2", both),
            ("uniform | 1", "75.0% (59.8% to 85.8%)"),
        )
    ]
    write_run(tmp_path, "longer", 0.5, seed=1)
    *_, last = curves.table([run for run in curves.read(tmp_path) if not run.million_steps]).splitlines()
    assert last.endswith("| 9 s, 1 of 2 seeds |")
    assert [run.name for run in runs if not run.million_steps] == ["long"]
    dense = curves.by_density([run for run in runs if run.kind == "uniform"])
    assert "| uniform | 3.0 M | 5 other things | 15 of 20 | 75.0% | 53.1% to 88.8% |" in dense
    for part in ("50 to 60 mm | 8 of 8", "60 to 70 mm | 8 of 8", "70 to 81 mm | 14 of 14"):
        assert f"| uniform | 3.0 M | nearest at {part} | 100.0% |" in dense
    curves.draw(runs, tmp_path / "all.png")
    curves.draw([], tmp_path / "none.png")
    assert (tmp_path / "all.png").stat().st_size > (tmp_path / "none.png").stat().st_size > 0


def test_comparisons_of_other_lengths_have_rows_of_their_own(tmp_path: Path):
    """Also from another folder; a run that has not come to its end counts by its time."""
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first, second):
        folder.mkdir()
    write_run(first, "fresh_0", 0.5, million_steps=2.5)
    write_run(second, "fresh_0", 0.75, million_steps=3.0)
    write_run(second, "fresh_1", 1.0, million_steps=4.0)
    runs = curves.read(second, first)
    assert [run.million_steps for run in runs] == [None, 2.5, 3.0]
    _, _, *rows = curves.table(runs[1:]).splitlines()
    assert [row.split(" | ")[4][:5] for row in rows] == ["50.0%", "75.0%"]


def test_no_run_counts_twice(tmp_path: Path):
    """Neither by a folder that is given again, nor by a copy."""
    write_run(tmp_path, "fresh_0", 0.5, million_steps=3.0)
    with pytest.raises(SystemExit, match="fresh_0 and fresh_0 are both ClutterExtract-v0, fresh, seed 0"):
        curves.read(tmp_path, tmp_path)


def test_kinds_are_in_order_whatever_the_size_of_a_bank(tmp_path: Path):
    """Small banks first, then fresh layouts, uniform placement last; a folder that is not there is told of."""
    for name, bank, uniform in (("a", None, True), ("b", None, False), ("c", 4096, False), ("d", 8, False)):
        write_run(tmp_path, name, 0.5, million_steps=3.0, bank=bank, uniform=uniform)
    assert [run.kind for run in curves.read(tmp_path)] == ["bank of 8", "bank of 4,096", "fresh", "uniform"]
    with pytest.raises(SystemExit, match="none: there is no such folder"):
        curves.read(tmp_path, tmp_path / "none")


def test_comparisons_of_other_numbers_of_worlds_are_not_mixed(tmp_path: Path):
    """What trained for some time, or for other steps, may differ."""
    write_run(tmp_path, "first", 0.5, million_steps=3.0, num_envs=4096)
    write_run(tmp_path, "second", 0.5, million_steps=None, num_envs=64)
    write_run(tmp_path, "third", 0.5, million_steps=2.0, num_envs=64)
    assert len(curves.read(tmp_path)) == 3
    write_run(tmp_path, "fourth", 0.5, million_steps=3.0, num_envs=64)
    with pytest.raises(SystemExit, match="first and fourth are comparisons of ClutterExtract-v0 with num_envs"):
        curves.read(tmp_path)


def test_a_bank_has_layouts_and_is_not_uniform():
    """Refused before anything is compiled."""
    for bank, uniform in ((0, False), (-3, False), (4, True)):
        with pytest.raises(SystemExit, match="--bank takes 1 or more layouts"):
            train.Run(train.Options("TabletopReach-v0", bank=bank, uniform=uniform))


def test_a_bank_larger_than_the_worlds_is_served_whole(compiled: CompiledScene):
    """Four worlds go through nine rows in three episodes."""
    rows = layout_sources.valid_rows(compiled, 9, seed=100)
    source, seen = layout_sources.bank(rows)(compiled, 4), set()
    source.reseed([5, 6, 7, 8])
    for _ in range(3):
        source.generate()
        seen |= {row.tobytes() for row in source.layouts.qpos.numpy()}
    assert len(seen) == 9


SCRIPT = Path(curves.__file__).with_name("evidence.sh")

MAKES_FOLDER = "while [ $1 != --out ]; do shift; done; mkdir -p $2; exit"
"""A stand-in for a training: it makes the folder of the run, and is done."""


def with_trainer(folder: Path, line: str) -> dict[str, str]:
    """Return an environment in which a line of bash stands for every training, and nothing is kept from before."""
    fake = folder / "python"
    fake.write_text(
        f'#!/bin/bash\ncase $2 in sceniris_gym.training.train) {line} ;; esac\nexec {sys.executable} "$@"\n'
    )
    fake.chmod(0o755)
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path, "KEPT": str(folder / "no")}


def evidence(folder: Path, part: str, env: dict[str, str]) -> subprocess.CompletedProcess:
    """Run evidence.sh, and return how it ended."""
    words = ["bash", str(SCRIPT), str(folder), part]
    return subprocess.run(words, cwd=SCRIPT.parents[1], env=env, capture_output=True, text=True, check=False)


def test_runs_stop_with_their_script(tmp_path: Path):
    """The trainers too; a folder in which some are still going is not used twice."""
    env = with_trainer(tmp_path, f"echo $$ >> {tmp_path}/pids; exec sleep 60") | {"PER_GPU": "2"}
    words = ["bash", str(SCRIPT), str(tmp_path / "runs"), "curves"]
    first = subprocess.Popen(words, cwd=SCRIPT.parents[1], env=env, stderr=subprocess.DEVNULL)
    pids = tmp_path / "pids"
    until = time.monotonic() + 60.0
    while (not pids.exists() or len(pids.read_text().split()) < 2) and time.monotonic() < until:
        time.sleep(0.05)
    second = evidence(tmp_path / "runs", "curves", env)
    assert (second.returncode, "is in use" in second.stderr) == (1, True)
    first.terminate()
    assert first.wait(20.0) == 143
    started = [Path("/proc", pid) for pid in pids.read_text().split()]
    assert len(started) == 2
    until = time.monotonic() + 20.0
    while any(process.exists() for process in started) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(process.exists() for process in started)


def test_a_run_that_fails_is_told_of(tmp_path: Path):
    """Each runs on a GPU out of those that the environment allows; the script goes on, and ends with 1."""
    fails = 'case "$*" in *"--seed 1"*) exit 3 ;; esac'
    line = f"echo $CUDA_VISIBLE_DEVICES >> {tmp_path}/cards; {fails}; {MAKES_FOLDER}"
    env = with_trainer(tmp_path, line) | {"SEEDS": "0 1", "CUDA_VISIBLE_DEVICES": "3,5"}
    runs = tmp_path / "runs"
    wrong = evidence(runs, "curve", env)
    assert (wrong.returncode, "There is no part 'curve'. Give figures" in wrong.stderr) == (2, True)
    ended = evidence(runs, "curves", env)
    assert ended.returncode == 1
    told = [line for line in ended.stderr.splitlines() if line.startswith("failed: clutterextract_fresh")]
    assert told == ["failed: clutterextract_fresh_1, see its .txt"]
    assert set((tmp_path / "cards").read_text().split()) == {"3", "5"}
    assert evidence(runs, "curves", env | {"SEEDS": "0"}).returncode == 0


def test_the_longer_comparison_is_of_one_task(tmp_path: Path):
    """It is not made in a folder of the shorter one."""
    env = with_trainer(tmp_path, f'echo "$@" >> {tmp_path}/calls; {MAKES_FOLDER}')
    runs = tmp_path / "runs"
    wrong = evidence(runs, "curves", env | {"ASKED": "all"})
    assert (wrong.returncode, "ASKED is 'all'. Give half or whole" in wrong.stderr) == (2, True)
    assert evidence(runs, "curves", env | {"ASKED": "whole"}).returncode == 0
    kinds = {f"clutterextract_{kind}_{seed}" for kind in ("16", "256", "fresh") for seed in range(3)}
    assert {path.name for path in runs.iterdir() if path.is_dir()} == kinds
    calls = (tmp_path / "calls").read_text().splitlines()
    assert all("ClutterExtract-v0" in call and "--million-steps 24.9" in call for call in calls)
    other = evidence(runs, "curves", env)
    assert (other.returncode, "has results of other sources" in other.stderr) == (1, True)


def test_runs_that_are_done_go_on_elsewhere(tmp_path: Path):
    """A new folder begins with them, without their networks. Neither other sources nor fewer runs replace them."""
    kept = tmp_path / "kept.tar.xz"
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"

    def keep(folder: Path, status: int = 0) -> subprocess.CompletedProcess:
        ended = evidence(folder, "keep", os.environ | {"KEPT": str(kept), "PATH": path})
        assert ended.returncode == status
        return ended

    first = tmp_path / "first"
    first.mkdir()
    for seed, name in enumerate(("fresh_0", "fresh_1")):
        write_run(first, name, 0.5, million_steps=3.0, seed=seed)
        (first / name / "model.pt").write_bytes(bytes(100))
    (first / "fresh_0" / "done").touch()
    keep(first)
    second = keep(tmp_path / "second")
    assert "| ClutterExtract-v0 | fresh | 1 | 3.0 M | 50.0% (35.2% to 64.8%) |" in second.stdout
    files = {path.name for path in (tmp_path / "second" / "fresh_0").iterdir()}
    assert files == {"config.json", "log.jsonl", "judged.json", "done"}
    assert not (tmp_path / "second" / "fresh_1").exists()
    before = kept.read_bytes()
    (tmp_path / "second" / "fresh_0" / "done").unlink()
    assert f"{kept} keeps fresh_0, which {tmp_path / 'second'} does not have" in keep(tmp_path / "second", 1).stderr
    assert kept.read_bytes() == before
    with tarfile.open(kept, "w:xz") as other:
        told = tarfile.TarInfo("sources")
        told.size = 6
        other.addfile(told, io.BytesIO(b"other\n"))
    before = kept.read_bytes()
    third = keep(tmp_path / "third", 1)
    assert "runs of other sources: none is taken over" in third.stderr
    assert f"{kept} keeps runs of other sources. Name another file in KEPT" in third.stderr
    assert not (tmp_path / "third" / "fresh_0").exists()
    assert kept.read_bytes() == before


def test_runs_of_different_sources_are_not_mixed(tmp_path: Path):
    """Neither in a table, nor by going on from a run of other sources."""
    write_run(tmp_path, "first", 0.5)
    write_run(tmp_path, "second", 0.5, sources="b")
    with pytest.raises(SystemExit, match="different sources: first, second"):
        curves.read(tmp_path)
    options = train.Options("TabletopReach-v0", out=tmp_path / "third")
    settings = asdict(train.SETTINGS["TabletopReach-v0"])
    told = {"options": asdict(options), "settings": settings, "sources": {"hash": "b"}}
    options.out.mkdir()
    (options.out / "config.json").write_text(train.as_json(told))
    (options.out / "model.pt").touch()
    with pytest.raises(SystemExit, match=r"sources\.hash = 'b', not"):
        train.Run(replace(options, resume=True))


def test_the_hash_of_the_sources_depends_on_what_results_depend_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On a line of a task, and not on a line of the docs; links into the package count once."""
    for name in ("envs/task.py", "docs/page.md", "sceniris_gym/cli.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1")
    monkeypatch.setattr(sources, "ROOT", tmp_path)
    first = sources.source_hash()
    (tmp_path / "docs/page.md").write_text("2")
    (tmp_path / "sceniris_gym/envs").symlink_to(tmp_path / "envs")
    assert sources.source_hash() == first
    (tmp_path / "envs/task.py").write_text("2")
    assert sources.source_hash() != first


def test_intervals_are_those_of_wilson():
    """The values of Brown, Cai and DasGupta's definition, worked out by hand for 8 of 10; and the ends."""
    assert intervals.wilson(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert intervals.wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert intervals.wilson(0, 0) == (0.0, 1.0)


def test_settings_to_try_are_named():
    """A setting that there is gets the value; others are refused."""
    changed = train.settings_of("TabletopReach-v0", ("gamma=0.5", "hidden=(8, 8)"))
    assert (changed.gamma, changed.hidden) == (0.5, (8, 8))
    for wrong in ("gama=0.5", "gamma"):
        with pytest.raises(SystemExit, match="name=value with a name out of hidden, gamma"):
            train.settings_of("TabletopReach-v0", (wrong,))


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


@pytest.mark.slow
def test_options_of_the_physics_are_compared_one_by_one(capsys: pytest.CaptureFixture):
    """A line for each, that of what cannot be measured too, and one whose name is wrong is refused."""
    options = physics_options.Options(
        num_envs=(2,), only=("whole", "iterations 5", "contacts / 2"), rounds=2, steps=2, device="cpu"
    )
    physics_options.main(options)
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith('{"variant"')]
    lines = {line["variant"]: line for line in map(json.loads, told)}
    assert lines["whole"]["skipped"] == "torch is captured on a GPU alone"
    for name in ("iterations 5", "contacts / 2"):
        assert set(lines[name]["ratio"]) == {"median", "min", "max"}
    with pytest.raises(SystemExit, match=r"unknown variants contact\. Valid: as it is, whole"):
        physics_options.main(replace(options, only=("contact",)))


def test_a_variant_differs_in_what_it_says_alone(compiled: CompiledScene):
    """Options and room of its own; the scene's model keeps its own ones."""
    base = task_scenes.make_env("TabletopReach-v0", 2, compiled)
    before = compiled.mjm.opt.disableflags
    changes = {
        "iterations 5": lambda envs: envs.batch.model.opt.iterations == 5,
        "rows / 2": lambda envs: envs.batch.data.njmax == base.batch.data.njmax // 2,
        "contacts x 2": lambda envs: envs.batch.data.naconmax == 2 * base.batch.data.naconmax,
        "without contacts": lambda envs: envs.batch.model.opt.disableflags != base.batch.model.opt.disableflags,
    }
    for name, differs in changes.items():
        with physics_options.VARIANTS[name].environment("TabletopReach-v0", base) as envs:
            assert differs(envs)
    assert compiled.mjm.opt.disableflags == before


def test_what_does_not_fit_is_not_measured(compiled: CompiledScene, monkeypatch: pytest.MonkeyPatch):
    """Contacts that are dropped take no time, so such a figure would mislead."""
    base = task_scenes.make_env("TabletopReach-v0", 2, compiled)
    monkeypatch.setitem(physics_options.VARIANTS, "contacts / 10", physics_options.Variant(contacts=0.1))
    found = physics_options.measure("contacts / 10", base, physics_options.Options(rounds=1, steps=1))
    assert "nconmax=4 is too small" in found["skipped"]
    assert "ms" not in found
