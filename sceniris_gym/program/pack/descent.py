"""The first pairs of boxes that the collision test of `collide/boxes.py` compares, from the trees of two colliders."""

from collections.abc import Collection, Sequence

import numpy as np

from sceniris_gym.geometry.colliders import Collider

Nodes = tuple[int, int]
"""One node in each of two trees."""
Entry = tuple[int, int, int]
"""A pair of colliders, and a node in each of their trees."""


class Trees:
    """The box trees of all colliders. A leaf is the box of a piece or face, other nodes have two children.

    Args:
        colliders: All colliders.
    """

    def __init__(self, colliders: Sequence[Collider]) -> None:
        self._colliders = colliders
        self._half = np.concatenate([*(c.half for c in colliders), np.zeros((0, 3))])
        self._child = np.concatenate([*(c.child for c in colliders), np.zeros(0, int)])  # ~leaf for a leaf

    def first_nodes(self, entries: Sequence[Entry], lanes: int) -> list[Entry]:
        """Return the first entries that the collision test of one object compares.

        An entry is a pair of colliders, with a node from the tree of each. The test compares the boxes of both nodes.
        If they overlap, it replaces the larger box by its children. With few entries, most lanes would idle in the
        first passes. The largest boxes are therefore replaced here, once for all poses, until each lane has an entry.

        Args:
            entries: For each pair of colliders of the test, usually one entry: the roots of both trees.
            lanes: Number of GPU lanes that share the work. A single lane is fastest with the fewest entries.
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
        """Return pairs of nodes to start a test that skips some pairs of leaves.

        The result covers all pairs of a leaf below `a` and a leaf below `b`, except the pairs in `left_out`.

        Args:
            a: A node of one collider. The recursion starts at the root.
            b: A node of another collider.
            left_out: The pairs of leaves to leave out.
        """
        within = [(x, y) for x, y in left_out if x in self._leaves(a) and y in self._leaves(b)]
        if not within:
            return [(a, b)]
        if self._is_leaf(a) and self._is_leaf(b):
            return []
        return [found for nodes in self._opened(a, b) for found in self.without(*nodes, within)]

    def leaves(self, collider: int) -> dict[int, int]:
        """Return the leaves of a collider: node -> index of the leaf's piece."""
        return {node: int(~self._child[node]) for node in self._leaves(self._colliders[collider].root)}

    def _is_leaf(self, node: int) -> bool:
        return bool(self._child[node] < 0)

    def _leaves(self, node: int) -> list[int]:
        """Return the leaves below a node, or the node if it is a leaf."""
        first = int(self._child[node])
        return [node] if first < 0 else self._leaves(first) + self._leaves(first + 1)

    def _opened(self, a: int, b: int) -> list[Nodes]:
        """Replace the larger of two boxes by its children, and return the two new pairs. Leaves are never replaced."""
        if self._is_leaf(b) or (not self._is_leaf(a) and self._half[a].max() > self._half[b].max()):
            return [(int(self._child[a]), b), (int(self._child[a]) + 1, b)]
        return [(a, int(self._child[b])), (a, int(self._child[b]) + 1)]
