"""Witnesses: solutions of corners in their own coarse cell, a few that differ, and one wherever anything is reached."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sceniris_gym.reach.map import WITNESS_CELLS
from sceniris_gym.reach.witnesses import BRANCHES, gather_witnesses

# Corners along (z, u, tilt, v): fewer than 2048, so that float16 holds the number of each in a joint.
SHAPE = (9, 6, 7, 5)
NCORNER = math.prod(SHAPE)
NJOINT = 6


def _cell(corner: np.ndarray) -> np.ndarray:
    """The coarse cell (z, tilt, u, v) of each corner, shape (N, 4)."""
    z, u, tilt, v = np.unravel_index(corner, SHAPE)
    meters, radians = WITNESS_CELLS
    return np.stack([z // meters, tilt // radians, u // meters, v // meters], axis=1)


def _solutions(share: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random labels, of which so many are not 0, and random joints; the first one is the number of the corner."""
    draws = np.random.default_rng(seed)
    level = np.where(draws.random(NCORNER) < share, draws.integers(1, 256, NCORNER), 0).astype(np.uint8)
    joints = draws.uniform(-2.0, 2.0, (NCORNER, NJOINT)).astype(np.float16)
    joints[:, 0] = np.arange(NCORNER)
    return level, joints


def _chosen(cells: np.ndarray, joints: np.ndarray) -> list[tuple[tuple[int, ...], np.ndarray]]:
    """Index of each cell that has witnesses, and the numbers of the corners they are of."""
    found = []
    for index in np.ndindex(cells.shape[:4]):
        adr, num = cells[index]
        if num:
            found.append((index, joints[adr : adr + num, 0].astype(int)))
    return found


@pytest.mark.parametrize("share", [0.002, 0.05, 1.0])
def test_a_cell_has_witnesses_where_any_of_its_corners_is_reached(share: float):
    """One to four, each the solution of a reached corner of that very cell; no row is in no cell or in two."""
    level, solutions = _solutions(share, 0)
    cells, joints = gather_witnesses(SHAPE, level, solutions)
    found = _chosen(cells, joints)
    assert {index for index, _ in found} == {tuple(row) for row in _cell(np.flatnonzero(level)).tolist()}
    for index, corners in found:
        assert 1 <= len(corners) <= BRANCHES
        assert len(set(corners)) == len(corners)
        assert level[corners].all()
        assert (_cell(corners) == index).all()
    adr, num = cells[cells[..., 1] > 0].T
    assert np.sort(np.concatenate([np.arange(a, a + n) for a, n in zip(adr, num, strict=True)])).tolist() == [
        *range(len(joints))
    ]
    numbers = joints[:, 0].astype(int)
    np.testing.assert_array_equal(joints, solutions[numbers])


def test_cells_cover_the_grid_and_the_last_ones_may_be_smaller():
    """As many along each axis as it takes, in the order (z, tilt, u, v); arrays are as a map keeps them."""
    cells, joints = gather_witnesses(SHAPE, *_solutions(1.0, 1))
    meters, radians = WITNESS_CELLS
    z, u, tilt, v = SHAPE
    assert cells.shape == (*(math.ceil(n / s) for n, s in ((z, meters), (tilt, radians), (u, meters), (v, meters))), 2)
    assert (cells.dtype, joints.dtype) == (np.int32, np.float16)
    assert joints.shape[1] == NJOINT


def test_the_first_witness_of_a_cell_is_one_that_is_reached_in_most_turns():
    """No corner of its cell has a higher label."""
    level, solutions = _solutions(0.3, 2)
    highest: dict[tuple[int, ...], int] = {}
    for index, label in zip(_cell(np.arange(NCORNER)).tolist(), level, strict=True):
        highest[tuple(index)] = max(highest.get(tuple(index), 0), int(label))
    for index, corners in _chosen(*gather_witnesses(SHAPE, level, solutions)):
        assert level[corners[0]] == highest[index]


def test_every_branch_of_a_cell_has_a_witness():
    """Solutions of three ways to bend an arm, spread over all corners: each cell keeps one of each, and no copies."""
    level, solutions = _solutions(1.0, 3)
    branch = np.random.default_rng(4).integers(0, 3, NCORNER)
    ways = np.array([[1.0, -1.5, 0.5, 2.0], [-1.0, 1.5, 0.5, -2.0], [1.0, 0.0, -2.0, 0.5]])
    solutions[:, 1:-1] = ways[branch] + np.random.default_rng(5).uniform(-0.01, 0.01, (NCORNER, 4))
    found = _chosen(*gather_witnesses(SHAPE, level, solutions))
    full = [corners for index, corners in found if (_cell(np.arange(NCORNER)) == index).all(1).sum() > 30]
    assert len(full) > 2
    for corners in full:
        assert sorted(branch[corners]) == [0, 1, 2]


def test_turns_of_base_and_wrist_make_no_branch():
    """Solutions that differ in the first and last joint alone are one: those joints follow the pose."""
    level, solutions = _solutions(1.0, 6)
    solutions[:, 1:-1] = 0.5
    assert all(len(corners) == 1 for _, corners in _chosen(*gather_witnesses(SHAPE, level, solutions)))


def test_where_nothing_is_reached_there_are_no_witnesses():
    """The cells are there and empty."""
    cells, joints = gather_witnesses(SHAPE, np.zeros(NCORNER, np.uint8), _solutions(0.5, 7)[1])
    assert not cells.any()
    assert joints.shape == (0, NJOINT)
