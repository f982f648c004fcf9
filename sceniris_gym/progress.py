"""The progress of long work: its author tells, and whoever wants to show it listens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Progress = Callable[[str, int, int], object]
"""Called with the name of the work, the number of its parts that are done, and the number of all."""

_listener: ContextVar[Progress | None] = ContextVar("progress", default=None)


@contextmanager
def listening(listener: Progress) -> Iterator[None]:
    """Let `listener` hear the progress of the work in this block, such as `compile_scene`."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(what: str, done: int, total: int) -> None:
    """Tell the progress of some work, if anyone listens."""
    listener = _listener.get()
    if listener is not None:
        listener(what, done, total)
