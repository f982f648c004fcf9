"""One line about compiling, instead of Warp's own about every module."""

from __future__ import annotations

import subprocess
import sys

import pytest

from sceniris_gym.device import kernel_log
from sceniris_gym.device.kernel_log import tell_of_compiling

PROGRAM = """
import sys
import warp as wp
from sceniris_gym.device.kernel_log import start_warp
from sceniris_gym.sim import write
wp.config.log_level = getattr(wp, sys.argv[1])
start_warp()
wp.load_module(write, device="cpu")
"""


@pytest.mark.parametrize(("level", "silent"), [("LOG_INFO", True), ("LOG_DEBUG", False)])
def test_warp_is_silent_unless_it_is_asked_to_speak(level: str, silent: bool):
    """Neither a greeting nor a line about a module in a fresh process, but for those who want to hear all of it."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, level], capture_output=True, text=True, check=True)
    assert (done.stdout == "") is silent
    assert "CUDA driver" not in done.stderr  # a computer without a GPU has none to miss


def test_each_device_is_told_of_once(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """However often kernels are compiled for it."""
    monkeypatch.setattr(kernel_log, "_told", set())
    for device in ("cpu", "cuda:0", "cpu"):
        tell_of_compiling(device)
    said = capsys.readouterr().err.splitlines()
    assert ["kernels for 'cpu'" in line for line in said] == [True, False]
    assert ["kernels for 'cuda:0'" in line for line in said] == [False, True]
