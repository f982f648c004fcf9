"""Objects that belong together: `groups` with some members present, `heaps` in containers, and `stacks`."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, ConfigDict, Field, Strict, model_validator
from pydantic_core import PydanticCustomError

from sceniris_gym.config.fields import Length, NameOrNames, Names, Number, check_words, listed, must, within, wrong
from sceniris_gym.config.section import Section
from sceniris_gym.config.several_supports import support_of, supports_in

SPLITS = ("train", "eval")
"""The splits of layouts."""
_Weight = Annotated[Number, Field(ge=0.0), within("weight")]
_Count = Annotated[int, Strict(), Field(ge=0)]
PLACING = ("on", "inside", "region", "relations", "joints", "ratio_on_support", "gap")
"""Keys that objects of a heap cannot have, because the heap places them."""
_THINNEST = 2.0e-4
"""Smallest width [m] of the interval `offset`, the same as for other intervals of distances."""

_OFFSET_ADVICE = f"should be [low, high] in metres, with low at least 0 and high at least {_THINNEST} above low"


def _both_ends(value: Any) -> Any:
    value = listed(value)
    if isinstance(value, list | tuple):
        return value
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise wrong("should be a whole number of at least 0, or [low, high]")
    return value, value


class GroupConfig(Section):
    """A group: each layout draws `count` members to be present in the world. The others are parked far away.

    Attributes:
        of: Names of the members: objects, or other groups.
        count: Minimum and maximum number of present members. The number is drawn uniformly, and then cut to the members
            whose conditions hold. Then members are drawn.
        missing: Treatment of references to a member that may be absent: reject the scene ('refuse'), or drop the
            reference in worlds without the member ('drop').
        weights: Weights of members, by default 1. Members are drawn one by one without replacement, with probabilities
            proportional to the weights of the remaining members.
        splits: Member -> the only split, 'train' or 'eval', that draws this member. Other members are drawn in both.
        if_, unless: Conditions of the whole group, as for an object.
        by_area: Whether the weights are multiplied by the areas of the members' supports. It is set for objects on one
            of several supports, and is not a key of scene files.
    """

    model_config = ConfigDict(populate_by_name=True)
    of: Annotated[Names, Field(min_length=1)]
    count: Annotated[tuple[_Count, _Count], BeforeValidator(_both_ends)]
    missing: Literal["refuse", "drop"] = "refuse"
    weights: dict[str, _Weight] = Field(default_factory=dict)
    splits: dict[str, Literal["train", "eval"]] = Field(default_factory=dict)
    if_: NameOrNames = Field(default=(), alias="if")
    unless: NameOrNames = ()
    by_area: bool = False

    def weights_in(self, split: str) -> list[float]:
        """Return the weight of each member in a split, 'train' or 'eval': 0 if the split never draws it."""
        return [self.weights.get(n, 1.0) if self.splits.get(n, split) == split else 0.0 for n in self.of]

    @property
    def is_uniform(self) -> bool:
        """True if all sets of members of the same size are equally likely, in both splits."""
        return not self.splits and not self.by_area and len(set(self.weights_in("train"))) == 1

    @property
    def always_whole(self) -> bool:
        """True if all members of the group are present in every world."""
        return self.count[0] == len(self.of)

    @classmethod
    def _problem(cls, key: Any, valid: list[str]) -> PydanticCustomError:
        return super()._problem(key, [word for word in valid if word != "by_area"])

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        low, high = self.count
        if not low <= high <= len(self.of):
            raise wrong(f"should have a 'count' from 0 to {len(self.of)}, its members, or [low, high] with low <= high")
        for word, named in (("weights", self.weights), ("splits", self.splits)):
            check_words(named, self.of, f"should have '{word}' only for members that are in its 'of'")
        for split in SPLITS:
            drawn = sum(weight > 0.0 for weight in self.weights_in(split))
            if drawn < high:
                raise wrong(
                    f"should have at least {high} members with a weight above 0 in the split '{split}', but has {drawn}"
                )
        return self


class HeapConfig(Section):
    """Objects that lie in a container. Each row of a file has a settled pose of every object. Each layout draws a row.

    Attributes:
        fill: The container: an object, or a body of an object, written as for the key `on`.
        of: Names of the objects. Every layout has all of these objects in the container.
        rows: The file of settled heaps from `sceniris-gym settle`, None before it is written.
    """

    fill: str
    of: Annotated[Names, Field(min_length=1)]
    rows: str | None = None


def with_places(scene: Any) -> Any:
    """Add the keys `in: CONTAINER` and `orientation: any` to each object of a heap, and return the new scene mapping.

    Objects with another place or orientation are left unchanged. A later check reports these objects, unknown names,
    and a `scene` that is not a mapping.
    """
    placed, heaps = named_things(scene, "heaps")
    for words, things in heaps:
        for name in things:
            part = placed.get(name)
            if isinstance(part, Mapping) and not any(word in part for word in ("in", "in_", "orientation", *PLACING)):
                placed[name] = {**part, "in": words.get("fill"), "orientation": "any"}
    return {**scene, "objects": placed} if heaps else scene


def named_things(scene: Any, key: str) -> tuple[dict[str, Any], list[tuple[Mapping, list[str]]]]:
    """Return the objects of a scene mapping, and a pair for each heap or stack: its mapping, and its objects' names.

    `key` is "heaps" or "stacks". Values of wrong types are left out. Later checks report them.
    """
    parts, objects = scene.get(key), scene.get("objects")
    if not isinstance(parts, Mapping) or not isinstance(objects, Mapping):
        return {}, []
    of = [(words, words.get("of")) for words in parts.values() if isinstance(words, Mapping)]
    found = [
        (words, [n for n in names if isinstance(n, str)]) for words, names in of if isinstance(names, list | tuple)
    ]
    return dict(objects), found


def _is_offset(ends: Any) -> bool:
    is_pair = isinstance(ends, list | tuple) and len(ends) == 2 and all(isinstance(end, int | float) for end in ends)
    return is_pair and 0.0 <= ends[0] <= ends[1] - _THINNEST


def _is_support(value: Any) -> bool:
    return isinstance(value, str | list | tuple | Mapping) and all(isinstance(name, str) for name in supports_in(value))


class StackConfig(Section):
    """Objects on top of each other, as a short form of `on` and `near` for each object.

    Attributes:
        of: Names of the objects, the lowest first.
        on: The support of the lowest object, or several, as for the key `on` of an object.
        offset: Interval of the distance [m] between the pivots of an object and the object below, seen from above. None
            allows any place on the object below.
    """

    of: Annotated[Names, Field(min_length=2)]
    on: Annotated[Any, must(_is_support, "should be a support, a list of supports, or supports with weights")]
    offset: Annotated[tuple[Length, Length], BeforeValidator(listed), must(_is_offset, _OFFSET_ADVICE)] | None = None


def with_chains(scene: Any) -> Any:
    """Add the key `on: BELOW` to each object of a stack, where BELOW is the object below. Return the new scene mapping.

    If the stack has an `offset`, each object also gets the relation `near: BELOW` with this distance. Later checks
    report objects that already have a support, unknown names, and a `scene` that is not a mapping.
    """
    placed, stacks = named_things(scene, "stacks")
    for words, things in stacks:
        offset, below, near = listed(words.get("offset")), words.get("on"), []
        for name in things:
            part = placed.get(name)
            if isinstance(part, Mapping) and support_of(part) in (("", None), ("on", below)):
                own = part.get("relations") or ()
                placed[name] = {**part, "on": below, **({"relations": [*own, *near]} if near else {})}
            below = name
            if _is_offset(offset):
                near = [{"near": name, "distance": {"min": offset[0], "max": offset[1]}}]
    return {**scene, "objects": placed} if stacks else scene
