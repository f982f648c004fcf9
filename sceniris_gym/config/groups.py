"""Objects that belong together: `groups`, of which some are present, `heaps` in containers, and `stacks`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Strict, model_validator

from sceniris_gym.config.fields import Length, Names, Number, listed, must, within, wrong
from sceniris_gym.config.loader import SUPPORT_WORDS
from sceniris_gym.config.section import Section

SPLITS = ("train", "eval")
"""The splits of layouts."""
_Weight = Annotated[Number, Field(ge=0.0), within("weight")]
_Count = Annotated[int, Strict(), Field(ge=0)]
PLACING = ("on", "inside", "region", "relations", "joints", "ratio_on_support", "gap")
"""Words that an object of a heap cannot have."""
_THINNEST = 2.0e-4
"""Least width of an offset [m], as of any distance."""

_OFFSET_ADVICE = f"should be [low, high] with 0 <= low and high at least {_THINNEST} m above it"


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


class HeapConfig(Section):
    """Things that lie in a container as one row of a file has them, drawn anew for every layout.

    Attributes:
        fill: The container: an object, or a body of one, as in `on`.
        of: Names of the things, all of which are in the container.
        rows: The file of settled heaps that `sceniris-gym settle` writes; None until there is one.
    """

    fill: str
    of: Annotated[Names, Field(min_length=1)]
    rows: str | None = None


def with_places(scene: Any) -> Any:
    """Return the words of a scene with the things of heaps `in` their containers, in any orientation.

    Anything that is not a scene, and unknown names, are left to the checks that follow.
    """
    placed, heaps = named_things(scene, "heaps")
    for words, things in heaps:
        for name in things:
            part = placed.get(name)
            if isinstance(part, Mapping) and not any(word in part for word in ("in", "in_", "orientation", *PLACING)):
                placed[name] = {**part, "in": words.get("fill"), "orientation": "any"}
    return {**scene, "objects": placed} if heaps else scene


def named_things(scene: Any, key: str) -> tuple[dict[str, Any], list[tuple[Mapping, list[str]]]]:
    """Return the objects of a scene, and the words of each of its heaps or stacks with the names of its things.

    Nothing is returned of what is no scene, and nothing that is no name.
    """
    parts, objects = (scene.get(word) if isinstance(scene, Mapping) else None for word in (key, "objects"))
    if not isinstance(parts, Mapping) or not isinstance(objects, Mapping):
        return {}, []
    written = [part.model_dump() if isinstance(part, Section) else part for part in parts.values()]
    of = [(words, words.get("of")) for words in written if isinstance(words, Mapping)]
    found = [
        (words, [n for n in names if isinstance(n, str)]) for words, names in of if isinstance(names, list | tuple)
    ]
    return dict(objects), found


def _is_offset(ends: Any) -> bool:
    is_pair = isinstance(ends, list | tuple) and len(ends) == 2 and all(isinstance(end, int | float) for end in ends)
    return is_pair and 0.0 <= ends[0] <= ends[1] - _THINNEST


class StackConfig(Section):
    """Things on top of each other, in the words `on` and `near` of the objects.

    Attributes:
        of: Names of the things, the lowest first.
        on: The support of the lowest one.
        offset: Interval of the distance of a thing's pivot from that of the one below, seen from above [m]; None for
            anywhere on it.
    """

    of: Annotated[Names, Field(min_length=2)]
    on: str
    offset: Annotated[tuple[Length, Length], BeforeValidator(listed), must(_is_offset, _OFFSET_ADVICE)] | None = None


def with_chains(scene: Any) -> Any:
    """Return the words of a scene with each thing of a stack `on` the one below, and `near` it by the stack's offset.

    Things that have a support already, unknown names, and anything that is no scene are left to the checks that follow.
    """
    placed, stacks = named_things(scene, "stacks")
    for words, things in stacks:
        offset, below, near = listed(words.get("offset")), words.get("on"), []
        for name in things:
            part = placed.get(name)
            part = part.model_dump(by_alias=True, exclude_unset=True) if isinstance(part, Section) else part
            if isinstance(part, Mapping) and not any(word in part for word in (*SUPPORT_WORDS, "in_")):
                own = part.get("relations") or ()
                placed[name] = {**part, "on": below, **({"relations": [*own, *near]} if near else {})}
            below = name
            if _is_offset(offset):
                near = [{"near": name, "distance": {"min": offset[0], "max": offset[1]}}]
    return {**scene, "objects": placed} if stacks else scene
