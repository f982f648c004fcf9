"""Counts in how many layouts a scene's relations, orientations and groups are kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.audit import presence, relations
from sceniris_gym.audit.geometry import Poses
from sceniris_gym.audit.orientations import OrientationAudit
from sceniris_gym.audit.outlines import Outlines
from sceniris_gym.config.scene import SceneConfig

TOLERANCES = {"m": 1e-4, "rad": 1e-3, "objects": 0.0}


@dataclass(frozen=True)
class Kept:
    """How well one requirement of an object or a group is kept.

    Attributes:
        name: The object or the group.
        word: The relation (its index among the object's relations, and its word), or the part of the orientation or of
            the group.
        unit: "m", "rad" or "objects".
        checked: Number of rows in which it applies.
        broken: Number of rows in which it is missed by more than the tolerance of the unit.
        worst: Largest amount by which it is missed, in the unit; at most 0 if it is never missed.
        row: The row with that amount, -1 if it applies nowhere.
    """

    name: str
    word: str
    unit: str
    checked: int
    broken: int
    worst: float
    row: int


class LanguageAudit:
    """Judges relations, orientations and groups.

    Args:
        config: The scene.
        outlines: Outlines of the objects.
        hulls: Object name -> corners of its convex hull in its root's frame at home [m], shape (n, 3).
        home: The model at the start pose.
    """

    def __init__(
        self, config: SceneConfig, outlines: Outlines, hulls: Mapping[str, np.ndarray], home: mujoco.MjData
    ) -> None:
        self.config, self.outlines = config, outlines
        self._turns = OrientationAudit(config, outlines, hulls, home)

    def add(self, kept: list[Kept], start: int, poses: Poses, present: Mapping[str, np.ndarray]) -> list[Kept]:
        """Judge some rows, and return the counts with these rows added.

        Args:
            kept: The counts so far, empty at first.
            start: Index of the first of these rows.
            poses: Poses in these rows.
            present: Object name -> rows in which it is there, shape (nrow,).
        """
        seen = self.outlines.see(poses, present)
        found = [
            *relations.excess(self.outlines, seen).items(),
            *self._turns.excess(seen).items(),
            *presence.excess(self.config, seen).items(),
        ]
        before = kept or [Kept(*key, 0, 0, -np.inf, -1) for key, _ in found]
        return [_counted(k, start, amount) for k, (_, amount) in zip(before, found, strict=True)]


def _counted(kept: Kept, start: int, amount: np.ndarray) -> Kept:
    """Return the counts with rows from `start` on added.

    They miss the requirement by `amount` (nrow,), which is NaN where it does not apply.
    """
    applies = ~np.isnan(amount)
    if not applies.any():
        return kept
    row = int(np.nanargmax(amount))
    worse = amount[row] > kept.worst
    return Kept(
        kept.name,
        kept.word,
        kept.unit,
        kept.checked + int(applies.sum()),
        kept.broken + int((amount[applies] > TOLERANCES[kept.unit]).sum()),
        float(amount[row]) if worse else kept.worst,
        start + row if worse else kept.row,
    )
