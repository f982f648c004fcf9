"""Progress of long work: code reports it by `tell`, `listening` receives it, and `shown` prints it to stderr."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Progress = Callable[[str, int, int], object]
"""Called with the name of the work, the number of finished parts, and the total number of parts."""

_SOON = 1.0  # s. Most work ends earlier, and needs no bar.
_PAUSE = 3.0  # s between two lines of a log, or a tenth of the time of the same work so far, if that is longer
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
    if (listener := _listener.get()) is not None:
        listener(what, done, total)


@contextmanager
def shown(quiet: bool = False) -> Iterator[None]:
    """Show the progress of this block's work, such as `compile_scene`: on a terminal a bar, otherwise lines.

    If a listener is set already, only it receives the progress.
    """
    if _listener.get() is not None:
        yield
        return
    if quiet or not sys.stderr.isatty():
        with listening((lambda *_: None) if quiet else _in_lines()):
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


def _in_lines() -> Progress:
    """Return a listener that prints a line after some seconds of silence."""
    since: dict[str, float] = {}
    last = time.monotonic()

    def show(what: str, done: int, total: int) -> None:
        nonlocal since, last
        now = time.monotonic()
        since = {what: since.get(what, now)}
        if done < total and now - last > max(_PAUSE, 0.1 * (now - since[what])):
            last = now
            print(f"sceniris_gym: {what}: {done} of {total}", file=sys.stderr, flush=True)

    return show
