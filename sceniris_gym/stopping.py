"""Ctrl-C and SIGTERM end the program at once, during any work.

The signals raise no exception, because some libraries would catch an exception during their import, and because Python
would not raise it until the running C function returns. Instead a thread receives the signal, ends child processes,
removes temporary files, and exits.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_PATIENCE = 2.0  # [s] to wait for a file system or a reader of standard error that does not respond
_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
# Global, because signals belong to the process: the thread that handles one has to find all temporary objects.
_temporary: dict[Any, Callable[[Any], object]] = {}
_making = threading.Lock()
"""Held while a temporary object is made or removed. The thread that handles a signal never releases it."""


@contextmanager
def temporary(make: Callable[[], Any], remove: Callable[[Any], object]) -> Iterator[Any]:
    """Yield the result of `make`, and `remove` it at the end of the block or when a signal ends the program.

    Raises:
        Exception: From `make` or `remove`.
    """
    with _making:
        made = make()
        _temporary[made] = remove
    try:
        yield made
    finally:
        with _making:
            _temporary.pop(made)(made)


def end_at_signals(name: str) -> None:
    """Let SIGINT and SIGTERM end this process from now on, with status 128 + signal, as in a shell.

    A line on standard error reports the signal. Ignored signals stay ignored, such as Ctrl-C for a background job.

    Args:
        name: The program's name in that line.
    """
    heard, tell = os.pipe()
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    heeded = [number for number in _WORDS if signal.getsignal(number) is not signal.SIG_IGN]
    # Python writes the number of a signal to the pipe before it calls this handler
    former = {number: signal.signal(number, lambda *_: None) for number in heeded}
    threading.Thread(target=_end, args=(heard, name), daemon=True).start()

    def forget() -> None:
        """Restore the usual handlers in a forked child, which has the pipe of signals but no thread that reads it."""
        signal.set_wakeup_fd(-1)
        for number, handler in former.items():
            signal.signal(number, handler)

    os.register_at_fork(after_in_child=forget)


def _end(heard: int, name: str) -> None:
    """Wait for a signal, then end the process."""
    while (number := os.read(heard, 1)[0]) not in _WORDS:
        pass
    threading.Timer(_PATIENCE, os._exit, [128 + number]).start()
    for file in Path("/proc/self/task").glob("*/children"):
        with suppress(OSError):
            for child in file.read_text().split():
                os.kill(int(child), signal.SIGKILL)
    _making.acquire()
    for made, remove in _temporary.items():
        with suppress(Exception):
            remove(made)
    if sys.__stderr__ is not None:
        with suppress(OSError):
            os.write(2, f"\n{name}: {_WORDS[signal.Signals(number)]}\n".encode())
    os._exit(128 + number)
