"""Counts of the layouts that keep the relations, orientations and groups of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Excess = dict[tuple[str, str, str], np.ndarray]
"""(Name, word, unit) -> violation in each row, NaN where the requirement does not apply, shape (nrow,)."""
TOLERANCES = {"m": 1e-4, "rad": 1e-3, "objects": 0.0}


@dataclass(frozen=True)
class Kept:
    """Counts for one requirement of an object or a group.

    Attributes:
        name: The object or the group.
        word: The relation (its index among the object's relations, and its word), or a part of the orientation or of
            the group.
        unit: "m", "rad" or "objects".
        checked: Number of rows in which it applies.
        broken: Number of rows with a violation above the tolerance of the unit.
        worst: Largest violation, in the unit; at most 0 if there is none.
        row: The row with the largest violation, -1 if the requirement applies nowhere.
    """

    name: str
    word: str
    unit: str
    checked: int
    broken: int
    worst: float
    row: int


def count(found: Sequence[Excess]) -> list[Kept]:
    """Count the rows that keep each requirement, from the violations in each chunk of rows."""
    return [_counted(key, np.concatenate([chunk[key] for chunk in found])) for key in (found[0] if found else ())]


def _counted(key: tuple[str, str, str], amount: np.ndarray) -> Kept:
    applies = ~np.isnan(amount)
    amount = np.where(applies, amount, -np.inf)
    row = int(amount.argmax()) if applies.any() else -1
    broken = int((amount > TOLERANCES[key[-1]]).sum())
    return Kept(*key, int(applies.sum()), broken, float(amount.max(initial=-np.inf)), row)
