"""Warnings about a scene. They point at the user's line, and are stored so that a cached scene repeats them."""

import os
import sys
import sysconfig
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from sceniris_gym import errors

# Files of this package, and of libraries that call it for the user, such as Gymnasium.
_OTHERS = (os.path.join(os.path.dirname(errors.__file__), ""), sysconfig.get_path("purelib"))
# A context variable, because a warning is issued far below the compilation that stores it, in the same thread.
_noted: ContextVar[list[UserWarning] | None] = ContextVar("noted", default=None)


def warn(warning: UserWarning) -> None:
    """Issue a warning that points at the user's line, not at a library's. Inside a `noting` block, also collect it."""
    noted = _noted.get()
    if noted is not None:
        noted.append(warning)
    level, frame = 1, sys._getframe()
    while frame is not None and frame.f_code.co_filename.startswith(_OTHERS):
        level, frame = level + 1, frame.f_back
    warnings.warn(warning, stacklevel=level)


@contextmanager
def noting() -> Iterator[list[UserWarning]]:
    """Yield a list that collects all warnings that this thread issues through `warn` inside the block.

    At the end of a block inside another block, the list of the other block gets them too.
    """
    noted: list[UserWarning] = []
    token = _noted.set(noted)
    try:
        yield noted
    finally:
        _noted.reset(token)
        if (outer := _noted.get()) is not None:
            outer += noted


def to_record(warning: UserWarning) -> list:
    """Return a warning as JSON values: the name of its class, and the arguments of its constructor."""
    _, arguments = warning.__reduce__()[:2]
    return [type(warning).__name__, list(arguments)]


def from_record(record: list) -> UserWarning:
    """Return the warning that a record from `to_record` describes.

    Raises:
        ValueError: The record does not name a warning of this package.
    """
    name, arguments = record
    kind = getattr(errors, name, None)
    if not (isinstance(kind, type) and issubclass(kind, UserWarning)):
        raise ValueError(f"'{name}' is not a warning of this package")
    return kind(*arguments)
