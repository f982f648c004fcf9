"""Numbers of worlds and other counts as users pass them, checked once."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import Any, SupportsIndex

from sceniris_gym.config.messages import short
from sceniris_gym.errors import CountError

MOST_WORLDS = 1 << 24
"""Upper limit of worlds in a batch: far more than fit on any GPU with a scene of a few objects."""


def as_shape(shape: SupportsIndex | Sequence[SupportsIndex], name: str) -> tuple[int, ...]:
    """Return a shape, given as a sequence or as the length of its only axis.

    Raises:
        CountError: A length that is no integer of at least 0, or too many numbers.
    """
    found = tuple(as_count(n, name, 0) for n in (shape if isinstance(shape, Sequence) else (shape,)))
    as_count(math.prod(found), name, 0)
    return found


def as_count(value: Any, name: str, least: int = 1, most: int = MOST_WORLDS) -> int:
    """Return an integer of any library as an int.

    Raises:
        CountError: Not an integer, or one outside of `least` to `most`.
    """
    try:
        count = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        count = None
    if count is None:
        raise CountError(f"{name} should be an integer of at least {least}, got {short(value)}.")
    if not least <= count <= most:
        bound = f"an integer of at least {least}" if count < least else f"at most {most}"
        got = str(count) if abs(count) < 1 << 128 else "a number of more than 38 digits"
        raise CountError(f"{name} should be {bound}, got {got}.")
    return count
