"""Imports of large libraries without garbage collection."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Disable garbage collection in this block.

    Warp keeps the syntax trees of all kernels: half a million objects for MuJoCo-Warp. While Warp builds the trees, the
    collector would visit these objects several times, which takes a second. At the end of the block, freezing and
    unfreezing moves all objects to the oldest generation at once. This step is left out if the program itself
    has frozen objects.
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
