"""The plain RM4D map, as a baseline: a cell is reached if the TCP of any of many random joint positions falls into it.

M. Rudorfer, "RM4D: A Combined Reachability and Inverse Reachability Map for Common 6-/7-axis Robot Arms by
Dimensionality Reduction to 4D", 2024. Cells that were missed by chance are false negatives, parts of cells that are out
of reach are false positives, and an approach axis that is nearly vertical has no stable frame. The maps of map.py do
better at all three. Joint limits of base and wrist only affect the sampling.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.build import reach_ball
from sceniris_gym.reach.measures import tcp_axes
from sceniris_gym.reach.solve import random_joints

_CHUNK = 1 << 20


@dataclass(frozen=True, eq=False)
class SampledMap:
    """Cells of (z, tilt, u, v) that random joint positions have hit.

    Attributes:
        arm: The arm.
        low: Least coordinates (z, tilt, u, v) [m, rad], shape (4,).
        step: Edges of a cell, shape (4,).
        hit: Which cells were hit, 4D, bool.
    """

    arm: SerialArm
    low: np.ndarray
    step: np.ndarray
    hit: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes in memory at one bit per cell."""
        return self.hit.size // 8

    def verdict(self, poses: np.ndarray) -> np.ndarray:
        """Return which TCP poses in the base frame, shape (N, 4, 4), are in a cell that was hit, shape (N,), bool."""
        cell, inside = _cells(self, poses[:, :3, 3], poses[:, :3, 2])
        found = np.zeros(len(poses), bool)
        found[inside] = self.hit[tuple(cell[inside].T)]
        return found


def sampled_map(
    arm: SerialArm,
    device: str,
    *,
    samples: int = 20_000_000,
    step: float = 0.05,
    tilt_step: float = math.radians(5.0),
    seed: int = 0,
) -> SampledMap:
    """Build the sampled map of an arm whose first axis is vertical and whose TCP is on the last one.

    Args:
        arm: The arm.
        device: Warp's name of the device.
        samples: Random joint positions, uniform within limits.
        step: Edge of a cell along z, u and v [m].
        tilt_step: Edge of a cell along the tilt [rad].
        seed: Seed of the samples.
    """
    height, radius = reach_ball(arm, device, seed)
    half = math.ceil(radius / step)
    low = np.array([height - half * step, 0.0, -half * step, -half * step])
    shape = (2 * half, math.ceil(math.pi / tilt_step), 2 * half, 2 * half)
    found = SampledMap(arm, low, np.array([step, tilt_step, step, step]), np.zeros(shape, bool))
    for chunk in range(0, samples, _CHUNK):
        joints = random_joints(arm, min(_CHUNK, samples - chunk), seed + chunk)
        cell, inside = _cells(found, *tcp_axes(arm, joints, device))
        found.hit[tuple(cell[inside].T)] = True
    return found


def canonical(pos: np.ndarray, approach: np.ndarray, axis_xy: np.ndarray) -> np.ndarray:
    """Return (z, tilt, u, v) [m, rad] of TCP positions and unit approach axes in the base frame, each (N, 3)."""
    x, y = pos[:, 0] - axis_xy[0], pos[:, 1] - axis_xy[1]
    azimuth = np.arctan2(approach[:, 1], approach[:, 0])
    tilt = np.arctan2(np.hypot(approach[:, 0], approach[:, 1]), approach[:, 2])
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.stack([pos[:, 2], tilt, c * x + s * y, c * y - s * x], axis=1)


def _cells(sampled: SampledMap, pos: np.ndarray, approach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of cells, shape (N, 4), and which of them exist, shape (N,)."""
    at = (canonical(pos, approach, sampled.arm.axis_xy) - sampled.low) / sampled.step
    cell = np.floor(at).astype(int)
    cell[:, 1] = np.minimum(cell[:, 1], sampled.hit.shape[1] - 1)  # 180 degrees is the end of the last cell
    return cell, np.all((cell >= 0) & (cell < sampled.hit.shape), axis=1)
