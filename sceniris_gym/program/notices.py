"""Warnings about a scene, issued where they come up and written down for when the scene is taken from the cache."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from sceniris_gym import errors

_noted: ContextVar[list[UserWarning] | None] = ContextVar("noted", default=None)


def warn(warning: UserWarning, stacklevel: int = 1) -> None:
    """Issue a warning as `warnings.warn` does, and note it for `noting`."""
    noted = _noted.get()
    if noted is not None:
        noted.append(warning)
    warnings.warn(warning, stacklevel=stacklevel + 1)


@contextmanager
def noting() -> Iterator[list[UserWarning]]:
    """Yield a list that gets all warnings which this thread issues by `warn` inside of the block."""
    noted: list[UserWarning] = []
    token = _noted.set(noted)
    try:
        yield noted
    finally:
        _noted.reset(token)


def to_words(warning: UserWarning) -> list:
    """A warning as what JSON can hold: the name of its class, and the arguments that make it again."""
    _, arguments = warning.__reduce__()[:2]
    return [type(warning).__name__, list(arguments)]


def from_words(words: list) -> UserWarning:
    """The warning that `to_words` was given.

    Raises:
        ValueError: The words name no warning of this package.
    """
    name, arguments = words
    kind = getattr(errors, name, None)
    if not (isinstance(kind, type) and issubclass(kind, UserWarning)):
        raise ValueError(f"'{name}' is no warning of this package")
    return kind(*arguments)
