"""Merges convex parts into fewer ones, as long as they stay near the mesh that they stand for."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import trimesh

Hull = Callable[[np.ndarray], "trimesh.Trimesh"]
Beyond = Callable[["trimesh.Trimesh", "list[trimesh.Trimesh]"], float]


def merge(parts: list[trimesh.Trimesh], beyond: Beyond, allowed: float, hull: Hull) -> list[trimesh.Trimesh]:
    """Merge pairs of parts, those first whose common hull adds least volume.

    Args:
        parts: Convex parts that fit.
        beyond: How far the outside of a part among others is from the mesh [m].
        allowed: How far it may be [m].
        hull: Makes a part of points, shape (n, 3).
    """
    from scipy.spatial import ConvexHull

    alive = dict(enumerate(parts))
    fresh = itertools.count(len(parts))
    heap: list[tuple[float, int, int]] = []

    def push(i: int, others: Iterator[int]) -> None:
        for j in others:
            if _touch(alive[i], alive[j], allowed):
                both = ConvexHull(np.concatenate([alive[i].vertices, alive[j].vertices]))
                heapq.heappush(heap, (float(both.volume - alive[i].volume - alive[j].volume), j, i))

    for i in list(alive):
        push(i, (j for j in list(alive) if j < i))
    while heap:
        _, j, i = heapq.heappop(heap)
        if i not in alive or j not in alive:
            continue
        both = hull(np.concatenate([alive[i].vertices, alive[j].vertices]))
        others = [part for k, part in alive.items() if k not in (i, j)]
        if beyond(both, others) > allowed:
            continue
        del alive[i], alive[j]
        alive[new := next(fresh)] = both
        push(new, (k for k in list(alive) if k != new))
    return list(alive.values())


def _touch(one: trimesh.Trimesh, other: trimesh.Trimesh, near: float) -> bool:
    """Whether the bounds of two parts are nearer than a distance [m]."""
    return bool((one.bounds[0] <= other.bounds[1] + near).all() and (other.bounds[0] <= one.bounds[1] + near).all())
