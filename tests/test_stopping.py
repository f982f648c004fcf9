"""Programs that signals end: at once, with the status of shells, whatever they are doing."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from sceniris_gym.stopping import temporary

START = """
import hashlib, os, signal, sys, time
from pathlib import Path
from sceniris_gym.files import replacing
from sceniris_gym.stopping import end_at_signals
"""
BUSY = {
    "a library that catches everything": """while True:
    try:
        time.sleep(60)
    except BaseException:
        pass""",
    "a call that does not return": "hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)",
    "a file that is being written": """with replacing(Path(sys.argv[1])) as file:
    os.kill(os.getpid(), NUMBER)
    time.sleep(60)""",
}
STOPS = [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")]


def stopped(command: list[str], number: int, seconds: float, stderr: int | None = None) -> tuple[int, str, str]:
    """Run a program that says when it is ready, send it a signal, and return its status, stdout after that and stderr.

    It must end within some seconds.
    """
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        try:
            said = process.communicate(timeout=seconds)
        finally:
            process.kill()
    return process.returncode, *said


def ended(program: str, number: int, path: Path) -> tuple[int, str]:
    """Return the status and the stderr of a program that is ready, and then gets a signal."""
    command = [sys.executable, "-c", program.replace("NUMBER", str(int(number))), str(path)]
    status, _, said = stopped(command, number, 30.0, subprocess.PIPE)
    return status, said


@pytest.mark.parametrize("busy", BUSY)
@pytest.mark.parametrize(("number", "word"), STOPS)
def test_a_signal_ends_a_program_whatever_it_does(tmp_path: Path, number: int, word: str, busy: str):
    """One line on stderr and no traceback; a file that is half written goes."""
    program = f"{START}\nend_at_signals('it')\nprint('ready', flush=True)\n{BUSY[busy]}"
    assert ended(program, number, tmp_path / "file") == (128 + number, f"\nit: {word}\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("number", "word"), STOPS)
@pytest.mark.parametrize("closed", ["2>&-", "2> >(true)"], ids=["closed", "read by nobody"])
def test_a_program_without_stderr_ends_too(number: int, word: str, closed: str):
    """Its line is lost, and nothing else: a signal ends it at once."""
    program = f"{START}\nend_at_signals('it')\nprint('ready', flush=True)\ntime.sleep(60)"
    command = ["bash", "-c", f'exec "$0" -c "$1" {closed}', sys.executable, program]
    status, said, _ = stopped(command, number, 5.0)
    assert status == 128 + number
    assert word not in said


def test_a_program_whose_stderr_is_full_ends_too():
    """A pipe that is open and never read: the line would wait for ever."""
    program = f"""{START}
reader, full = os.pipe()
os.set_blocking(full, False)
try:
    while True:
        os.write(full, bytes(4096))
except BlockingIOError:
    os.set_blocking(full, True)
os.dup2(full, 2)
end_at_signals("it")
print("ready", flush=True)
time.sleep(60)
"""
    assert stopped([sys.executable, "-c", program], signal.SIGTERM, 5.0)[0] == 128 + signal.SIGTERM


def test_a_forked_child_ends_as_ever(tmp_path: Path):
    """By the signal itself; its parent hears nothing of it."""
    program = f"""{START}
end_at_signals("it")
ready, tell = os.pipe()
child = os.fork()
if not child:
    os.write(tell, b"1")
    time.sleep(60)
    os._exit(0)
os.read(ready, 1)
os.kill(child, signal.SIGTERM)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"{-signal.SIGTERM}\n"
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.2)
        process.kill()


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks Linux for the children of a process")
@pytest.mark.parametrize(("number", "word"), STOPS)
def test_processes_that_were_started_end_too(tmp_path: Path, number: int, word: str):
    """They would work on for nobody, and say so."""
    program = f"""{START}
import subprocess
child = "import time; print('ready', flush=True); time.sleep(1); print('for nobody', flush=True)"
end_at_signals("it")
process = subprocess.Popen([sys.executable, "-c", child], stdout=subprocess.PIPE)
process.stdout.readline()
print("ready", flush=True)
time.sleep(60)
"""
    assert ended(program, number, tmp_path) == (128 + number, f"\nit: {word}\n")


def test_a_signal_that_is_ignored_stays_ignored(tmp_path: Path):
    """As `nohup` and background jobs ask for."""
    program = f"""{START}
signal.signal(signal.SIGINT, signal.SIG_IGN)
end_at_signals("it")
os.kill(os.getpid(), signal.SIGINT)
time.sleep(0.2)
print("went on")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "went on\n"


def test_what_is_made_while_a_signal_is_answered_does_not_stay(tmp_path: Path):
    """The removal of one thing takes half a second; the next one is to be made within it."""
    program = f"""{START}
import threading
from sceniris_gym.stopping import temporary
heard = threading.Event()
end_at_signals("it")
with temporary(lambda: None, lambda _: (heard.set(), time.sleep(0.5))):
    print("ready", flush=True)
    heard.wait()
    with replacing(Path(sys.argv[1])):
        time.sleep(60)
"""
    assert ended(program, signal.SIGTERM, tmp_path / "file") == (128 + signal.SIGTERM, "\nit: terminated\n")
    assert not list(tmp_path.iterdir())


def test_a_signal_waits_for_what_is_being_made(tmp_path: Path):
    """Half a second, after which it is removed again."""
    program = f"""{START}
from sceniris_gym.stopping import temporary
def make():
    print("ready", flush=True)
    time.sleep(0.5)
    Path(sys.argv[1]).touch()
    return Path(sys.argv[1])
end_at_signals("it")
with temporary(make, Path.unlink):
    time.sleep(60)
"""
    assert ended(program, signal.SIGTERM, tmp_path / "file") == (128 + signal.SIGTERM, "\nit: terminated\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("error", [None, ValueError()])
def test_what_is_temporary_is_removed_once_in_the_end(error: Exception | None):
    """The block may end well or not."""
    removed = []
    with contextlib.suppress(ValueError), temporary(lambda: 7, removed.append) as made:
        assert made == 7
        assert not removed
        if error:
            raise error
    assert removed == [7]
