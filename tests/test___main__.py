"""The program: signals end it at any moment, from its first imports on."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest


def test_the_end_does_not_collect_garbage():
    """The collections at Python's end visit no object, because all are frozen before."""
    program = "import atexit, gc, sys; atexit.register(lambda: print(gc.get_freeze_count() > 10_000))\n"
    program += "import sceniris_gym.__main__ as program; sys.argv = ['', '--version']; program.main()"
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[1:] == ["True"]


def handles(process: subprocess.Popen, number: int) -> bool:
    """Return whether a process has a handler for a signal, by the kernel's record of it."""
    caught = [
        line for line in Path(f"/proc/{process.pid}/status").read_text().splitlines() if line.startswith("SigCgt")
    ]
    return bool(int(caught[0].split()[1], 16) >> (number - 1) & 1)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux which signals are handled")
@pytest.mark.parametrize(
    ("number", "seconds"), [(signal.SIGINT, 0.0), (signal.SIGTERM, 0.1), (signal.SIGINT, 0.4), (signal.SIGTERM, 1.2)]
)
def test_a_signal_at_start_up_ends_the_program(tmp_path: Path, number: int, seconds: float):
    """While libraries are imported and a scene is compiled: the status of shells, no traceback, no files."""
    out = tmp_path / "data"
    command = [sys.executable, "-m", "sceniris_gym", "generate", "mid", "-n", "30000000", "--device", "cpu"]
    command += ["-o", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while not handles(process, signal.SIGTERM):
            time.sleep(0.005)
        time.sleep(seconds)
        process.send_signal(number)
        said = process.communicate(timeout=60)
    assert process.returncode == 128 + number, said
    assert said[0] == ""
    assert "Traceback" not in said[1]
    assert not [path for path in out.rglob("*") if path.name.endswith(".tmp")]
