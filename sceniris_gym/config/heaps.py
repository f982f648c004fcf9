"""`heaps`: things that fill a container, as MuJoCo settled them beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, model_validator

from sceniris_gym.config.fields import wrong
from sceniris_gym.config.section import Section

PLACING = ("on", "inside", "region", "relations", "joints", "ratio_on_support", "gap")
"""Words of an object that a heap leaves no room for."""


class HeapConfig(Section):
    """Things that lie in a container as in one of the rows of a file, drawn anew for every layout.

    Attributes:
        fill: The container: an object, or a body of one, as in `on`.
        of: Names of the things, all of which are in it.
        rows: File of settled heaps, written by `sceniris-gym settle`; None until there is one.
    """

    fill: str
    of: Annotated[tuple[str, ...], Field(min_length=1)]
    rows: str | None = None

    @model_validator(mode="after")
    def _names_everything_once(self) -> HeapConfig:
        if len(set(self.of)) < len(self.of):
            raise wrong("should name every thing of 'of' once")
        return self


def with_places(scene: Any) -> Any:
    """Return the words of a scene in which the things of heaps are `in` what they fill, in any orientation.

    What is not a scene, or names what is not there, is left for the checks that follow.
    """
    heaps, objects = (scene.get(key) if isinstance(scene, Mapping) else None for key in ("heaps", "objects"))
    if not isinstance(heaps, Mapping) or not isinstance(objects, Mapping):
        return scene
    placed = dict(objects)
    for heap in heaps.values():
        words = heap.model_dump() if isinstance(heap, HeapConfig) else heap
        things = words.get("of") if isinstance(words, Mapping) else None
        for name in things if isinstance(things, list | tuple) else ():
            part = placed.get(name) if isinstance(name, str) else None
            if isinstance(part, Mapping) and not any(word in part for word in ("in", "in_", "orientation", *PLACING)):
                placed[name] = {**part, "in": words.get("fill"), "orientation": "any"}
    return {**scene, "objects": placed}
