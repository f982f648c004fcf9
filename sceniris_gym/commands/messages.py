"""Messages of commands on stderr: each warning once, and readable errors of the operating system."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

from sceniris_gym.files import UNWRITABLE


def each_once() -> Callable[..., None]:
    """Return a `warnings.showwarning` that prints each text once."""
    printed: set[str] = set()

    def show(message: Warning | str, *_: object) -> None:
        if str(message) not in printed:
            printed.add(str(message))
            print(f"warning: {message}", file=sys.stderr, flush=True)

    return show


def in_words(error: OSError) -> str:
    """Return an error of the operating system as text: the file, the reason, and a remedy."""
    file = "a file" if error.filename is None else str(error.filename)
    why = str(error) if error.strerror is None else error.strerror.lower()
    if error.filename is not None and _is_unwritable_cache(file):
        return (
            f"{file}: the folder for compiled kernels cannot be written: {why}. "
            "Set WARP_CACHE_PATH to a folder that you can write to."
        )
    advice = "Free space there, or choose another folder: --out for results, WARP_CACHE_PATH for compiled kernels."
    return f"{file}: {why}. {advice if error.errno in UNWRITABLE else ''}".rstrip()


def _is_unwritable_cache(file: str) -> bool:
    """Return True if `file` is Warp's kernel cache, or in or above the cache, and the cache cannot be written."""
    import warp as wp

    if not wp.config.kernel_cache_dir:
        return False
    cache, path = Path(wp.config.kernel_cache_dir), Path(file).absolute()
    concerned = path.is_relative_to(cache) or cache.is_relative_to(path)
    return concerned and not (cache.is_dir() and os.access(cache, os.W_OK))
