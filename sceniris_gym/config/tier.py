"""Tiers of reachability: grades of proof that an arm reaches an object, and the rule of each."""

from __future__ import annotations

from enum import IntEnum
from typing import Literal

TierWord = Literal["map", "map_strict", "ik", "clear"]
"""The tiers as scene files and commands write them, from fastest to most thorough."""


class Verdict(IntEnum):
    """Answer of a map about a pose. NO, YES: all corners of its cell agree. MIXED_*: decided by interpolation."""

    NO = 0
    MIXED_NO = 1
    MIXED_YES = 2
    YES = 3


class Tier(IntEnum):
    """A grade of proof that an object is reachable."""

    MAP = 0
    """The arm's map says yes, by interpolation where the corners of a cell disagree."""
    MAP_STRICT = 1
    """The arm's map says yes at all corners around the pose."""
    IK = 2
    """Joints within limits bring the TCP within 1 mm and 0.5 degrees, and the arm does not hit itself."""
    CLEAR = 3
    """In the grasp and the pre-grasp the arm hits nothing in the layout; in the grasp the hand may touch the object."""

    @classmethod
    def of(cls, word: str) -> Tier:
        """Return the tier named by a word of `TIERS`."""
        return cls[word.upper()]

    @property
    def word(self) -> str:
        """The tier as scene files write it."""
        return self.name.lower()

    @property
    def needs_map(self) -> bool:
        """True if the arm's map alone decides, during placing; otherwise inverse kinematics decides afterwards."""
        return self < Tier.IK

    @property
    def least_verdict(self) -> Verdict:
        """The lowest verdict of the arm's map with which a candidate is kept.

        The tiers that solve inverse kinematics decide later; for them the map only rules out poses with a plain no.
        """
        return {Tier.MAP: Verdict.MIXED_YES, Tier.MAP_STRICT: Verdict.YES}.get(self, Verdict.MIXED_NO)


TIERS = tuple(tier.word for tier in Tier)
"""The words of all tiers, from fastest to most thorough."""
