"""The `train` command: tasks of one's own, one line as the result, and what is refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

pytest.importorskip("rsl_rl")

from sceniris_gym import cli, commands
from tests.training.scenes import SMALL, write_task


def without_warp(text: str) -> str:
    """Return standard error less the line with which Warp warns of a machine without an NVIDIA driver."""
    return "".join(line for line in text.splitlines(keepends=True) if not line.startswith("Warp CUDA warning: "))


@pytest.mark.slow
def test_a_task_of_ones_own_is_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture):
    """From the working directory, with the default settings; the log goes to stderr, and stdout is one line."""
    monkeypatch.chdir(tmp_path)
    task = write_task(tmp_path, "own_task_to_train")
    words = ["train", task, *SMALL, "--out", "run"]
    cli.main(words)
    out, err = capfd.readouterr()
    assert out.startswith(f"{task}: ")
    assert out.endswith(" million steps; the policy is in run/model.pt\n")
    assert out.count("\n") == 1
    told, *lines = without_warp(err).splitlines()  # the first run also has a line about kernels
    assert told.startswith(f"{task} trains with default settings (change them by --set): Settings(hidden=(8,)")
    assert told.endswith(". The log gets a line after 1 iterations (--every 1: after each) and at each evaluation.")
    assert [json.loads(line) for line in lines] == [
        json.loads(line) for line in Path("run/log.jsonl").read_text().splitlines()
    ]
    assert [json.loads(line)["kind"] for line in lines] == ["train", "train", "eval"]

    cli.main([*words, "--resume", "--json"])
    again = capfd.readouterr()
    assert (again.out.count("\n"), again.err) == (1, "")
    judged = json.loads(lines[-1])
    del judged["kind"]
    assert json.loads(again.out) == {"task": task, "model": "run/model.pt", **judged}

    module = tmp_path / "own_task_to_train.py"
    module.write_text(module.read_text() + "\n# a remark changes nothing\nprint()\n")
    cli.main([*words, "--resume", "--json"])
    assert json.loads(capfd.readouterr().out.splitlines()[-1])["task"] == task
    module.write_text(module.read_text().replace("< 0.0", "< 0.1"))
    with pytest.raises(SystemExit):
        cli.main([*words, "--resume"])
    assert "the run to resume has task.hash" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["DrawerPik-v0"], "unknown task 'DrawerPik-v0'. Did you mean 'DrawerPick-v0'?"),
        (["nowhere_at_all:Task-v0"], "'nowhere_at_all' should be a module that Python can import"),
        (["DrawerPick-v0", "--set", "gama=1"], "--set: unknown setting 'gama'. Did you mean 'gamma'?"),
        (["DrawerPick-v0", "--changes", "gamma=1"], "train: '--changes' is now --set."),
        (["DrawerPick-v0", "--bank", "0"], "--bank 0: should be 1 or more layouts"),
        (["DrawerPick-v0", "--minutes", "0"], "--minutes 0.0: should be above 0"),
        (["DrawerPick-v0", "--num-envs", "0"], "--num-envs 0: should be at least 1"),
        (["DrawerPick-v0", "--seed", "-1"], "--seed -1: should be at least 0"),
    ],
)
def test_what_cannot_be_trained_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture, words: list[str], message: str
):
    """In words, before anything is compiled or written."""
    with pytest.raises(SystemExit) as stop:
        cli.main(["train", *words, "--device", "cpu", "--out", str(tmp_path / "run")])
    said = capfd.readouterr()
    assert (stop.value.code, said.out, said.err.count("\n")) == (2, "", 1)
    assert message in said.err
    assert not (tmp_path / "run").exists()


def test_a_missing_library_is_said_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
):
    """Without rsl-rl the command ends with the extra to install."""
    importers = ("commands.train", "training.train", "training.runner", "training.judging", "adapters.rsl_rl")
    for name in [name for name in sys.modules if name.partition(".")[0] == "rsl_rl"]:
        monkeypatch.delitem(sys.modules, name)
    for name in (f"sceniris_gym.{importer}" for importer in importers):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.delattr(commands, "train", raising=False)
    monkeypatch.setitem(sys.modules, "rsl_rl", None)
    with pytest.raises(SystemExit) as stop:
        cli.main(["train", "DrawerPick-v0", "--out", str(tmp_path), "--device", "cpu"])
    expected = "error: rsl_rl is not installed. Install the extra: in the clone, pip install -e '.[rsl-rl]'.\n"
    assert (stop.value.code, *capfd.readouterr()) == (2, "", expected)


@pytest.mark.slow
def test_ctrl_c_ends_a_training_with_its_checkpoint(tmp_path: Path):
    """At once, as any command; what was saved is whole."""
    words = [sys.executable, "-m", "sceniris_gym", "train", write_task(tmp_path, "own_task_to_stop"), *SMALL]
    words += ["--out", str(tmp_path / "run"), "--save-every", "0", "--million-steps", "1000", "--json"]
    folder = {"cwd": tmp_path, "env": {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[1])}}
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **folder) as process:
        while not (tmp_path / "run" / "model.pt").exists() and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, without_warp(err)) == (130, "", "")
    assert torch.load(tmp_path / "run" / "model.pt", weights_only=False)["infos"]["iterations"] >= 1
    assert not list(tmp_path.rglob("*.tmp"))
