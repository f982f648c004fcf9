"""The `evaluate` command: shares with their intervals, verdicts in a file, and what is no run."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("rsl_rl")

from sceniris_gym import ImageConfig, cli
from sceniris_gym.commands import evaluate as module
from sceniris_gym.commands.evaluate import evaluate, report
from sceniris_gym.commands.options import Evaluation
from sceniris_gym.commands.train import train
from sceniris_gym.errors import ArgumentError
from sceniris_gym.training.settings import Options
from sceniris_gym.training.task_scenes import spec_of
from tests.training.scenes import write_task

PAGE = Path(__file__).parents[2] / "docs" / "training.md"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small training, of a task of one's own that lies beside it."""
    folder = tmp_path_factory.mktemp("own")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("SCENIRIS_GYM_CACHE", str(folder / "cache"))
        task = write_task(folder, "own_task_to_evaluate")
        small = {"num_envs": 2, "layouts": 3, "every": 1, "million_steps": 1e-6, "changes": ("hidden=[8]", "steps=4")}
        train(Options(task, device="cpu", out=folder / "run", **small), quiet=True)
    return folder / "run"


@pytest.fixture(autouse=True)
def _compiled_once(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENIRIS_GYM_CACHE", str(run.parent / "cache"))


def test_an_evaluation_is_that_of_the_training(run: Path, capfd: pytest.CaptureFixture, tmp_path: Path):
    """Of as many layouts it has the same verdicts, in one line of JSON and layout by layout in a file."""
    task = json.loads((run / "config.json").read_text())["options"]["task"]
    words = ["evaluate", str(run), "--layouts", "3", "--device", "cpu", "--json", "-o", str(tmp_path / "each.json")]
    cli.main([*words, "--task", task])
    said = capfd.readouterr()
    assert (said.out.count("\n"), said.err) == (1, "")
    found, before = json.loads(said.out), json.loads((run / "log.jsonl").read_text().splitlines()[-1])
    assert set(found) == {"valid", "unfiltered"}
    assert found == {name: before[name] for name in found}
    verdicts, kept = (json.loads(path.read_text()) for path in (tmp_path / "each.json", run / "judged.json"))
    assert verdicts == {name: kept[name] for name in verdicts}
    assert [len(one["each"]["success"]) for one in verdicts.values()] == [3, 3]


@pytest.mark.parametrize("changed", ["scene", "task", "scene and task", "nothing"])
def test_a_scene_or_task_that_changed_since_the_training_is_told_in_a_line(
    run: Path, capfd: pytest.CaptureFixture, tmp_path: Path, changed: str
):
    """With the hash of the training; a run of a version that wrote none is evaluated without a word."""
    shutil.copytree(run, tmp_path / "run")
    file = tmp_path / "run" / "config.json"
    told = json.loads(file.read_text())
    task, hashes = told["options"]["task"], {part: told.pop(part)["hash"] for part in ("scene", "task")}
    told |= {part: {"hash": "0123456789abcdef"} for part in hashes if part in changed.split()}
    file.write_text(json.dumps(told))
    cli.main(["evaluate", str(tmp_path / "run"), "-n", "1", "--device", "cpu", "--task", task, "--json"])
    there = {part: now for part, now in hashes.items() if part in changed.split()}
    parts = [f"the {part} (hash 0123456789abcdef, now {now})" for part, now in there.items()]
    line = f"warning: {tmp_path / 'run'}: {' and '.join(parts)} changed since the training. Train again.\n"
    assert capfd.readouterr().err == (line if parts else "")


def test_failed_layouts_are_listed_and_shown(run: Path, capfd: pytest.CaptureFixture, tmp_path: Path):
    """One id a line, with the command that plays them; a fraction below --min-success ends with status 1."""
    task = json.loads((run / "config.json").read_text())["options"]["task"]
    out, failed = tmp_path / "each.json", tmp_path / "failed.txt"
    words = ["evaluate", str(run), "-n", "3", "--device", "cpu", "--task", task, "-o", str(out)]
    with pytest.raises(SystemExit) as stop:
        cli.main([*words, "--failed", str(failed), "--min-success", "1"])
    assert stop.value.code == 1
    said = capfd.readouterr().out.splitlines()
    each = json.loads(out.read_text())["valid"]["each"]
    ids = [name for name, success in zip(each["id"], each["success"], strict=True) if not success]
    assert failed.read_text().split() == ids
    assert said[0].startswith("FAIL: valid: ")
    view = f"sceniris-gym view --env {task} --policy {run / 'model.pt'} --layout {failed} # extra viewer"
    replay = f"sceniris-gym replay {failed} --scene {run.parent / 'lower.yaml'}"
    assert said[2] == f"wrote {out} (6 layouts), {failed} ({len(ids)} ids)"
    assert said[3:] == ([replay, view] if ids else ["All valid layouts ended in success."])


def test_failures_of_a_policy_that_sees_images_are_viewed_without_it(
    run: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """The viewer plays no policy with images, so the command that is told shows only the layouts."""
    env = SimpleNamespace(unwrapped=SimpleNamespace(image_config=ImageConfig(cameras={"eye": {}})))
    found = {"success": 0.0, "interval": (0.0, 0.8), "layouts": 1, "each": {"id": ["a:eval:0:0"], "success": [0]}}
    monkeypatch.setattr(module, "judges_of", lambda *_: {"valid": env, "unfiltered": env})
    monkeypatch.setattr(module, "judge", lambda *_: found)
    monkeypatch.setattr(module, "Policy", lambda *_, trust: None)
    task = json.loads((run / "config.json").read_text())["options"]["task"]
    told = evaluate(Evaluation(run, 1, failed=tmp_path / "failed.txt", task=task, device="cpu"))
    assert told["view"] == f"sceniris-gym view --env {task} --layout {tmp_path / 'failed.txt'} # extra viewer"


def test_a_video_shows_the_first_episodes(run: Path, capfd: pytest.CaptureFixture, tmp_path: Path):
    """A frame for the start and each step, in a grid of 4 x 4 worlds; an .avi is refused."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed (extra 'video')")
    task, file = json.loads((run / "config.json").read_text())["options"]["task"], tmp_path / "out.mp4"
    words = ["evaluate", str(run), "-n", "3", "--device", "cpu", "--task", task, "--json"]
    cli.main([*words, "--video", str(file)])
    assert json.loads(capfd.readouterr().out).keys() == {"valid", "unfiltered"}
    assert report(made_of(3), Evaluation(run, video=file)).splitlines()[2:] == [f"wrote {file} (3 worlds)"]
    about, *frames = ffmpeg.read_frames(file)
    steps = spec_of(task).max_episode_steps
    assert (about["size"], len(frames)) == ((960, 720), 1 + (steps or 0))
    first = np.frombuffer(frames[0], np.uint8).reshape(720, 960, 3)
    assert first[:180, :240].std() > 10.0
    assert first[-180:, -240:].max() < 20  # there are four worlds, so the last tile stays black
    with pytest.raises(SystemExit) as stop:
        cli.main([*words, "--video", str(tmp_path / "out.avi")])
    assert stop.value.code == 2
    assert "Give a path that ends in .mp4" in capfd.readouterr().err


@pytest.mark.parametrize("fraction", ["65", "-0.1", "nan"])
def test_a_minimum_success_that_is_not_a_fraction_is_refused(fraction: str, capfd: pytest.CaptureFixture):
    """Before the evaluation, as a usage error."""
    with pytest.raises(SystemExit) as stop:
        cli.main(["evaluate", "nowhere", "--min-success", fraction])
    assert stop.value.code == 2
    bound = "at least 0" if fraction == "-0.1" else "at most 1"
    assert capfd.readouterr().err == f"error: --min-success {float(fraction)}: should be {bound}.\n"


def made_of(layouts: int) -> dict[str, dict[str, Any]]:
    """Return the findings of an evaluation on `layouts` valid layouts and 12 unfiltered ones."""
    return {
        "valid": {"success": 0.5, "interval": (0.25, 0.751), "layouts": layouts},
        "unfiltered": {"success": 0.0, "interval": (0.0, 0.01), "layouts": 12},
    }


def test_an_evaluation_is_told_in_words():
    """A line for each kind of layouts, and one for the files, each with its count."""
    rates = "valid: 50.0% (25.0% to 75.1%) of 4,096 layouts\nunfiltered: 0.0% (0.0% to 1.0%) of 12 layouts"
    assert report(made_of(4096), Evaluation(Path("run"))) == rates
    files = Evaluation(Path("run"), out=Path("a.json"), failed=Path("b.txt"), video=Path("c.mp4"))
    wrote = "wrote a.json (4,108 layouts), b.txt (2,048 ids), c.mp4 (16 worlds)"
    assert report(made_of(4096), files) == f"{rates}\n{wrote}"


def test_a_folder_without_a_run_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture):
    """A run that has no checkpoint yet is none to evaluate."""
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(SystemExit) as stop:
        cli.main(["evaluate", str(tmp_path), "--device", "cpu"])
    said = capfd.readouterr()
    assert (stop.value.code, said.out) == (2, "")
    wanted = f"should be the folder of a run of 'sceniris-gym train TASK --out {tmp_path}'"
    assert said.err == f"error: {tmp_path}: {wanted}, but has no model.pt.\n"


def test_a_task_that_only_the_folder_names_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Importing a module executes it, also one that lies where the program is started."""
    (tmp_path / "beside.py").write_text("raise SystemExit('executed')")
    (tmp_path / "config.json").write_text(json.dumps({"options": {"task": "beside:Foo-v0"}, "settings": {}}))
    (tmp_path / "model.pt").touch()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ArgumentError, match=r"config\.json: .* Python code.*give --task beside:Foo-v0"):
        evaluate(Evaluation(tmp_path, 1, device="cpu"))


def test_the_policy_is_exported_as_the_page_says(run: Path, capfd: pytest.CaptureFixture):
    """The program of docs/training.md writes a policy that acts on the group `policy` alone."""
    (program,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    program = program.replace("results/drawer", str(run))
    exec(compile(program, str(PAGE), "exec"), {})
    policy = torch.jit.load(run / "policy.pt")
    assert policy(torch.zeros(5, 4)).shape == (5, 5)
