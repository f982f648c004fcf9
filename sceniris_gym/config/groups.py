"""Groups of objects of which only some are present: `GroupConfig`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Strict, model_validator

from sceniris_gym.config.fields import Names, Number, listed, within, wrong
from sceniris_gym.config.section import Section

SPLITS = ("train", "eval")
"""The splits of layouts."""
_Weight = Annotated[Number, Field(ge=0.0), within("weight")]
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
        weights: Weights of members, 1 for all others: members are drawn one after the other without replacement, each
            with a probability in proportion to its weight among those that are left.
        splits: The only split, 'train' or 'eval', in which a member is drawn, for members that are not drawn in both.
    """

    of: Annotated[Names, Field(min_length=1)]
    count: Annotated[tuple[_Count, _Count], BeforeValidator(_both_ends)]
    missing: Literal["refuse", "drop"] = "refuse"
    weights: dict[str, _Weight] = Field(default_factory=dict)
    splits: dict[str, Literal["train", "eval"]] = Field(default_factory=dict)

    def weights_in(self, split: str) -> list[float]:
        """Return the weights of the members in a split, 'train' or 'eval'; 0 for those that are not drawn there."""
        return [self.weights.get(n, 1.0) if self.splits.get(n, split) == split else 0.0 for n in self.of]

    @property
    def is_uniform(self) -> bool:
        """True if every set of members of a size is drawn as often as any other, in both splits."""
        return not self.splits and len(set(self.weights_in("train"))) == 1

    @property
    def always_whole(self) -> bool:
        """True if all members are present in every world."""
        return self.count[0] == len(self.of)

    @model_validator(mode="after")
    def _can_be_drawn(self) -> GroupConfig:
        low, high = self.count
        if not low <= high <= len(self.of):
            raise wrong(f"should have a 'count' k or [low, high] with 0 <= low <= high <= {len(self.of)} (all members)")
        for word, named in (("weights", self.weights), ("splits", self.splits)):
            unknown = next((name for name in named if name not in self.of), None)
            if unknown is not None:
                raise wrong(f"should have '{word}' of its members only", unknown, self.of)
        for split in SPLITS:
            drawn = sum(weight > 0.0 for weight in self.weights_in(split))
            if drawn < high:
                raise wrong(
                    f"should have at least {high} members of a weight above 0 in the split '{split}', but has {drawn}"
                )
        return self
