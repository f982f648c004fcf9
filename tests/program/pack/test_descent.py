"""Start of the collision test: every pair of leaves is met once, or left out."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.geometry.colliders import Collider, build_tree, collect_colliders
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.program.pack.descent import Trees


def _leaves(child: np.ndarray, node: int) -> list[int]:
    """Leaves below a node of the trees of all colliders."""
    return [node] if child[node] < 0 else _leaves(child, child[node]) + _leaves(child, child[node] + 1)


def _random_colliders(sizes: list[int]) -> list[Collider]:
    """Colliders, one a body, over so many random boxes each."""
    colliders, nodes, draws = [], 0, np.random.default_rng(3)
    for body, size in enumerate(sizes):
        middle, half = draws.normal(size=(size, 3)), draws.uniform(0.0, 0.3, (size, 3))
        center, half, child = build_tree(middle - half, middle + half)
        child = np.where(child < 0, child, child + nodes)
        colliders.append(Collider(body, 0, -1, nodes, center, half, child))
        nodes += len(child)
    return colliders


@pytest.mark.parametrize("lanes", [1, 4, 32, 33, 10_000])
@pytest.mark.parametrize("sizes", [[1, 1], [1, 40], [7, 13, 1, 30]], ids=str)
def test_lanes_begin_with_what_meets_every_pair_of_leaves_once(sizes: list[int], lanes: int):
    """Whatever is opened ahead of time: nothing is left out and nothing tested twice, and no lane is without work."""
    colliders = _random_colliders(sizes)
    pairs = [(a, b) for a in range(len(sizes)) for b in range(a + 1, len(sizes))]
    roots = [(5 + i, colliders[a].root, colliders[b].root) for i, (a, b) in enumerate(pairs)]
    entries = Trees(colliders).first_nodes(roots, lanes)
    child = np.concatenate([c.child for c in colliders])
    for i, (a, b) in enumerate(pairs):
        met = [
            (x, y)
            for pair, node, other in entries
            if pair == 5 + i
            for x in _leaves(child, node)
            for y in _leaves(child, other)
        ]
        wanted = [(x, y) for x in _leaves(child, colliders[a].root) for y in _leaves(child, colliders[b].root)]
        assert sorted(met) == sorted(wanted)
    every = sum(sizes[a] * sizes[b] for a, b in pairs)
    assert min(max(lanes, len(pairs)), every) <= len(entries) <= max(lanes, len(pairs))


def test_without_pairs_no_lane_has_anything_to_begin_with():
    """An object that meets nothing is an object."""
    assert Trees(_random_colliders([3])).first_nodes([], 32) == []


@pytest.mark.parametrize("lanes", [1, 32])
@pytest.mark.parametrize(("sizes", "count"), [([1, 1], 1), ([1, 40], 3), ([7, 13], 5), ([7, 13], 91)], ids=str)
def test_what_is_left_out_is_met_by_nothing(sizes: list[int], count: int, lanes: int):
    """All other pairs of leaves are met once, before and after boxes are opened for more lanes."""
    colliders = _random_colliders(sizes)
    child = np.concatenate([c.child for c in colliders])
    every = [(x, y) for x in _leaves(child, colliders[0].root) for y in _leaves(child, colliders[1].root)]
    chosen = np.random.default_rng(1).permutation(len(every))[:count]
    left_out = [every[i] for i in chosen]
    nodes = Trees(colliders).without(colliders[0].root, colliders[1].root, left_out)
    entries = Trees(colliders).first_nodes([(0, *pair) for pair in nodes], lanes)
    met = [(x, y) for _, a, b in entries for x in _leaves(child, a) for y in _leaves(child, b)]
    assert sorted(met + left_out) == sorted(every)


def test_leaves_are_found_by_their_nodes():
    """Each piece at one node without children."""
    colliders = _random_colliders([5])
    found = Trees(colliders).leaves(0)
    assert sorted(found.values()) == [0, 1, 2, 3, 4]
    assert sorted(found) == np.flatnonzero(colliders[0].child < 0).tolist()


def test_a_plane_is_the_leaf_of_its_root():
    """By the number of its piece, among other pieces of the world."""
    geoms = "".join(f'<geom type="{kind}" size=".1 .1 .1" pos="0 0 {z}"/>' for z, kind in enumerate(["box", "plane"]))
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    colliders = collect_colliders(extract_pieces(mjm, "physics"), False, "cpu")
    (plane,) = (i for i, collider in enumerate(colliders) if collider.plane >= 0)
    assert Trees(colliders).leaves(plane) == {colliders[plane].root: colliders[plane].plane}
