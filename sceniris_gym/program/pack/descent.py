"""Start of the collision test of `collide/boxes.py`: pairs of boxes from the trees of two colliders."""

from collections.abc import Collection, Sequence

import numpy as np

from sceniris_gym.geometry.colliders import Collider

Nodes = tuple[int, int]
"""One node in each of two trees."""
Entry = tuple[int, int, int]
"""A pair of colliders, and a node in each of their trees."""


class Trees:
    """The trees of boxes of all colliders: the half sizes of the boxes, and the first child of each node.

    Args:
        colliders: All colliders.
    """

    def __init__(self, colliders: Sequence[Collider]) -> None:
        self._colliders = colliders
        self._half = np.concatenate([*(c.half for c in colliders), np.zeros((0, 3))])
        self._child = np.concatenate([*(c.child for c in colliders), np.zeros(0, int)])  # ~leaf for a leaf

    def first_nodes(self, entries: Sequence[Entry], lanes: int) -> list[Entry]:
        """Return the first entries of the descent of both trees: (pair, node of a, node of b).

        The largest boxes are opened in advance for all poses, until every lane has an entry. This saves the first
        passes of every test, which would leave most lanes idle.

        Args:
            entries: The test of one object, in as few entries as possible.
            lanes: Number of lanes that share the work. A single lane is fastest with the fewest entries.
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
        """Return pairs of nodes that together cover all pairs of leaves below two nodes, except the pairs left out.

        Args:
            a: A node. The recursion starts at the root of a collider.
            b: A node of the other collider.
            left_out: Pairs of leaves, as nodes of a and of b.
        """
        within = [(x, y) for x, y in left_out if x in self._leaves(a) and y in self._leaves(b)]
        if not within:
            return [(a, b)]
        if self._is_leaf(a) and self._is_leaf(b):
            return []
        return [found for nodes in self._opened(a, b) for found in self.without(*nodes, within)]

    def leaves(self, collider: int) -> dict[int, int]:
        """Return the numbers of a collider's pieces by their leaf nodes. A plane counts as a leaf."""
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
        """Split a pair of boxes into two smaller pairs. At least one of the boxes is not a leaf."""
        if self._is_leaf(b) or (not self._is_leaf(a) and self._half[a].max() > self._half[b].max()):
            return [(int(self._child[a]), b), (int(self._child[a]) + 1, b)]
        return [(a, int(self._child[b])), (a, int(self._child[b]) + 1)]
