"""Box trees: every leaf is in it once, and every box holds what is below it."""

import numpy as np
import pytest

from sceniris_gym.geometry.box_tree import build_tree


def _leaves(n: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(n)
    middle = rng.normal(size=(n, 3)) * [1.0, 0.1, 3.0]
    half = rng.uniform(0.0, 0.2, size=(n, 3))
    if kind == "equal":
        middle, half = np.ones((n, 3)), np.full((n, 3), 0.5)
    if kind == "flat":
        middle[:, 1:] = 0.0
        half[:, 1:] = 0.0
    return middle - half, middle + half


def _below(child: np.ndarray, node: int) -> list[int]:
    """The leaves below a node."""
    left = int(child[node])
    return [~left] if left < 0 else _below(child, left) + _below(child, left + 1)


@pytest.mark.parametrize("kind", ["random", "equal", "flat"])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_every_leaf_is_there_once_and_every_node_is_the_box_of_its_leaves(n: int, kind: str):
    """From a single leaf to a mesh, with boxes that are all alike, and without extent."""
    lower, upper = _leaves(n, kind)
    center, half, child = build_tree(lower, upper)
    assert len(child) == len(center) == len(half) == 2 * n - 1
    assert sorted(_below(child, 0)) == list(range(n))
    for node in range(len(child)):
        below = _below(child, node)
        np.testing.assert_allclose(center[node] - half[node], lower[below].min(axis=0), atol=1e-12)
        np.testing.assert_allclose(center[node] + half[node], upper[below].max(axis=0), atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_children_are_given_once_and_behind_their_parents(n: int):
    """The root is the first node, and no node but the root has no parent."""
    _, _, child = build_tree(*_leaves(n, "random"))
    inner = np.flatnonzero(child >= 0)
    assert (child[inner] > inner).all()
    children = np.concatenate([child[inner], child[inner] + 1])
    assert sorted(children) == list(range(1, len(child)))


@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_a_tree_is_no_deeper_than_halving_makes_it(n: int):
    """Its depth bounds the stack of the collision test."""
    _, _, child = build_tree(*_leaves(n, "random"))

    def deep(node: int) -> int:
        left = int(child[node])
        return 0 if left < 0 else 1 + max(deep(left), deep(left + 1))

    assert deep(0) == int(np.ceil(np.log2(n)))
