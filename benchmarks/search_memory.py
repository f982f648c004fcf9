"""Memory of a generator, array by array: those of its layouts, and those of its search with the capacities of a GPU.

python -m benchmarks.search_memory mid 524288
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

import warp as wp

from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.layout.wave.search import Search, SearchSize, create_search
from sceniris_gym.layout.wave.sides import Regions, create_regions
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.scene.build import build_model


def arrays(declared: Any, struct: Any) -> Iterator[tuple[str, wp.array]]:
    """Yield the arrays of an instance of a declared struct by name, of those that are parts of one only the first."""
    whole: set[int] = set()
    for name in declared.vars:
        value = getattr(struct, name)
        if not isinstance(value, wp.array):
            continue
        of = getattr(value, "_ref", None)
        if of is None or of.ptr not in whole:
            yield name, value
        if of is not None:
            whole.add(of.ptr)


def main() -> None:
    """Print a line for each array of 1 MB or more, and the sum of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("worlds", type=int)
    words = parser.parse_args()
    compiled = upload_scene(build_model(words.scene), "cpu")
    layouts = Layouts.create(compiled, words.worlds, rows=SearchSize().rows)
    search = create_search(compiled, words.worlds, SearchSize())
    parts: list[tuple[str, Any, Any]] = [("layouts", LayoutsView, layouts.view), ("search", Search, search)]
    if compiled.related:
        parts.append(("regions", Regions, create_regions(compiled, search.cause.shape[0])))
    total = 0
    for part, declared, struct in parts:
        for name, array in sorted(arrays(declared, struct), key=lambda item: -item[1].capacity):
            total += array.capacity
            if array.capacity >= 1_000_000:
                print(f"{part}.{name:16s} {array.capacity / 1e6:8.1f} MB  {array.shape} {array.dtype.__name__}")
    print(f"all              {total / 1e6:8.1f} MB")


if __name__ == "__main__":
    main()
