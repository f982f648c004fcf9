"""Binary trees of boxes over the leaves of a collider, built once on the host."""

from __future__ import annotations

import numpy as np


def build_tree(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Build the tree over leaf boxes [m], shape (n, 3) each, split at the median along the longest axis.

    Returns:
        Its nodes, the root first, a right child directly after its left sibling: centres and halves of their boxes [m],
        shape (m, 3) each, and the number of the left child of each, or ~leaf, shape (m,).
    """
    middle = 0.5 * (lower + upper)
    order = np.arange(len(lower))
    start, stop = np.array([0]), np.array([len(lower)])
    lows, highs, children = [], [], []
    nodes = 1  # ids given out so far
    while len(start):
        gather = np.concatenate([order[a:b] for a, b in zip(start, stop, strict=True)])
        size = stop - start
        first = np.concatenate([[0], np.cumsum(size)[:-1]])
        lows.append(np.minimum.reduceat(lower[gather], first))
        highs.append(np.maximum.reduceat(upper[gather], first))
        leaf = size == 1
        inner = np.flatnonzero(~leaf)
        child = np.where(leaf, ~order[start], 0)
        child[inner] = nodes + 2 * np.arange(len(inner))
        children.append(child)
        nodes += 2 * len(inner)

        spread = np.maximum.reduceat(middle[gather], first) - np.minimum.reduceat(middle[gather], first)
        owner = np.repeat(np.arange(len(size)), size)
        along = middle[gather, spread.argmax(axis=1)[owner]]
        gather = gather[np.lexsort((gather, along, owner))]
        for i in inner:
            order[start[i] : stop[i]] = gather[first[i] : first[i] + size[i]]
        half = start[inner] + size[inner] // 2
        start, stop = np.stack([start[inner], half], axis=1).ravel(), np.stack([half, stop[inner]], axis=1).ravel()
    low, high = np.concatenate(lows), np.concatenate(highs)
    return 0.5 * (low + high), 0.5 * (high - low), np.concatenate(children)
