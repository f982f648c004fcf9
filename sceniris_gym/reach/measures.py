"""Parts of a map's build: TCP axes at joint positions, the choice of witnesses, and the fraction of false accepts."""

from collections.abc import Iterator

import numpy as np
import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.transforms import z_axis
from sceniris_gym.progress import tell
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.map import WITNESS_CELLS, ReachMap
from sceniris_gym.reach.solve import ITERATIONS, RESTARTS, ArmView, arm_view, as_vec8, forward, solve, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

POSES = 4096
"""Accepted poses to solve in each set. The standard error of a fraction of 0.5% is then 0.1%."""

# Nonzero entries of the wxyz quaternion: any orientation, straight up, straight down.
_SETS = ((0, 1, 2, 3), (0, 3), (1, 2))
_LEAST = 256  # a set with fewer accepted poses is ignored, because layouts rarely request such poses
_DRAWS, _ROUNDS = 1 << 16, 16
# Restarts and steps for all poses, then for unsolved poses. We checked 61,440 poses accepted by the maps of a Panda, a
# UR5e and Heron. Unsolved poses have no exact closed-form solution, and one in 2,500 has a solution within tolerance.
_EFFORTS = ((RESTARTS, ITERATIONS), (2 * RESTARTS, 2 * ITERATIONS))
BRANCHES = 4
"""Maximum number of witnesses of a cell. Witnesses with the largest differences in joint positions are kept."""
_CANDIDATES = 64  # number of corners of a cell to choose from


@wp.kernel
def _tcp_axes(
    # Arm:
    arm: ArmView,
    # In:
    joints: wp.array[vec8],
    # Out:
    pos_out: wp.array[wp.vec3],
    approach_out: wp.array[wp.vec3],
):
    poseid = wp.tid()
    pos, quat = forward(arm, joints[poseid])
    pos_out[poseid] = pos
    approach_out[poseid] = z_axis(quat)


def tcp_axes(arm: SerialArm, joints: np.ndarray, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the TCP's position [m] and its unit approach axis for each row of joint positions (N, njoint).

    Both have the shape (N, 3) and are in the base frame of the arm.
    """
    with wp.ScopedDevice(device):
        pos, approach = wp.zeros(len(joints), dtype=wp.vec3), wp.zeros(len(joints), dtype=wp.vec3)
        q = wp.array(as_vec8(joints), dtype=vec8)
        wp.launch(_tcp_axes, dim=len(joints), inputs=[arm_view(arm, device), q], outputs=[pos, approach])
        return pos.numpy(), approach.numpy()


def measure_false_accepts(reach_map: ReachMap, device: str) -> float | None:
    """Measure which fraction of the poses accepted by a map are out of reach within joint limits.

    Poses come from three sets: any orientation, straight up, and straight down. Positions are uniform in the map's box.

    Args:
        reach_map: The map. Its seed determines the poses and the random starts.
        device: Warp's name of the device. One CPU core takes a second, and longer if many poses are out of reach.

    Returns:
        The largest fraction among the sets, or None if the map accepts too few poses of every set.
    """
    shares = []
    for number, members in enumerate(_SETS):
        found = np.concatenate(list(_accepted(reach_map, number, members, device)))[:POSES]
        if len(found) >= _LEAST:
            missed = found  # poses not solved yet. The starts differ from the map's own starts
            for i, (restarts, iterations) in enumerate(_EFFORTS, start=1):
                seed = reach_map.seed + i
                _, ok = solve(reach_map.arm, missed, device, restarts=restarts, iterations=iterations, seed=seed)
                missed = missed[~ok]
            shares.append(len(missed) / len(found))
        tell("false accepts", number + 1, len(_SETS))
    return max(shares, default=None)


def _accepted(reach_map: ReachMap, number: int, members: tuple[int, ...], device: str) -> Iterator[np.ndarray]:
    """Draw poses, and yield the poses that a map accepts, until `POSES` are found or `_ROUNDS` rounds are over.

    Args:
        reach_map: The map.
        number: Index in `_SETS`. Together with the map's seed, it seeds the random numbers.
        members: Indices of the components of the wxyz quaternion that are drawn. The other components are 0.
        device: Warp's name of the device.

    Yields:
        The accepted poses of one round, as position [m] and wxyz quaternion, shape (n, 7).
    """
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


def gather_witnesses(shape: tuple[int, ...], level: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Choose witnesses (start joints for inverse kinematics) among the solutions of a grid's corners.

    Args:
        shape: Numbers of corners along (z, u, tilt, v).
        level: Labels of the corners, 0 if a corner is not reached, shape (N,).
        joints: Joint positions that reach each corner with a label above 0, shape (N, njoint).

    Returns:
        `wit_cells` and `wit_joints`, as in ReachMap.
    """
    meters, radians = WITNESS_CELLS
    sizes = np.array([meters, meters, radians, meters])
    corner = np.flatnonzero(level)
    index = np.stack(np.unravel_index(corner, shape), axis=1) // sizes
    nz, nu, ntilt, nv = -(-np.array(shape) // sizes)
    cell = ((index[:, 0] * ntilt + index[:, 2]) * nu + index[:, 1]) * nv + index[:, 3]
    # Best labels first within each cell: their joints work for the most rotations.
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
    """Return at most BRANCHES rows of `joints`: row 0, then repeatedly the row farthest from all previous ones.

    The first and last joint are ignored, because `lookup.witness` sets them from the base and wrist rotation.
    """
    inner = joints[:, 1:-1]
    picked = [0]
    away = np.abs(inner - inner[0]).sum(axis=1)
    while len(picked) < min(BRANCHES, len(inner)) and away.max(initial=0.0) > 0.2:
        picked.append(int(away.argmax()))
        away = np.minimum(away, np.abs(inner - inner[picked[-1]]).sum(axis=1))
    return np.array(picked)
