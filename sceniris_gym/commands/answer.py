"""Output of commands: results and a verdict on stdout, warnings and errors of the operating system on stderr."""

import os
import sys
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from sceniris_gym.files import UNWRITABLE, as_json

OK = "ok"
"""Key of the verdict in findings."""


class Answer(NamedTuple):
    """Text for stdout, and the verdict that decides the exit status."""

    text: str
    ok: bool = True


def listing(found: Mapping[str, Any]) -> str:
    """Return findings as text, one per line. The parts of a list or mapping are separated by commas."""
    lines = []
    for name, value in found.items():
        parts = [f"{key} {part}" for key, part in value.items()] if isinstance(value, Mapping) else value
        lines.append(f"{name:<24}{', '.join(parts) if isinstance(parts, list) else parts}")
    return "\n".join(lines)


def answer(found: Mapping[str, Any], json: bool, report: Callable[[Any], str] = listing) -> Answer:
    """Return findings as one line of JSON, or as text from `report`."""
    return Answer(as_json(found) if json else report(found), found.get(OK, True))


def print_text(text: str) -> None:
    """Print a text to stdout. If the reader has ended, as `head` does, the text is dropped."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that Python can flush stdout at its end


def verdict(found: Mapping[str, Any], text: str) -> str:
    """Return the first line of a report: the verdict, then `text`."""
    return f"{'ok' if found[OK] else 'FAIL'}: {text}"


def each_once() -> Callable[..., None]:
    """Return a `warnings.showwarning` that prints each text once, on one line."""
    printed: set[str] = set()

    def show(message: Warning | str, *_: object) -> None:
        text = "; ".join(str(message).splitlines())
        if text not in printed:
            printed.add(text)
            print(f"warning: {text}", file=sys.stderr, flush=True)

    return show


def join_warnings() -> None:
    """Let MuJoCo warn as Python does, so that `each_once` prints its warnings.

    Conflicts of attached models are left out: Python also warns about each of them, with more details.
    """
    import mujoco

    mujoco.set_mju_user_warning(lambda text: text.startswith("Attach") or warnings.warn(text, stacklevel=1))


def in_words(error: OSError) -> str:
    """Return an error of the operating system as text: the file, the reason, and a remedy."""
    file = "a file" if error.filename is None else str(error.filename)
    why = str(error) if error.strerror is None else error.strerror.lower()
    free = "Free space there, or choose another folder: --out for results, WARP_CACHE_PATH for compiled kernels."
    advice = free if error.errno in UNWRITABLE else ""
    if error.filename is not None and _is_unwritable_cache(file):
        file += ": the folder for compiled kernels cannot be written"
        advice = "Set WARP_CACHE_PATH to a folder that you can write to."
    return f"{file}: {why}. {advice}".rstrip()


def _is_unwritable_cache(file: str) -> bool:
    """Return True if Warp's kernel cache cannot be written, and `file` is the cache, or a path in or above it."""
    import warp as wp

    if not wp.config.kernel_cache_dir:
        return False
    cache, path = Path(wp.config.kernel_cache_dir), Path(file).absolute()
    concerned = path.is_relative_to(cache) or cache.is_relative_to(path)
    return concerned and not (cache.is_dir() and os.access(cache, os.W_OK))
