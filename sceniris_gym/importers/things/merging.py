"""Merges convex parts into fewer ones, as long as they stay near the mesh that they replace."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from sceniris_gym.importers.things.fit import are_near
from sceniris_gym.importers.things.splitting import small_hull

Beyond = Callable[[trimesh.Trimesh, list[trimesh.Trimesh]], float]


def merge(parts: list[trimesh.Trimesh], beyond: Beyond, allowed: float) -> list[trimesh.Trimesh]:
    """Merge pairs of parts, those first whose common hull adds least volume.

    Args:
        parts: Convex parts that fit.
        beyond: Returns the distance of the outside of a part among others from the mesh [m].
        allowed: The largest such distance [m].
    """
    alive = dict(enumerate(parts))
    fresh = itertools.count(len(parts))
    heap: list[tuple[float, int, int]] = []

    def push(i: int, others: Iterable[int]) -> None:
        for j in others:
            if are_near(alive[i], alive[j], allowed):
                both = ConvexHull(np.concatenate([alive[i].vertices, alive[j].vertices]))
                heapq.heappush(heap, (float(both.volume - alive[i].volume - alive[j].volume), j, i))

    for i in range(len(parts)):
        push(i, range(i))
    while heap:
        _, j, i = heapq.heappop(heap)
        if i not in alive or j not in alive:
            continue
        both = small_hull(np.concatenate([alive[i].vertices, alive[j].vertices]), allowed)
        others = {k: part for k, part in alive.items() if k not in (i, j)}
        if beyond(both, list(others.values())) <= allowed:
            new = next(fresh)
            alive = {**others, new: both}
            push(new, others)
    return list(alive.values())
