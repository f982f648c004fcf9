"""Box trees: every leaf is in it once, and every box holds what is below it."""

import numpy as np
import pytest

from sceniris_gym.geometry.box_tree import BoxTree, build_tree


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


def _below(tree: BoxTree, node: int) -> list[int]:
    """The leaves below a node."""
    child = int(tree.child[node])
    return [~child] if child < 0 else _below(tree, child) + _below(tree, child + 1)


@pytest.mark.parametrize("kind", ["random", "equal", "flat"])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_every_leaf_is_there_once_and_every_node_is_the_box_of_its_leaves(n: int, kind: str):
    """From a single leaf to a mesh, with boxes that are all alike, and without extent."""
    lower, upper = _leaves(n, kind)
    tree = build_tree(lower, upper)
    assert len(tree.child) == len(tree.center) == len(tree.half) == 2 * n - 1
    assert sorted(_below(tree, 0)) == list(range(n))
    for node in range(len(tree.child)):
        below = _below(tree, node)
        np.testing.assert_allclose(tree.center[node] - tree.half[node], lower[below].min(axis=0), atol=1e-12)
        np.testing.assert_allclose(tree.center[node] + tree.half[node], upper[below].max(axis=0), atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_children_are_given_once_and_behind_their_parents(n: int):
    """The root is the first node, and no node but the root has no parent."""
    tree = build_tree(*_leaves(n, "random"))
    inner = np.flatnonzero(tree.child >= 0)
    assert (tree.child[inner] > inner).all()
    children = np.concatenate([tree.child[inner], tree.child[inner] + 1])
    assert sorted(children) == list(range(1, len(tree.child)))


@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_a_tree_is_no_deeper_than_halving_makes_it(n: int):
    """Its depth bounds the stack of the collision test."""
    tree = build_tree(*_leaves(n, "random"))

    def deep(node: int) -> int:
        child = int(tree.child[node])
        return 0 if child < 0 else 1 + max(deep(child), deep(child + 1))

    assert deep(0) == int(np.ceil(np.log2(n)))
