"""`heaps`: things that fill a container, settled by MuJoCo beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from sceniris_gym.config.fields import Names
from sceniris_gym.config.section import Section

PLACING = ("on", "inside", "region", "relations", "joints", "ratio_on_support", "gap")
"""Words that an object of a heap cannot have."""


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
