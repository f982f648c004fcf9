"""Files that are either whole or not there."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sceniris_gym.errors import NotSupportedError, OutputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give the path of a temporary file beside `path`, which takes its place if the block ends well.

    If the block does not, not even by the user's Ctrl-C, the temporary file is removed and `path` stays as it was.

    Raises:
        OutputError: there can be no such file
    """
    temporary = _temporary(path)
    try:
        yield temporary
        temporary.chmod(0o644)
        with _in_words(path):
            os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def check_writable(path: Path) -> None:
    """Make sure that `path` can be written, before the work whose result it is to hold. Leaves nothing behind.

    Raises:
        OutputError: it cannot
    """
    if path.is_dir():
        raise OutputError(str(path), "it is a folder")
    folder = next(folder for folder in path.parents if folder.exists())
    _temporary(folder / path.name).unlink()


def check_picture(path: Path) -> None:
    """Make sure that `path` can be written, and is that of a PNG.

    Raises:
        NotSupportedError: it has another suffix
        OutputError: it cannot
    """
    if path.suffix.lower() != ".png":
        raise NotSupportedError(f"{path}: pictures are written as PNG. Give a path that ends with .png.")
    check_writable(path)


def _temporary(path: Path) -> Path:
    with _in_words(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    os.close(handle)
    return Path(name)


@contextmanager
def _in_words(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(str(path), (error.strerror or str(error)).lower()) from error
