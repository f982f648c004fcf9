"""Tiers: tests of whether an arm can reach an object."""

from enum import IntEnum
from typing import Literal, Self

TierWord = Literal["map", "map_strict", "ik", "clear", "path"]
"""The tiers as words of scene files and commands, from fastest to most thorough."""


class Verdict(IntEnum):
    """A map's verdict on a pose.

    NO and YES: all corners of the map's cell around the pose agree. MIXED_NO and MIXED_YES: interpolation decided.
    """

    NO = 0
    MIXED_NO = 1
    MIXED_YES = 2
    YES = 3


class Tier(IntEnum):
    """A test of whether an arm can reach an object. Higher values are more thorough tests."""

    MAP = 0
    """The arm's map has a positive verdict, by interpolation if the corners of a cell disagree."""
    MAP_STRICT = 1
    """The arm's map is positive at all corners around the pose."""
    IK = 2
    """Joints within limits bring the TCP within 1 mm and 0.5 degrees, without self-collision of the arm."""
    CLEAR = 3
    """In grasp and pre-grasp, the arm does not collide with the layout. In the grasp, the hand may touch the object."""
    PATH = 4
    """As `CLEAR`, and a polyline in joint space leads from the start pose to the grasp without collisions."""

    @classmethod
    def of(cls, word: str) -> Self:
        """Return the tier whose name in scene files is `word`, such as 'ik'."""
        return cls[word.upper()]

    @property
    def word(self) -> str:
        """The tier's name in scene files, such as 'ik'."""
        return self.name.lower()

    @property
    def needs_map(self) -> bool:
        """True if only the arm's map decides, during placement. Otherwise inverse kinematics decides afterwards."""
        return self < Tier.IK

    @property
    def least_verdict(self) -> Verdict:
        """The lowest verdict of the arm's map at which a candidate is kept.

        Tiers with inverse kinematics decide later. For them, the map only rules out poses with the verdict NO.
        """
        return {Tier.MAP: Verdict.MIXED_YES, Tier.MAP_STRICT: Verdict.YES}.get(self, Verdict.MIXED_NO)


TIERS = tuple(tier.word for tier in Tier)
"""The words of all tiers, from fastest to most thorough."""
