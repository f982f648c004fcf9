"""Warnings about a scene: issued at the caller's line, and noted for when the scene is taken from the cache."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from sceniris_gym import errors

_PACKAGE = os.path.join(os.path.dirname(errors.__file__), "")
# Of the thread: a warning is noted far below the compilation that keeps it.
_noted: ContextVar[list[UserWarning] | None] = ContextVar("noted", default=None)


def warn(warning: UserWarning) -> None:
    """Issue a warning at the line that called this package, and note it for `noting`."""
    noted = _noted.get()
    if noted is not None:
        noted.append(warning)
    level, frame = 1, sys._getframe()
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    warnings.warn(warning, stacklevel=level)


@contextmanager
def noting() -> Iterator[list[UserWarning]]:
    """Yield a list that collects all warnings which this thread issues by `warn` inside of the block."""
    noted: list[UserWarning] = []
    token = _noted.set(noted)
    try:
        yield noted
    finally:
        _noted.reset(token)


def to_words(warning: UserWarning) -> list:
    """Return a warning as JSON can hold it: the name of its class, and the arguments that make it again."""
    _, arguments = warning.__reduce__()[:2]
    return [type(warning).__name__, list(arguments)]


def from_words(words: list) -> UserWarning:
    """Return the warning that `to_words` was given.

    Raises:
        ValueError: The words name no warning of this package.
    """
    name, arguments = words
    kind = getattr(errors, name, None)
    if not (isinstance(kind, type) and issubclass(kind, UserWarning)):
        raise ValueError(f"'{name}' is no warning of this package")
    return kind(*arguments)
