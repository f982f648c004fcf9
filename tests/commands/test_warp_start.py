"""Warp says nothing where a command starts it, whether there is a GPU or not."""

from __future__ import annotations

import subprocess
import sys

from sceniris_gym.commands.warp_start import without_gpu_warning


def test_nothing_is_said_of_a_gpu_that_is_not_there():
    """Neither the greeting nor the warning of a fresh process; what is written afterwards is seen."""
    program = "import os; from sceniris_gym.commands.warp_start import start_warp; start_warp(); os.write(2, b'here')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"here")


def test_other_lines_are_passed_on():
    """As that a driver is too old, which users can mend."""
    old = b"Warp CUDA error: Warp requires CUDA driver 12.0 or higher\n"
    none = b"Warp CUDA warning: Could not find or load the NVIDIA CUDA driver. GPU execution will not be available.\n"
    assert without_gpu_warning(none) == b""
    assert without_gpu_warning(old + none + b"half a line") == old + b"half a line"
