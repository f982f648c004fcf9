"""Scenes in which what is there depends on what is there, and the items of their layouts as `tests.oracle.presence`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import stats

from sceniris_gym.program.compiled import CompiledScene
from tests.layout.related import Shapes
from tests.oracle.presence import outcomes

FLOOR = {"size": [6.0, 6.0]}
SIDE = 0.05  # m, of a cube, whose half is the distance from an edge


def forms(shapes: Shapes) -> dict[str, dict[str, Any]]:
    """Return scenes by name: mappings of `objects` and `groups`."""
    cube = {"asset": shapes.cube, "on": "floor", "stands": False}
    slab = {"asset": shapes.slab, "on": "floor", "stands": False}
    low = {
        "variants": {"slab": {"asset": shapes.slab}, "bar": {"asset": shapes.bar, "weight": 2}},
        "on": "floor",
        "stands": False,
    }
    thing = {
        "variants": {"cube": {"asset": shapes.cube}, "odd": {"asset": shapes.odd, "weight": 3}},
        "on": "floor",
        "stands": False,
    }
    inside = {"ratio_on_support": 1, "orientation": "fixed"}
    return {
        "conditions": {
            "objects": {
                **dict.fromkeys("abcd", cube),
                "spoon": {**cube, "if": "a"},
                "book": {**cube, "unless": ["a", "b"]},
                "knife": {**cube, "if": ["first", "c"]},
                "cup": {**cube, "if": "knife", "unless": "d"},
            },
            "groups": {
                "first": {"of": ["a", "b"], "count": [0, 1]},
                "second": {"of": ["c", "d"], "count": [0, 2], "if": "a"},
            },
        },
        "groups of groups": {
            "objects": {**dict.fromkeys("abcdef", cube), "last": {**cube, "unless": "meal"}},
            "groups": {
                "guests": {"of": ["meal", "sweets", "f"], "count": [1, 2], "weights": {"meal": 3}},
                "meal": {"of": ["a", "b"], "count": 1},
                "sweets": {"of": ["c", "d", "e"], "count": [0, 2], "weights": {"c": 2, "d": 0.5}},
            },
        },
        "a group on its neighbour": {
            "objects": {**dict.fromkeys("abcd", cube), "cup": {**cube, "if": "a"}},
            "groups": {
                "meal": {"of": ["a", "b"], "count": 1},
                "sweets": {"of": ["c", "d"], "count": [0, 2], "if": "a"},
                "guests": {"of": ["meal", "sweets"], "count": [1, 2], "weights": {"meal": 2}},
            },
        },
        "cut counts": {
            "objects": {**dict.fromkeys("ab", cube), **{name: {**cube, "if": "a"} for name in "cd"}, "e": cube},
            "groups": {"some": {"of": ["a", "b"], "count": [0, 1]}, "all": {"of": ["c", "d", "e"], "count": [1, 3]}},
        },
        "towers": {
            "objects": {
                "tray": slab,
                "plate": {**cube, "on": "tray"},
                "top": {**cube, "on": "plate", "relations": [{"near": "plate", "distance": {"max": 0.02}}]},
                "side": {**cube, "on": "tray"},
                "other": cube,
            },
            "groups": {"some": {"of": ["tray", "other"], "count": [0, 1]}, "on": {"of": ["plate", "side"], "count": 1}},
        },
        "variants": {
            "objects": {
                "unit": low,
                "thing": {**thing, "if": "a"},
                "lid": {**cube, "on": "unit"},
                "mark": {**cube, "unless": ["unit/bar", "b"]},
                **dict.fromkeys("ab", cube),
            },
            "groups": {"some": {"of": ["a", "unit"], "count": [0, 2]}, "more": {"of": ["b", "thing"], "count": 1}},
        },
        "supports": {
            "objects": {
                "table": slab,
                "shelf": {**slab, "kind": "fixture"},
                "unit": low,
                "apple": {**cube, **inside, "on": ["table", "shelf", "floor"]},
                "pear": {**thing, "on": {"table": 2, "shelf": 1, "unit": 4}},
                "leaf": {**cube, "on": "pear", "relations": [{"near": "apple", "distance": {"max": 6}}], "if": "apple"},
            },
            "groups": {
                "some": {"of": ["table", "unit"], "count": [0, 1]},
                "fruit": {"of": ["apple", "pear"], "count": 2},
            },
        },
    }


AREAS = {
    ("apple", "table"): (1.2 - SIDE) * (0.9 - SIDE),
    ("apple", "shelf"): (1.2 - SIDE) * (0.9 - SIDE),
    ("apple", "floor"): (FLOOR["size"][0] - SIDE) * (FLOOR["size"][1] - SIDE),
}
"""(object, support) -> area [m2] where the pivot of a cube may be so that all of it is on the support."""


def items(compiled: CompiledScene, written: Mapping[str, Any], row: np.ndarray) -> frozenset:
    """Return the items of a layout."""
    found = set()
    for name in (name for name, there in zip(compiled.object_names, row, strict=False) if there):
        owner, _, rest = name.partition("/")
        variant, _, support = rest.partition("@")
        for word in ("on", "inside", "in"):
            several = isinstance(written[owner].get(word), list | dict) and len(written[owner][word]) > 1
            support = support if word not in written[owner] or several else ""
        found.add((owner, variant, support.partition(":")[0]))
    return frozenset(found)


def pvalue(compiled: CompiledScene, written: Mapping[str, Any], present: np.ndarray) -> float:
    """Return the p-value of the sets of items under the enumerator; no layout has a set of probability 0."""
    expected = outcomes(written, AREAS)
    assert sum(expected.values()) == 1
    found = Counter(items(compiled, written["objects"], row) for row in present)
    assert not found.keys() - expected.keys()
    likely = {key: float(p) * len(present) for key, p in expected.items() if float(p) * len(present) >= 5.0}
    counts = [found[key] for key in likely] + [sum(found[key] for key in expected.keys() - likely.keys())]
    numbers = [*likely.values(), len(present) - sum(likely.values())]
    keep = [i for i, number in enumerate(numbers) if number >= 1.0]
    chosen = np.array(numbers)[keep]
    return float(stats.chisquare(np.array(counts)[keep], chosen * np.array(counts)[keep].sum() / chosen.sum()).pvalue)
