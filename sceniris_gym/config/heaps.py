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
