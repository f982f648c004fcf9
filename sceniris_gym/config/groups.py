"""Groups of objects of which only some are present: `GroupConfig`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Strict, model_validator

from sceniris_gym.config.fields import Names, listed, wrong
from sceniris_gym.config.section import Section

_Count = Annotated[int, Strict(), Field(ge=0)]


def _both_ends(value: Any) -> Any:
    value = listed(value)
    if isinstance(value, list | tuple):
        return value
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise wrong("should be a whole number, 0 or more, or [low, high]")
    return value, value


class GroupConfig(Section):
    """Objects of which `count` are present in a world, drawn anew for every layout; the others are parked far away.

    Attributes:
        of: Names of the members.
        count: Least and greatest number of members that are present; the number is drawn uniformly, then the members.
        missing: Treatment of references to a member that may be absent: the scene is refused ('refuse'), or the
            reference is dropped in worlds without the member ('drop').
    """

    of: Annotated[Names, Field(min_length=1)]
    count: Annotated[tuple[_Count, _Count], BeforeValidator(_both_ends)]
    missing: Literal["refuse", "drop"] = "refuse"

    @property
    def always_whole(self) -> bool:
        """True if all members are present in every world."""
        return self.count[0] == len(self.of)

    @model_validator(mode="after")
    def _can_be_drawn(self) -> GroupConfig:
        low, high = self.count
        if not low <= high <= len(self.of):
            raise wrong(f"should have a 'count' k or [low, high] with 0 <= low <= high <= {len(self.of)} (all members)")
        return self
