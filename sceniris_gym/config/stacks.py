"""`stacks`: towers, each thing of which stands on the one before it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from sceniris_gym.config.fields import Length, Names, listed, must
from sceniris_gym.config.heaps import named_things
from sceniris_gym.config.loader import SUPPORT_WORDS
from sceniris_gym.config.section import Section

_THINNEST = 2.0e-4
"""Least width of an offset [m], as of any distance."""

_ADVICE = f"should be [low, high] with 0 <= low and high at least {_THINNEST} m above it"


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
    offset: Annotated[tuple[Length, Length], BeforeValidator(listed), must(_is_offset, _ADVICE)] | None = None


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
