"""How thoroughly it is proven that an arm reaches something: the tiers, and the rule of each."""

from __future__ import annotations

from enum import IntEnum
from typing import Literal

TierWord = Literal["map", "map_strict", "ik", "clear"]
"""The tiers as scene files and commands write them, from quick to thorough."""


class Verdict(IntEnum):
    """What a map says of a pose. NO and YES: all corners of its cell agree. MIXED: decided between them."""

    NO = 0
    MIXED_NO = 1
    MIXED_YES = 2
    YES = 3


class Tier(IntEnum):
    """How thoroughly an object is proven to be reachable."""

    MAP = 0
    """The arm's map says yes, or by majority yes: for shaping."""
    MAP_STRICT = 1
    """The arm's map says yes all around."""
    IK = 2
    """There are joints within limits, 1 mm and 0.5 degrees, in which the arm does not hit itself."""
    CLEAR = 3
    """The arm in those joints and its pre-grasp hit nothing of the finished layout but the object."""

    @classmethod
    def of(cls, word: str) -> Tier:
        """Return the tier of a word of `TIERS`."""
        return cls[word.upper()]

    @property
    def word(self) -> str:
        """The tier as scene files write it."""
        return self.name.lower()

    @property
    def needs_map(self) -> bool:
        """Whether the arm's map alone decides, when an object is placed; else joints do, once all are placed."""
        return self < Tier.IK

    @property
    def least_verdict(self) -> Verdict:
        """The least verdict of the arm's map for which placing goes on.

        The tiers that ask for joints decide later, and need not be asked where the map says no all around.
        """
        match self:
            case Tier.MAP:
                return Verdict.MIXED_YES
            case Tier.MAP_STRICT:
                return Verdict.YES
        return Verdict.MIXED_NO


TIERS = tuple(tier.word for tier in Tier)
"""The words of all tiers, from quick to thorough."""
