"""Ctrl-C and SIGTERM end a program at once, whatever it is doing.

An exception would not: libraries that are being imported catch it, and one that is thrown into them half-way leaves
them broken. So a thread hears of the signal, ends the processes that this one has started, removes what must not stay
behind, and ends the process.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

_PATIENCE = 1.0  # [s] for a file system, or a reader of standard error, that does not answer
_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
_temporary: dict[object, Callable[[], object]] = {}
_making = threading.Lock()
"""Held while something temporary is made or removed; whoever answers a signal takes it and never gives it back."""


@contextmanager
def temporary(make: Callable[[], T], remove: Callable[[T], object]) -> Iterator[T]:
    """Yield what `make` returns and `remove` it in the end, or when the program is stopped by a signal.

    What was made is never without somebody to remove it: a signal waits until `make` has returned, and nothing is made
    any more once one is being answered.

    Raises:
        Exception: What `make` and `remove` raise.
    """
    key = object()
    with _making:
        made = make()
        _temporary[key] = lambda: remove(made)
    try:
        yield made
    finally:
        with _making:
            _temporary.pop(key)()


@contextmanager
def ending_at_signals(name: str) -> Iterator[None]:
    """Let SIGINT and SIGTERM end the process within the block, with a line on stderr and 128 + signal, as shells do.

    The line goes to what is standard error now, even if that is redirected later. A signal that is ignored, as Ctrl-C
    is for a shell's background jobs, stays ignored.

    Args:
        name: The program, for that line.
    """
    stderr = _standard_error()
    heard, tell = os.pipe()
    os.set_blocking(tell, False)
    kept = {number: signal.getsignal(number) for number in _WORDS}
    before = signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    for number, handler in kept.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, _nothing)  # Python writes to the pipe before it gets to this
    threading.Thread(target=_listen, args=(heard, stderr, name), name="signals", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        for number, handler in kept.items():
            signal.signal(number, handler)
        os.close(tell)


def _standard_error() -> int:
    """Return a duplicate descriptor of what is standard error now; of nothing where that is closed."""
    try:
        return os.dup(2)
    except OSError:
        return os.open(os.devnull, os.O_WRONLY)


def _nothing(*_: object) -> None:
    pass


def _in_child() -> None:
    """Let signals end a forked child as ever: the thread that hears of them is its parent's, and the pipe is, too."""
    global _making
    _making = threading.Lock()  # another thread of the parent may have held it
    if signal.getsignal(signal.SIGTERM) is _nothing:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if signal.getsignal(signal.SIGINT) is _nothing:
        signal.signal(signal.SIGINT, signal.default_int_handler)


os.register_at_fork(after_in_child=_in_child)


def _end_children() -> None:
    """End processes that this one has started, such as glfw's, which tell at length that nobody reads their answer."""
    for file in Path("/proc/self/task").glob("*/children"):
        with contextlib.suppress(OSError):
            for child in file.read_text().split():
                os.kill(int(child), signal.SIGKILL)


def _remove_temporary() -> None:
    _making.acquire(timeout=_PATIENCE)
    for remove in list(_temporary.values()):
        with contextlib.suppress(Exception):
            remove()


def _say(file: int, text: str) -> None:
    """Write a short text, unless nobody reads it."""
    room = select.poll()
    room.register(file, select.POLLOUT)
    with contextlib.suppress(OSError):
        if room.poll(1000.0 * _PATIENCE):
            os.write(file, text.encode())


def _listen(heard: int, stderr: int, name: str) -> None:
    """Wait for a signal, and end the process; or end with the block, when the other end is closed."""
    while number := os.read(heard, 1):
        if number[0] in _WORDS:
            _end_children()
            _remove_temporary()
            _say(stderr, f"\n{name}: {_WORDS[signal.Signals(number[0])]}\n")
            os._exit(128 + number[0])
    os.close(heard)
    os.close(stderr)
