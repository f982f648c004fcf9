"""Counts of the layouts that keep the relations, orientations and groups of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

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
            start: Index of the first row.
            poses: Poses in the rows.
            present: Object name -> rows in which it is present, shape (nrow,).
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
    """Return the counts with rows from `start` on added: their violations `amount` (nrow,), NaN where none applies."""
    applies = ~np.isnan(amount)
    if not applies.any():
        return kept
    row = int(np.nanargmax(amount))
    if amount[row] > kept.worst:
        kept = replace(kept, worst=float(amount[row]), row=start + row)
    broken = int((amount[applies] > TOLERANCES[kept.unit]).sum())
    return replace(kept, checked=kept.checked + int(applies.sum()), broken=kept.broken + broken)
