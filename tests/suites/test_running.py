"""Runs of suites: equal to a serial script, for any number of worlds, and resumed without a case twice."""

from __future__ import annotations

import fcntl
import json
from contextlib import contextmanager
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch

from sceniris_gym import LevelReplay, SceneVectorEnv, cli, compile_scene
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, SceneMismatchError, UnknownNameError
from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.layout.tables import make_table
from sceniris_gym.suites import running
from sceniris_gym.suites.making import make
from sceniris_gym.suites.running import failures, played, read_rows, run
from sceniris_gym.suites.suite import Suite
from sceniris_gym.vector.libero_task import LiberoGoalTask
from tests.importers.libero.problems import STACK, write
from tests.suites.conftest import STEPS, WIDE, Timed, act
from tests.training.scenes import write_task

ACT = "tests.suites.conftest:act"


def serial(path: Path) -> list[tuple]:
    """Return success, success ever, length and return of each case, one world at a time."""
    head, *cases = map(json.loads, path.read_text().splitlines())
    words = {"scene": WIDE, "overrides": read_changes(head["changes"]), "device": "cpu", "max_episode_steps": STEPS}
    envs = SceneVectorEnv(Timed, 1, **words, split="eval", params=head["params"], autoreset_mode="Disabled")
    found = []
    for case in cases:
        observation, _ = envs.reset(options={"layouts": [case["id"]]})
        success, ever, total, done, length = False, False, 0.0, False, 0
        while not done:
            observation, reward, ended, cut, info = envs.step(act(observation))
            success, done = bool(info["success"][0]), bool(ended[0] | cut[0])
            ever, total, length = ever or success, total + float(reward[0]), length + 1
        found.append((success, ever, length, pytest.approx(total, rel=1e-9)))
    return found


def test_outcomes_are_those_of_a_serial_script(suite: Path, tmp_path: Path):
    """Case by case, also of edits, with finished worlds that wait for the others."""
    rows = run(suite, ACT, tmp_path / "rows.jsonl", num_envs=7, device="cpu")
    found = [(row["success"], row["success_once"], row["length"], row["total_reward"]) for row in rows]
    assert found == serial(suite)
    assert {row["length"] for row in rows} == {4, 6}
    assert {row["success"] for row in rows} == {True, False}
    assert all(sum(row["terms"].values()) == pytest.approx(row["total_reward"], rel=1e-5) for row in rows)
    assert {row["axis"] for row in rows} >= {"nominal", "robot", "clutter", "joint", "variant", "mass", "shift", "turn"}
    assert not any(row["fallback"] or row["broken"] for row in rows)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def test_numbers_of_worlds_give_the_same_layouts_and_outcomes(suite: Path, device: str):
    """Bit for bit. On a GPU, only the layouts."""

    def ran(num_envs: int) -> tuple[dict[int, bytes], dict]:
        states, results = {}, {}

        @contextmanager
        def film(cases, envs):
            def add(_):
                for i, case in enumerate(cases):
                    states.setdefault(case.case, envs.batch.data.qpos.numpy()[i].tobytes())

            yield add

        read = Suite.read(suite)
        for cases, found in played(read, read.cases, ACT, num_envs, device, film=film):
            results |= {case.case: result for case, result in zip(cases, found, strict=True)}
        return states, results

    (states, results), (other, more) = ran(3), ran(16)
    assert states == other
    assert results == more or device != "cpu"


