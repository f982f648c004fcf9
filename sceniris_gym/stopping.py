"""Ctrl-C and SIGTERM end the program at once, during any work.

The signals raise no exception, because some libraries would catch an exception during their import, and because Python
would not raise it until the running C function returns. Instead a thread receives the signal, ends the processes that
this process has started, removes temporary files, and exits.
"""

import multiprocessing
import os
import signal
import threading
from contextlib import suppress
from pathlib import Path


def end_at_signals(numbers: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM)) -> None:
    """Let these signals end this process and its forks from now on, with status 128 + signal, as in a shell.

    Ignored signals stay ignored, such as Ctrl-C for a background job.
    """
    heard, tell = os.pipe()
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    for number in numbers:
        if signal.getsignal(number) is not signal.SIG_IGN:
            # Python writes the number to the pipe, then calls this handler: the main thread makes no more files
            signal.signal(number, lambda *_: signal.pause())
    threading.Thread(target=_end, args=(heard, numbers), daemon=True).start()
    # a fork has its parent's pipe, and no thread that reads it
    os.register_at_fork(after_in_child=end_at_signals)


def _end(heard: int, numbers: tuple[int, ...]) -> None:
    """Wait for one of the signals, then end the process."""
    while (number := os.read(heard, 1)[0]) not in numbers:
        pass
    for child in multiprocessing.active_children():
        child.kill()
    # a library may wait for a program that it has started, whose complaint about the end would be the last line
    for children in Path("/proc/self/task").glob("*/children"):
        for child in children.read_text().split():
            with suppress(OSError):
                os.kill(int(child), signal.SIGKILL)
    for file in Path("/proc/self/fd").glob("*"):
        with suppress(OSError):
            if (path := file.readlink()).match(f".*-{os.getpid()}.*.tmp"):  # as `files.replacing` names them
                path.unlink()
    os._exit(128 + number)
