"""Imports of large libraries, during which the garbage collector does not walk what they make."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Let no garbage be collected in this block.

    Warp keeps the syntax trees of all kernels: half a million objects for those of MuJoCo-Warp. While they are made,
    the collector would walk them several times, which takes a second. To freeze and unfreeze all objects at the end
    puts them into its oldest generation at once; where a program has frozen some itself, they stay frozen.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():
            gc.freeze()
            gc.unfreeze()
        if collecting:
            gc.enable()
