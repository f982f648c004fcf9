"""One line about compiling, instead of Warp's own about every module."""

from __future__ import annotations

import subprocess
import sys

import pytest

from sceniris_gym.device import kernel_log
from sceniris_gym.device.kernel_log import tell_of_compiling

PROGRAM = """
import os, sys
import warp as wp
from sceniris_gym.device.kernel_log import start_warp
from sceniris_gym.sim import write
for level in sys.argv[1:]:
    print("\\nlevel:", level, flush=True)
    if (child := os.fork()) == 0:
        wp.config.log_level = getattr(wp, level)
        start_warp()
        wp.load_module(write, device="cpu")
        sys.exit()
    assert os.waitpid(child, 0)[1] == 0
"""


def test_warp_is_silent_unless_it_is_asked_to_speak():
    """Neither a greeting nor a line about a module in a fresh process, but for those who want to hear all of it."""
    words = [sys.executable, "-c", PROGRAM, "LOG_INFO", "LOG_DEBUG"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    said = done.stdout.split("\nlevel: ")
    assert (said[1], said[2] == "LOG_DEBUG\n") == ("LOG_INFO\n", False)
    assert "CUDA driver" not in done.stderr  # a computer without a GPU has none to miss


def test_each_device_is_told_of_once(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """However often kernels are compiled for it."""
    monkeypatch.setattr(kernel_log, "_told", set())
    for device in ("cpu", "cuda:0", "cpu"):
        tell_of_compiling(device)
    said = capsys.readouterr().err.splitlines()
    assert ["kernels for 'cpu'" in line for line in said] == [True, False]
    assert ["kernels for 'cuda:0'" in line for line in said] == [False, True]
    assert all("Scenes of the same kind share compiled kernels" in line and "once" not in line for line in said)
