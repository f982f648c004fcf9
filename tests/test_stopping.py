"""Programs that signals end: at once, with the status of shells, whatever they are doing."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

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
STOPS = [signal.SIGINT, signal.SIGTERM]


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
@pytest.mark.parametrize("number", STOPS)
def test_a_signal_ends_a_program_whatever_it_does(tmp_path: Path, number: int, busy: str):
    """Without a traceback; a file that is half written goes."""
    program = f"{START}\nend_at_signals()\nprint('ready', flush=True)\n{BUSY[busy]}"
    assert ended(program, number, tmp_path / "file") == (128 + number, "")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", STOPS)
def test_programs_that_it_started_end_too(tmp_path: Path, number: int):
    """Before the pipe to them closes, so that none complains of its end, as the one by which glfw finds its library."""
    child = "subprocess.Popen([sys.executable, '-c', 'print(1, flush=True); input()'], stdin=-1, stdout=-1)"
    begin = f"import subprocess\nchild = {child}\nchild.stdout.readline()"
    program = f"{START}\nend_at_signals()\n{begin}\nprint('ready', flush=True)\ntime.sleep(60)"
    assert ended(program, number, tmp_path / "file") == (128 + number, "")


def test_a_forked_child_ends_alone(tmp_path: Path):
    """With the status of shells; its parent hears nothing of it, and keeps its file."""
    program = f"""{START}
end_at_signals()
ready, tell = os.pipe()
with replacing(Path(sys.argv[1], "parent")) as file:
    child = os.fork()
    if not child:
        with replacing(Path(sys.argv[1], "child")):
            os.write(tell, b"1")
            time.sleep(60)
    os.read(ready, 1)
    os.kill(child, signal.SIGTERM)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), os.listdir(file.parent) == [file.name], flush=True)
    time.sleep(60)
"""
    command = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"{128 + signal.SIGTERM} True\n"
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.2)
        process.kill()


@pytest.mark.parametrize("number", STOPS)
def test_processes_of_multiprocessing_end_too(tmp_path: Path, number: int):
    """They would work on for nobody, and say so."""
    (tmp_path / "work.py").write_text("import time\ndef work(far):\n    far.send(0)\n    time.sleep(60)\n")
    program = f"""{START}
import multiprocessing
sys.path.append(sys.argv[1])
from work import work
end_at_signals()
context = multiprocessing.get_context("spawn")
near, far = context.Pipe()
context.Process(target=work, args=[far]).start()
far.close()
near.recv()
print("ready", flush=True)
time.sleep(60)
"""
    assert ended(program, number, tmp_path) == (128 + number, "")


def test_a_signal_that_is_ignored_stays_ignored(tmp_path: Path):
    """As `nohup` and background jobs ask for."""
    program = f"""{START}
signal.signal(signal.SIGINT, signal.SIG_IGN)
end_at_signals()
os.kill(os.getpid(), signal.SIGINT)
time.sleep(0.2)
print("went on")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "went on\n"


def test_no_file_is_made_while_a_signal_is_answered(tmp_path: Path):
    """The removal of one file takes half a second, in which the main thread would make others."""
    program = f"""{START}
end_at_signals()
unlink = Path.unlink
with replacing(Path(sys.argv[1])) as file:
    Path.unlink = lambda path, **options: (path == file and time.sleep(0.5), unlink(path, **options))
    print("ready", flush=True)
    time.sleep(0.2)
    with replacing(Path(sys.argv[1] + "2")), replacing(Path(sys.argv[1] + "3")):
        time.sleep(60)
"""
    assert ended(program, signal.SIGTERM, tmp_path / "file") == (128 + signal.SIGTERM, "")
    assert not list(tmp_path.glob(".*"))
