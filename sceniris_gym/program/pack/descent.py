"""First nodes of the collision test: pairs of boxes of two trees; see `collide/boxes.py`."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from sceniris_gym.geometry.colliders import Collider

Nodes = tuple[int, int]
"""A node of each of two trees."""
Entry = tuple[int, int, int]
"""A pair of colliders, and a node of each."""


def first_nodes(colliders: Sequence[Collider], entries: Sequence[Entry], lanes: int) -> list[Entry]:
    """Return the entries that the descent of both trees begins with: (pair, node of a, node of b).

    The largest boxes are opened ahead of time, whatever the poses, until there is an entry for every lane. That saves
    the first passes of every test, in which most lanes would idle.

    Args:
        colliders: All colliders.
        entries: The test of one object, in as few entries as possible.
        lanes: Number of lanes that share the work; a single one does best with the fewest entries.
    """
    half, child = _half(colliders), _child(colliders)
    found = list(entries)
    while 0 < len(found) < lanes:
        sizes = [max(half[node].max() if child[node] >= 0 else 0.0 for node in e[1:]) for e in found]
        widest = int(np.argmax(sizes))
        if sizes[widest] <= 0.0:
            break
        pair, a, b = found.pop(widest)
        found += [(pair, *nodes) for nodes in _opened(half, child, a, b)]
    return found


def nodes_without(colliders: Sequence[Collider], a: int, b: int, left_out: Collection[Nodes]) -> list[Nodes]:
    """Return pairs of nodes below two colliders that together cover all pairs of their leaves but those left out.

    Args:
        colliders: All colliders.
        a: One collider.
        b: The other one.
        left_out: Pairs of leaves, as nodes of a and of b.
    """
    half, child = _half(colliders), _child(colliders)

    def below(first: int, second: int, out: Collection[Nodes]) -> list[Nodes]:
        within = [(x, y) for x, y in out if x in _leaves(child, first) and y in _leaves(child, second)]
        if not within:
            return [(first, second)]
        if child[first] < 0 and child[second] < 0:
            return []
        return [found for nodes in _opened(half, child, first, second) for found in below(*nodes, within)]

    return below(colliders[a].root, colliders[b].root, left_out)


def leaf_nodes(colliders: Sequence[Collider], collider: int) -> dict[int, int]:
    """Return the leaves of a collider by their nodes: the numbers of pieces, also of a plane."""
    one, child = colliders[collider], _child(colliders)
    if one.plane >= 0:
        return {one.root: one.plane}
    return {node: int(~child[node]) for node in _leaves(child, one.root)}


def _half(colliders: Sequence[Collider]) -> np.ndarray:
    """Return the half sizes of all boxes [m], shape (nnode, 3)."""
    return np.concatenate([*(c.half for c in colliders), np.zeros((0, 3))])


def _child(colliders: Sequence[Collider]) -> np.ndarray:
    """Return the first child of each node; ~leaf for a leaf."""
    return np.concatenate([*(c.child for c in colliders), np.zeros(0, int)])


def _leaves(child: np.ndarray, node: int) -> list[int]:
    """Return the leaves below a node."""
    first = int(child[node])
    return [node] if first < 0 else _leaves(child, first) + _leaves(child, first + 1)


def _opened(half: np.ndarray, child: np.ndarray, a: int, b: int) -> list[Nodes]:
    """Return the two smaller pairs of boxes that make up a pair of boxes, not both of which are leaves."""
    if child[b] < 0 or (child[a] >= 0 and half[a].max() > half[b].max()):
        return [(int(child[a]), b), (int(child[a]) + 1, b)]
    return [(a, int(child[b])), (a, int(child[b]) + 1)]
