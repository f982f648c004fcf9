"""False accepts of a map: the share of accepted poses that inverse kinematics finds out of reach."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sceniris_gym.config.tier import Tier
from sceniris_gym.progress import tell
from sceniris_gym.reach.map import ReachMap
from sceniris_gym.reach.solve import ITERATIONS, RESTARTS, solve

POSES = 4096
"""Accepted poses to solve in each set: the standard error of a share of 0.5% is then 0.1%."""

# Nonzero entries of the wxyz quaternion: any orientation, straight up, straight down.
_SETS = ((0, 1, 2, 3), (0, 3), (1, 2))
_LEAST = 256  # a set with fewer accepted poses among all draws is ignored: layouts hardly ever ask for such poses
_DRAWS, _ROUNDS = 1 << 16, 16
# Restarts and steps: for all poses, then for those still unsolved. Of 61,440 poses that maps of a Panda, a UR5e and
# Heron accept, none that stays unsolved has an exact solution in closed form; one in 2,500 has one within tolerance.
_EFFORTS = ((RESTARTS, ITERATIONS), (2 * RESTARTS, 2 * ITERATIONS))


def measure_false_accepts(reach_map: ReachMap, device: str) -> float | None:
    """Measure the share of the poses accepted by a map that are out of reach, within limits.

    Three sets of poses are uniform over the map's box: in any orientation, straight up and straight down.

    Args:
        reach_map: The map. Its seed determines the poses, and the starts from which they are solved.
        device: Warp's name of the device. One CPU core takes a second, and longer if many poses are out of reach.

    Returns:
        The largest share among the sets; None if the map accepts almost no pose of any set.
    """
    shares = []
    for number, members in enumerate(_SETS):
        found = np.concatenate(list(_accepted(reach_map, number, members, device)))[:POSES]
        if len(found) >= _LEAST:
            missed = found  # not solved from many starts, none of which the map was built from
            for i, (restarts, iterations) in enumerate(_EFFORTS, start=1):
                seed = reach_map.seed + i
                _, ok = solve(reach_map.arm, missed, device, restarts=restarts, iterations=iterations, seed=seed)
                missed = missed[~ok]
            shares.append(len(missed) / len(found))
        tell("false accepts", number + 1, len(_SETS))
    return max(shares, default=None)


def _accepted(reach_map: ReachMap, number: int, members: tuple[int, ...], device: str) -> Iterator[np.ndarray]:
    """Yield poses of a set that the map accepts, as position and wxyz quaternion, until there are POSES of them."""
    draws = np.random.default_rng([reach_map.seed, number])
    half, found = abs(reach_map.u_low), 0
    low = np.array([*(reach_map.arm.axis_xy - half), reach_map.z_low])
    high = low + [2.0 * half, 2.0 * half, reach_map.step * (reach_map.nz - 1)]
    for _ in range(_ROUNDS):
        poses = np.zeros((_DRAWS, 7))
        poses[:, :3] = draws.uniform(low, high, (_DRAWS, 3))
        poses[:, 3 + np.array(members)] = draws.standard_normal((_DRAWS, len(members)))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        w, x, y, z = poses[:, 3:].T
        approach = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z]
        verdict = reach_map.verdict_at(poses[:, :3], np.stack(approach, axis=1), device)
        kept = poses[verdict >= Tier.MAP.least_verdict]
        yield kept
        found += len(kept)
        if found >= POSES:
            break
