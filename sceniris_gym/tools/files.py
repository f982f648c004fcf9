"""Writes files completely or not at all, and checks beforehand that they can be written."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sceniris_gym.errors import NotSupportedError, OutputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file beside `path`, which replaces `path` if the block succeeds.

    If it fails, or the user presses Ctrl-C, the temporary file is removed and `path` stays as it was.

    Raises:
        OutputError: The file cannot be written.
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
    """Make sure that `path` can be written, before the work whose result it will hold. Leaves nothing behind.

    Raises:
        OutputError: It cannot.
    """
    if path.is_dir():
        raise OutputError(str(path), "it is a folder")
    folder = next(folder for folder in path.parents if folder.exists())
    _temporary(folder / path.name).unlink()


def check_picture(path: Path) -> None:
    """Make sure that `path` ends in .png and can be written.

    Raises:
        NotSupportedError: It has another suffix.
        OutputError: It cannot.
    """
    if path.suffix.lower() != ".png":
        raise NotSupportedError(f"{path}: a picture should be a PNG. Give a path that ends in .png.")
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
