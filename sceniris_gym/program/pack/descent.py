"""First nodes of the collision test: pairs of boxes of two trees; see `collide/boxes.py`."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from sceniris_gym.geometry.colliders import Collider

Nodes = tuple[int, int]
"""A node of each of two trees."""
Entry = tuple[int, int, int]
"""A pair of colliders, and a node of each."""


class Trees:
    """The trees of boxes of all colliders, with the half sizes of their boxes and the first child of each node.

    Args:
        colliders: All colliders.
    """

    def __init__(self, colliders: Sequence[Collider]) -> None:
        self._colliders = colliders
        self._half = np.concatenate([*(c.half for c in colliders), np.zeros((0, 3))])
        self._child = np.concatenate([*(c.child for c in colliders), np.zeros(0, int)])  # ~leaf for a leaf

    def first_nodes(self, entries: Sequence[Entry], lanes: int) -> list[Entry]:
        """Return the entries that the descent of both trees begins with: (pair, node of a, node of b).

        The largest boxes are opened ahead of time, whatever the poses, until there is an entry for every lane. That
        saves the first passes of every test, in which most lanes would idle.

        Args:
            entries: The test of one object, in as few entries as possible.
            lanes: Number of lanes that share the work; a single one does best with the fewest entries.
        """
        found = list(entries)
        while 0 < len(found) < lanes:
            sizes = [max(0.0 if self._is_leaf(node) else self._half[node].max() for node in e[1:]) for e in found]
            widest = int(np.argmax(sizes))
            if sizes[widest] <= 0.0:
                break
            pair, a, b = found.pop(widest)
            found += [(pair, *nodes) for nodes in self._opened(a, b)]
        return found

    def without(self, a: int, b: int, left_out: Collection[Nodes]) -> list[Nodes]:
        """Return pairs of nodes that together cover all pairs of leaves below two nodes but those left out.

        Args:
            a: One node, the root of a collider at first.
            b: The other one.
            left_out: Pairs of leaves, as nodes of a and of b.
        """
        within = [(x, y) for x, y in left_out if x in self._leaves(a) and y in self._leaves(b)]
        if not within:
            return [(a, b)]
        if self._is_leaf(a) and self._is_leaf(b):
            return []
        return [found for nodes in self._opened(a, b) for found in self.without(*nodes, within)]

    def leaves(self, collider: int) -> dict[int, int]:
        """Return the leaves of a collider by their nodes: the numbers of pieces, also of a plane."""
        one = self._colliders[collider]
        if one.plane >= 0:
            return {one.root: one.plane}
        return {node: int(~self._child[node]) for node in self._leaves(one.root)}

    def _is_leaf(self, node: int) -> bool:
        return bool(self._child[node] < 0)

    def _leaves(self, node: int) -> list[int]:
        """Return the leaves below a node."""
        first = int(self._child[node])
        return [node] if first < 0 else self._leaves(first) + self._leaves(first + 1)

    def _opened(self, a: int, b: int) -> list[Nodes]:
        """Return the two smaller pairs of boxes that make up a pair of boxes, not both of which are leaves."""
        if self._is_leaf(b) or (not self._is_leaf(a) and self._half[a].max() > self._half[b].max()):
            return [(int(self._child[a]), b), (int(self._child[a]) + 1, b)]
        return [(a, int(self._child[b])), (a, int(self._child[b]) + 1)]
