"""The script of all training runs, with a stand-in for the trainings."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tarfile
import time
from pathlib import Path

from benchmarks import curves
from tests.benchmarks.runs import write_run

SCRIPT = Path(curves.__file__).with_name("evidence.sh")


MAKES_FOLDER = "while [ $1 != --out ]; do shift; done; mkdir -p $2; exit"
"""A stand-in for a training: it makes the folder of the run, and is done."""


def with_trainer(folder: Path, line: str) -> dict[str, str]:
    """Return an environment in which a line of bash stands for every training, and nothing is kept from before."""
    fake = folder / "python"
    fake.write_text(f'#!/bin/bash\n[ "$2 $3" = "sceniris_gym train" ] && {{ {line}; }}\nexec {sys.executable} "$@"\n')
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
