"""Confidence intervals of shares; imported by what draws results too, without anything heavy."""

from __future__ import annotations

import math


def wilson(successes: int, number: int, z: float = 1.96) -> tuple[float, float]:
    """Return the ends of the Wilson interval of a share, by default of 95% (Wilson 1927)."""
    if number == 0:
        return 0.0, 1.0
    share, extra = successes / number, z * z / number
    middle = (share + extra / 2) / (1 + extra)
    half = z * math.sqrt(share * (1 - share) / number + extra / (4 * number)) / (1 + extra)
    return max(0.0, middle - half), min(1.0, middle + half)
