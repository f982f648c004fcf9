"""Counts of compiled kernels before and after a start: the command leaves none to compile."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

from sceniris_gym import cli
from sceniris_gym.device import sequence
from sceniris_gym.errors import UnknownNameError

_LEFT_OUT = ("wp_reset_data", "wp__update_gradient_grad", "wp_sceniris_gym.sim.")
_START = """
import gymnasium, sceniris_gym
envs = gymnasium.make_vec("sceniris_gym/TabletopReach-v0", num_envs=4, device="cpu")
envs.reset(seed=1)
envs.step(envs.action_space.sample())
"""


@pytest.mark.slow
def test_a_start_after_it_compiles_nothing(tmp_path: Path):
    """In a cache without some small kernels of the reset and the step, as compiling all would take a minute."""
    wp.init()
    cache = Path(wp.config.kernel_cache_dir or "")
    kept = tmp_path / "kernels" / cache.name
    kept.mkdir(parents=True)
    for folder in cache.glob("wp_*"):
        if not folder.name.startswith(_LEFT_OUT):
            (kept / folder.name).symlink_to(folder)
    before = len(list(kept.iterdir()))
    env = os.environ | {"WARP_CACHE_PATH": str(tmp_path / "kernels")}
    command = [sys.executable, "-m", "sceniris_gym", "compile", "TabletopReach-v0", "--device", "cpu", "--json"]
    said = json.loads(subprocess.run(command, check=True, env=env, capture_output=True, text=True).stdout)
    after = {path.name for path in kept.iterdir()}
    assert said["kernels"] == len(after) - before > 0
    assert said["kernel_cache"] == str(kept)
    assert list(Path(said["scene_cache"]).iterdir())
    started = subprocess.run([sys.executable, "-c", _START], check=True, env=env, capture_output=True, text=True)
    assert {path.name for path in kept.iterdir()} == after
    assert "compiling" not in started.stderr


def test_a_scene_and_a_task_are_compiled_by_one_command(capfd: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """The second time, nothing is left to compile. Other processes of these tests may compile in the same cache."""
    words = ["compile", "mid", "TabletopReachEasy-v0", "--num-envs", "2", "--device", "cpu", "--json"]
    cli.main(words)
    assert json.loads(capfd.readouterr().out)["names"] == ["mid", "TabletopReachEasy-v0"]
    left: list[object] = []
    monkeypatch.setattr(sequence, "load_modules", lambda variants, device: left.extend(variants))
    cli.main(words)
    assert left == []


def test_an_unknown_task_is_refused_with_the_nearest_name():
    """Before anything is compiled for it."""
    with pytest.raises(UnknownNameError, match="TabletopReach-v0"):
        cli.compile_(("TabletopReech-v0",), device="cpu")
