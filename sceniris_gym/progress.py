"""Progress of long work: code reports it by `tell`, `listening` receives it, and `shown` draws a bar on a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Progress = Callable[[str, int, int], object]
"""Called with the name of the work, the number of finished parts, and the total number of parts."""

_SOON = 1.0  # s. Most work ends earlier, and needs no bar.
# A context variable, because an argument would have to pass through every function between work and listener.
_listener: ContextVar[Progress | None] = ContextVar("progress", default=None)


@contextmanager
def listening(listener: Progress) -> Iterator[None]:
    """Call `listener` with the progress of the work in this block, such as `compile_scene`."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(what: str, done: int, total: int) -> None:
    """Report the progress of some work to the listener, if one is set.

    If no part is finished, `shown` draws the bar at once. Report this before a part that may take long.
    """
    listener = _listener.get()
    if listener is not None:
        listener(what, done, total)


@contextmanager
def shown(quiet: bool = False) -> Iterator[None]:
    """Show a progress bar for this block's work, such as `compile_scene`, if stderr is a terminal.

    If a listener is set already, it receives the progress, and there is no bar.
    """
    if quiet or _listener.get() is not None or not sys.stderr.isatty():
        yield
        return
    from tqdm import tqdm  # imported only where a bar is shown

    bar = tqdm(disable=True)

    def show(what: str, done: int, total: int) -> None:
        nonlocal bar
        if bar.disable or bar.desc != what:
            bar.close()
            bar = tqdm(total=total, desc=what, unit_scale=total >= 1000, delay=_SOON if done else 0.0, leave=False)
        bar.update(done - bar.n)

    try:
        with listening(show):
            yield
    finally:
        bar.close()
