"""Values that nobody should write, and that somebody will."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

WORDS = (
    *(
        "",
        " ",
        "x",
        "floor",
        "robot",
        "world",
        "anchor",
        "support",
        "apple",
        "mug",
        "shelf",
        "on",
        "any",
        "stable",
        "auto",
    ),
    *(
        "free",
        "~nosuchuser/x.xml",
        "../../../etc/passwd",
        "/dev/null",
        "a\0b",
        "a/" * 3000,
        "\ud800",
        "*",
        "[",
        "shelf/*",
    ),
    *("9" * 5000, "é" * 300, "on: floor", "!!python/object/apply:os.system ['true']", "shelf/upper_drawer", "physics"),
)
NUMBERS = (
    *(0, 1, -1, 2, 3, 10**6, 10**13, 2**31, 2**63, 2**64, -(2**63), 10**400, 10**5000),
    *(0.0, -0.0, 0.5, 1.5, 1e-6, 1e-30, 1e-320, 1e6, 1e30, 1e300, -1e30, math.nan, math.inf, -math.inf),
)


def number(draws: np.random.Generator) -> Any:
    """A number: one from the list, or one of any size."""
    if draws.random() < 0.5:
        return NUMBERS[int(draws.integers(len(NUMBERS)))]
    return float(draws.normal() * 10.0 ** draws.uniform(-4, 2))


def value(draws: np.random.Generator, depth: int = 0) -> Any:
    """Any value that YAML can write, and some that only Python can."""
    match int(draws.integers(10 if depth < 3 else 6)):
        case 0 | 1 | 2:
            return number(draws)
        case 3 | 4:
            return WORDS[int(draws.integers(len(WORDS)))]
        case 5:
            others = (None, True, False, b"bytes", np.nan, np.arange(3), np.zeros((2, 2)), object(), {1, 2}, (1,), 1j)
            return others[int(draws.integers(len(others)))]
        case 6 | 7:
            return [number(draws) for _ in range(int(draws.integers(4)))]
        case 8:
            return [value(draws, depth + 1) for _ in range(int(draws.integers(4)))]
        case _:
            keys = [str(WORDS[int(draws.integers(len(WORDS)))]) for _ in range(int(draws.integers(3)))]
            return {key: value(draws, depth + 1) for key in keys}
