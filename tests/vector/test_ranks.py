"""Processes that train together: seeds and devices of their own, and no layout that two of them share."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sceniris_gym.vector.ranks import Rank

SCRIPT = """
import json, sys
import torch.distributed as dist
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import SCENE, Reach

dist.init_process_group("gloo")
envs = SceneVectorEnv(Reach, 8, scene={**SCENE, "bank": 1}, device="cpu")
rows = []
for _ in range(2):
    _, info = envs.reset(seed=0)
    rows.append(envs.randomizer.layouts.qpos.cpu().numpy().tolist())
    assert envs.np_random_seed == 0
assert rows[0] == rows[1]
found = [None] * dist.get_world_size()
dist.all_gather_object(found, (info["layout"]["seed"].tolist(), rows[0]))
if dist.get_rank() == 0:
    seeds = [seed for part, _ in found for seed in part]
    layouts = {tuple(row) for _, part in found for row in part}
    with open(sys.argv[1], "w") as file:  # the other process writes to the same standard output
        json.dump([seeds, len(layouts)], file)
dist.destroy_process_group()
"""


@pytest.mark.slow
def test_two_processes_share_no_layout_and_make_theirs_again(tmp_path: Path):
    """As torchrun starts them, with seed 0 in both, over gloo."""
    script, found = tmp_path / "two.py", tmp_path / "found.json"
    script.write_text(SCRIPT)
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(script)]
    command.append(str(found))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path.cwd()), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=240, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert json.loads(found.read_text()) == [[*range(8), *range(2**40, 2**40 + 8)], 16]
    assert "rank 1 of 2" in done.stderr


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
