"""Progress bars on stderr, one after another, for work that takes more than a moment."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from sceniris_gym.progress import listening

_SOON = 1.0  # s, in which most work is over and needs no bar


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
