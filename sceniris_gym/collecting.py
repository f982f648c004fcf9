"""Imports of large libraries without garbage collection."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Collect no garbage in this block.

    Warp keeps the syntax trees of all kernels, for MuJoCo-Warp half a million objects. The collector would walk them
    several times while they are made, which takes a second. Freezing and unfreezing all objects in the end moves them
    to its oldest generation at once. Objects that a program has frozen itself stay frozen.
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
