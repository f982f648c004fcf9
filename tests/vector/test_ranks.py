"""Processes that train together: seeds and devices of their own, and no layout that two of them share."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sceniris_gym.vector.ranks import Rank

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return the folder of what two processes found, as torchrun starts them, and their standard error."""
    pytest.importorskip("rsl_rl")
    folder = tmp_path_factory.mktemp("two")
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command += ["-m", "tests.vector.two_processes", str(folder)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=400, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return folder, done.stderr


@pytest.mark.slow
def test_two_processes_share_no_layout_and_make_theirs_again(trained: tuple[Path, str]):
    """With seed 0 in both."""
    folder, said = trained
    assert json.loads((folder / "shared.json").read_text()) == [[*range(8), *range(2**40, 2**40 + 8)], 16]
    assert "rank 1 of 2" in said


@pytest.mark.slow
def test_two_processes_train_one_policy_on_layouts_of_their_own(trained: tuple[Path, str]):
    """By the example of rsl-rl; one of them writes."""
    (weights, seeds, writes), (others, other_seeds, other_writes) = json.loads(
        (trained[0] / "example.json").read_text()
    )
    assert weights == others
    assert (seeds, other_seeds) == ([0, 1, 2], [2**40, 2**40 + 1, 2**40 + 2])
    assert (writes, other_writes) == (True, False)
    names = [path.name for path in (trained[0] / "example").iterdir()]
    assert sorted(name for name in names if name.endswith(".pt")) == ["model_0.pt", "model_1.pt"]
    assert sum("tfevents" in name for name in names) == 1


@pytest.mark.slow
def test_two_processes_are_measured(trained: tuple[Path, str], tmp_path: Path):
    """They take twice the steps, have equal weights at the end, and share no layout; one of them writes."""
    from benchmarks.many_gpus import report

    assert [path.name for path in (trained[0] / "measured").iterdir()] == ["trained_2.json"]
    found = json.loads(Path(shutil.copy(trained[0] / "measured" / "trained_2.json", tmp_path)).read_text())
    assert (found["processes"], found["layouts"], found["layouts_shared"]) == (2, 600, 0)
    assert found["weights_differ_by"] == 0.0
    assert 0.0 < found["exchange_share"] < 1.0
    report(tmp_path)
    assert json.loads((tmp_path / "many_gpus.json").read_text())["training"][0]["ratio"] == 2.0
    assert (tmp_path / "many_gpus.png").stat().st_size > 5000


def test_a_process_by_itself_changes_nothing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Without torchrun's variables, or with what is no number in them."""
    for value in (None, "", "one", "-1"):
        for name in ("RANK", "LOCAL_RANK", "WORLD_SIZE"):
            monkeypatch.delenv(name, raising=False)
            if value is not None:
                monkeypatch.setenv(name, value)
        rank = Rank.current()
        assert (rank.number, rank.device, rank.own_seed(7)) == (0, None, 7)
        rank.tell("cpu")
    assert capsys.readouterr().err == ""


def test_a_rank_has_seeds_of_its_own(monkeypatch: pytest.MonkeyPatch):
    """2^40 for each, around 2^64."""
    for name, value in {"RANK": "5", "LOCAL_RANK": "1", "WORLD_SIZE": "8"}.items():
        monkeypatch.setenv(name, value)
    rank = Rank.current()
    assert rank == Rank(5, 1, 8)
    assert rank.own_seed(3) == 5 * 2**40 + 3
    assert rank.own_seed(2**64 - 1) == 5 * 2**40 - 1
