"""The measurement on several GPUs, small and on processors: two processes, one policy, no layout twice."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rsl_rl")

from benchmarks.many_gpus import report, same_parts
from sceniris_gym import cli

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_two_processes_are_measured(tmp_path: Path):
    """By gloo: they take twice the steps, have equal weights at the end, and share no layout; one of them writes."""
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command += ["-m", "benchmarks.many_gpus", "measure", "--folder", str(tmp_path), "--num-envs", "4"]
    command += ["--iterations", "1", "--layouts", "600", "--device", "cpu"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=400, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert [path.name for path in tmp_path.iterdir()] == ["trained_2.json"]
    found = json.loads((tmp_path / "trained_2.json").read_text())
    assert (found["processes"], found["layouts"], found["layouts_shared"]) == (2, 600, 0)
    assert found["weights_differ_by"] == 0.0
    assert 0.0 < found["exchange_share"] < 1.0
    report(tmp_path)
    assert json.loads((tmp_path / "many_gpus.json").read_text())["training"][0]["ratio"] == 2.0
    assert (tmp_path / "many_gpus.png").stat().st_size > 5000


def test_data_sets_are_compared_part_by_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Equal ones are, and one from other seeds is refused."""
    for name, seed in (("a", "0"), ("b", "0"), ("c", "1")):
        cli.main(["generate", "mid", "-n", "8", "--out", str(tmp_path / name), "--seed", seed, "--device", "cpu"])
    capsys.readouterr()
    same_parts(tmp_path / "a", tmp_path / "b")
    assert capsys.readouterr().out == "1 parts of 1 are the same\n"
    with pytest.raises(SystemExit, match="the rows differ"):
        same_parts(tmp_path / "a", tmp_path / "c")