def test_a_killed_run_is_resumed_with_each_case_once(suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Whatever part of the file it left. The cases that have rows do not run again."""
    out = tmp_path / "rows.jsonl"
    whole = run(suite, ACT, out, num_envs=5, device="cpu")
    text, results = out.read_bytes(), {row["case"]: row for row in whole}
    played_again: list[int] = []

    def quick(_, cases, *args, **words):
        played_again.extend(case.case for case in cases)
        fields = running.EpisodeResult.__dataclass_fields__
        for case in cases:
            yield [case], [running.EpisodeResult(**{name: results[case.case][name] for name in fields})]

    monkeypatch.setattr(running, "played", quick)
    for cut in np.random.default_rng(0).integers(0, len(text), 10).tolist():
        played_again.clear()
        out.write_bytes(text[:cut])
        kept = max(0, text[:cut].count(b"\n") - 1)
        assert run(suite, ACT, out, device="cpu") == whole
        assert len(played_again) == len(whole) - kept
        assert out.read_text().count("\n") == len(whole) + 1


def test_files_of_something_else_are_refused(suite: Path, tmp_path: Path):
    """Rows of another policy or suite, rows twice, a file in use, and rows of no case."""
    out = tmp_path / "rows.jsonl"
    head = {"rows": 1, "of": "0", "policy": ACT}
    row = {"case": 0, "id": "a", "axis": "b", "grade": 1, "success": 0, "success_once": 0, "fallback": 0}
    out.write_text("\n".join(map(json.dumps, (head, row))) + "\n")
    with pytest.raises(ArgumentError, match=r"has rows of another .*Give another --out"):
        run(suite, ACT, out, device="cpu")
    out.write_text("\n".join(map(json.dumps, (head, row, row))))
    with pytest.raises(ArgumentError, match="one row for each case"):
        read_rows(out)
    with out.open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(ArgumentError, match="another process writes"):
            run(suite, ACT, out, device="cpu")
    out.write_text(json.dumps({"suite": 1}))
    with pytest.raises(ArgumentError, match="first line has no key 'rows'"):
        read_rows(out)


def test_policies_that_do_not_fit_are_refused(suite: Path, tmp_path: Path):
    """A network for other observations, and actions of another shape. No row is written."""
    torch.jit.script(torch.nn.Linear(3, 5)).save(str(tmp_path / "small.pt"))
    with pytest.raises(ArgumentError, match=r"small.pt: cannot take the observations policy \(2, 19\)"):
        run(suite, str(tmp_path / "small.pt"), tmp_path / "rows.jsonl", num_envs=2, device="cpu")
    (tmp_path / "model.zip").touch()
    with pytest.raises(ArgumentError, match=r"Stable-Baselines3 .*--trust"):
        run(suite, str(tmp_path / "model.zip"), tmp_path / "rows.jsonl", device="cpu")
    with pytest.raises(ArgumentError, match=r"should return actions of shape \(2, 5\)"):
        run(suite, "tests.suites.test_running:short", tmp_path / "other.jsonl", num_envs=2, device="cpu")
    assert (tmp_path / "rows.jsonl").read_text().count("\n") == 1
    assert len(run(suite, ACT, tmp_path / "rows.jsonl", device="cpu")) > 20, "with another policy, as no case ran"


def short(observation: dict[str, torch.Tensor]) -> torch.Tensor:
    """Return too few actions."""
    return observation["policy"][:, :2]


def test_suites_of_another_scene_and_foreign_code_are_refused(suite: Path, tmp_path: Path):
    """A hash that the task's scene does not have, and a task of a module without trust."""
    head, *lines = suite.read_text().splitlines()
    told = json.loads(head)
    suite.write_text("\n".join([json.dumps(told | {"hash": "0" * 16}), *lines]))
    with pytest.raises(SceneMismatchError, match=r"changed .*Make the suite again"):
        run(suite, ACT, tmp_path / "rows.jsonl", device="cpu")
    suite.write_text("\n".join([json.dumps(told | {"params": [*told["params"], "objects.none.mass"]}), *lines]))
    with pytest.raises(UnknownNameError, match=r"unknown param 'objects.none.mass'"):
        run(suite, ACT, tmp_path / "rows.jsonl", device="cpu")
    suite.write_text("\n".join([json.dumps(told | {"task": "os:X-v0"}), *lines]))
    with pytest.raises(ArgumentError, match=r"Python code.*--trust"):
        run(suite, ACT, tmp_path / "rows.jsonl", device="cpu")


def test_failures_are_ids_for_the_viewer(tmp_path: Path):
    """Of one split, without successes."""
    row = {"axis": "b", "grade": 1, "success_once": 0, "fallback": 0}
    ids = ("h:eval:1:0", "h:eval:2:0", "h:train:3:0", "h:eval:4:0:a=00000000")
    rows = [{**row, "case": i, "id": name, "success": i == 1} for i, name in enumerate(ids)]
    path = tmp_path / "rows.jsonl"
    path.write_text("\n".join(map(json.dumps, ({"rows": 4, "changes": ["a=1"]}, *rows))))
    assert failures(path, None) == (["a=1"], ["h:eval:1:0", "h:eval:4:0:a=00000000"])
    assert failures(path, "train") == (["a=1"], ["h:train:3:0"])
    path.write_text("\n".join(map(json.dumps, ({"rows": 4, "changes": []}, rows[1]))))
    with pytest.raises(ArgumentError, match="no failed case"):
        failures(path, None)


def register(monkeypatch: pytest.MonkeyPatch, **kwargs) -> str:
    """Register a task until the end of the test, and return its id."""
    name = "SuiteOther-v0"
    words = {"vector_entry_point": "sceniris_gym:SceneVectorEnv", "max_episode_steps": 2, "kwargs": kwargs}
    gym.register(name, **words)
    monkeypatch.setitem(gym.registry, name, gym.registry.pop(name))
    return name


def ran(task: str, folder: Path, *axes: str, policy: str = "tests.suites.conftest:still", **options) -> list[dict]:
    """Make a suite of one case a grade, run it, and return the rows."""
    made, _ = make(task, axes, 1, 1, device="cpu", **options)
    made.write(folder / "other.jsonl")
    return run(folder / "other.jsonl", policy, folder / "rows.jsonl", device="cpu")


def test_settings_of_a_registered_task_do_not_change_its_cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Params, a curriculum, overrides and starts are those of the task; stored layouts are refused by name."""
    own = {"params": ["objects.block.region"], "curriculum": LevelReplay(), "overrides": {"bank": 4}}
    name = register(monkeypatch, task=Timed, scene=WIDE, **own)
    rows = ran(name, tmp_path, "mass", "shift")
    assert [(row["axis"], row["length"]) for row in rows] == [("nominal", 2), ("mass", 2), ("shift", 2)]
    (tmp_path / "rows.jsonl").unlink()
    start = ("start=[{robot: home}]",)
    assert len(ran(name, tmp_path, "mass", changes=start)) == 2
    with pytest.raises(ArgumentError, match="should have no 'start'"):
        make(name, ("shift",), 1, 1, changes=start, device="cpu")
    monkeypatch.delitem(gym.registry, name)
    stored = make_table(compile_scene(WIDE, "cpu"), 2, 0)
    name = register(monkeypatch, task=Timed, scene=WIDE, layout_source=stored)
    (tmp_path / "rows.jsonl").unlink()
    with pytest.raises(ArgumentError, match="params only apply without a layout_source"):
        ran(name, tmp_path, "mass")


class Redrawing(SceneVectorEnv):
    """Worlds in which the block jumps in the middle of each episode."""

    def step(self, actions):
        """Step, and redraw the block after the first step of an episode."""
        result = super().step(actions)
        self.redraw("block", self.state.elapsed == 1)
        return result


def test_redraws_give_the_same_rows_on_any_number_of_worlds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Also of edits. Redraws have the places of the scene file, not of the edit."""
    name = register(monkeypatch, task=Timed, scene=WIDE)
    made, _ = make(name, ("mass", "shift"), 2, 2, device="cpu")
    made.write(tmp_path / "s.jsonl")
    monkeypatch.setattr(gym.registry[name], "vector_entry_point", "tests.suites.test_running:Redrawing")
    rows = [run(tmp_path / "s.jsonl", ACT, tmp_path / f"{n}.jsonl", num_envs=n, device="cpu") for n in (3, 16)]
    assert rows[0] == rows[1]
    monkeypatch.setattr(gym.registry[name], "vector_entry_point", "sceniris_gym:SceneVectorEnv")
    still = run(tmp_path / "s.jsonl", ACT, tmp_path / "still.jsonl", device="cpu")
    assert all(row["total_reward"] != other["total_reward"] for row, other in zip(rows[0], still, strict=True))


def test_held_out_variants_and_edits_share_a_suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Nominal cases and edits have trained variants, and one axis has the others."""
    name = register(monkeypatch, task=Timed, scene=WIDE)
    rows = ran(name, tmp_path, "variant", "shift", changes=("objects.thing.holdout=0.5",))
    splits = {row["axis"]: row["id"].split(":")[1] for row in rows}
    assert splits == {"nominal": "train", "variant": "eval", "shift": "train"}


def test_problems_of_libero_are_tasks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """With the door's own class, on the scene file that `init` wrote."""
    file = write(tmp_path, STACK)
    cli.main(["init", str(file), "-o", str(tmp_path / "stack.yaml"), "--device", "cpu"])

    class InBasket(LiberoGoalTask):
        action_size = 5

        def apply(self, s, action):
            """Do nothing."""

    name = register(monkeypatch, task=InBasket(read_bddl(file).problem), scene=str(tmp_path / "stack.yaml"))
    rows = ran(name, tmp_path, "mass", "shift")
    assert {row["axis"] for row in rows} == {"nominal", "mass", "shift"}
    assert not any(row["success"] or row["broken"] for row in rows)


class Foreign(gym.vector.VectorEnv):
    """Worlds of another library."""

    num_envs = 1

    def __init__(self, **_):
        """Take all arguments."""


def test_environments_of_others_are_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """If they are no SceneVectorEnv, as those of mjlab."""
    gym.register(
        "SuiteOther-v0",
        entry_point=lambda **_: gym.Env(),
        vector_entry_point=Foreign,
        kwargs={"task": Timed, "scene": WIDE},
    )
    monkeypatch.setitem(gym.registry, "SuiteOther-v0", gym.registry.pop("SuiteOther-v0"))
    with pytest.raises(ArgumentError, match="but makes a Foreign"):
        ran("SuiteOther-v0", tmp_path, "mass")


def test_a_module_registers_its_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A stranger's task and policy, with trust."""
    monkeypatch.chdir(tmp_path)
    task = write_task(tmp_path, "suite_of_a_stranger")
    (tmp_path / "strange_policy.py").write_text("def act(seen):\n    return seen['policy'][:, :1].repeat(1, 5)\n")
    made, _ = make(task, ("mass",), 1, 2, device="cpu")
    made.write(tmp_path / "s.jsonl")
    words = {"policy": "strange_policy:act", "out": tmp_path / "rows.jsonl", "device": "cpu"}
    with pytest.raises(ArgumentError, match=r"--trust"):
        run(tmp_path / "s.jsonl", **words)
    assert [row["length"] for row in run(tmp_path / "s.jsonl", **words, trust=True)] == [4] * 4
