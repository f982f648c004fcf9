"""The progress of long work: its author tells, whoever wants to show it listens, and a terminal gets a bar."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Progress = Callable[[str, int, int], object]
"""Called with the name of the work, the number of its parts that are done, and the number of all."""

_SOON = 1.0  # s, in which most work is over and needs no bar
# Of the thread: an argument would pass through every function between the work and its listener.
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


@contextmanager
def shown(quiet: bool = False) -> Iterator[None]:
    """Show the progress of this block's work, such as `compile_scene`; nothing where stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield
        return
    from tqdm import tqdm  # not needed where nothing is shown

    bar = tqdm(disable=True)

    def show(what: str, done: int, total: int) -> None:
        nonlocal bar
        if bar.disable or bar.desc != what:
            bar.close()
            bar = tqdm(total=total, desc=what, file=sys.stderr, unit_scale=True, delay=_SOON, leave=False)
        bar.update(done - bar.n)

    try:
        with listening(show):
            yield
    finally:
        bar.close()
