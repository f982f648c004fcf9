"""Witnesses: joint positions that reach a coarse cell of a map, used as starts of inverse kinematics."""

from __future__ import annotations

import numpy as np

from sceniris_gym.reach.map import WITNESS_CELLS

BRANCHES = 4
"""Most witnesses of one cell; those whose joints differ most are kept."""
_CANDIDATES = 64  # corners of a cell to choose from


def gather_witnesses(shape: tuple[int, ...], level: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Choose witnesses among the solutions of a grid's corners.

    Args:
        shape: Corners along (z, u, tilt, v).
        level: Labels of the corners, 0 where they are not reached, shape (N,).
        joints: Solutions of the corners that are reached, shape (N, njoint).

    Returns:
        (address, number) of each cell's witnesses, by (z, tilt, u, v), shape (..., 2), int32, and their joints, shape
        (nwitness, njoint), float16.
    """
    meters, radians = WITNESS_CELLS
    sizes = np.array([meters, meters, radians, meters])
    corner = np.flatnonzero(level)
    index = np.stack(np.unravel_index(corner, shape), axis=1) // sizes
    numbers = -(-np.array(shape) // sizes)
    nz, nu, ntilt, nv = numbers
    cell = ((index[:, 0] * ntilt + index[:, 2]) * nu + index[:, 1]) * nv + index[:, 3]
    # Best labels first within each cell: their joints work for most turns.
    order = np.lexsort((corner, -level[corner].astype(int), cell))
    corner, cell = corner[order], cell[order]
    cells = np.zeros((nz * ntilt * nu * nv, 2), np.int32)
    chosen, total = [np.zeros(0, int)], 0
    for own in np.split(np.arange(len(cell)), np.flatnonzero(np.diff(cell)) + 1) if len(cell) else ():
        candidates = corner[own[:: max(1, len(own) // _CANDIDATES)]]
        picked = candidates[_spread_out(joints[candidates].astype(np.float32))]
        cells[cell[own[0]]] = total, len(picked)
        chosen.append(picked)
        total += len(picked)
    return cells.reshape(nz, ntilt, nu, nv, 2), joints[np.concatenate(chosen)].astype(np.float16)


def _spread_out(joints: np.ndarray) -> np.ndarray:
    """Return up to BRANCHES indices: the first, then repeatedly the one farthest from those picked before.

    The first and last joint are ignored, since they follow the turns of base and wrist.
    """
    inner = joints[:, 1:-1]
    picked = [0]
    away = np.abs(inner - inner[0]).sum(axis=1)
    while len(picked) < min(BRANCHES, len(inner)) and away.max(initial=0.0) > 0.2:
        picked.append(int(away.argmax()))
        away = np.minimum(away, np.abs(inner - inner[picked[-1]]).sum(axis=1))
    return np.array(picked)
