"""How far long work is: whoever does it tells, and whoever wants to show it listens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Progress = Callable[[str, int, int], object]
"""Called with what is done, how many parts of it are done, and how many there are."""

_listener: ContextVar[Progress | None] = ContextVar("progress", default=None)


@contextmanager
def listening(listener: Progress) -> Iterator[None]:
    """Let `listener` hear how far the work of this block is, such as `compile_scene`."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(what: str, done: int, total: int) -> None:
    """Tell how far some work is, if anyone listens."""
    listener = _listener.get()
    if listener is not None:
        listener(what, done, total)
