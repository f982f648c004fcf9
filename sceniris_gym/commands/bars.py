"""Progress bars on stderr, one after another, for work that takes more than a moment."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from sceniris_gym.progress import Progress, listening

_SOON = 1.0  # s, in which most work is over and needs no bar


@contextmanager
def shown(quiet: bool = False) -> Iterator[None]:
    """Show how far the work of this block is, such as `compile_scene`; where stderr is no terminal, nothing."""
    if quiet or not sys.stderr.isatty():
        yield
        return
    with _bars() as show, listening(show):
        yield


@contextmanager
def _bars() -> Iterator[Progress]:
    """Yield what shows the progress that it is told, a bar for each kind of work."""
    from tqdm import tqdm  # where something is shown alone

    open_bars: dict[str, tqdm] = {}

    def show(what: str, done: int, total: int) -> None:
        if what not in open_bars:
            close()
            open_bars[what] = tqdm(total=total, desc=what, file=sys.stderr, unit_scale=True, delay=_SOON, leave=False)
        open_bars[what].update(done - open_bars[what].n)

    def close() -> None:
        for bar in open_bars.values():
            bar.close()
        open_bars.clear()

    try:
        yield show
    finally:
        close()
