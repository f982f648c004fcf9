"""Reliability of reachability: verdicts on random TCP poses compared with exact inverse kinematics.

python -m benchmarks.reach [--arms panda ur5e heron] [--n 6000] [--seed 0] [--device cuda:0] [--tiers map ik]

Set A: positions uniform in a cylinder of about the arm's reach, orientations uniform. Set B: straight down, any yaw, in
a box in front of the arm. The ground truth (tests/oracle/exact_ik.py: a joint configuration within limits brings the
TCP within 1 mm and 0.5 degrees) takes minutes and is cached in `--truth`. The output is lines of JSON: one for each
arm's map, then one for each arm, set and tier. All shares are of all poses, except `false_of_accepted`, which is of the
poses that a tier accepts.

`solve` is inverse kinematics alone. `ik` also requires that the arm does not hit itself. For arms with six joints,
where all solutions can be tried, it is compared with a ground truth that requires the same. A Panda has no such row:
each of its poses has a curve of solutions, and steps along it do not prove that all of them hit the arm. `sampled` is
the baseline, a map filled with random joint configurations. A map's verdicts are looked up again after base and target
have moved together, and after the target has rotated about the base; `changed` is the share that changed in the worse
of both cases, `changed_beside_mixed` the number of changes where neither cell was mixed.

The exit status is 1 if an arm's default tier or `map_strict` misses a target, or if MuJoCo's forward kinematics does
not confirm a solution.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

from benchmarks.sampled_map import SampledMap, sampled_map
from sceniris_gym.commands.reach import judge_poses, read_arm
from sceniris_gym.config.tier import Tier, Verdict
from sceniris_gym.layout.compile import device_name
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.lookup import look_up
from sceniris_gym.reach.map import ReachMap, default_tier, map_file
from sceniris_gym.reach.solve import POS_TOL, ROT_TOL, solve
from tests.oracle.exact_ik import ExactIk

# Radius and height [m] of the cylinders of set A: as far as the TCP gets, with a little room for the Panda.
CYLINDERS = {"panda": (1.05, 1.35), "ur5e": (1.10, 1.25), "heron": (0.80, 1.05)}
BOX = ((0.1, -0.8, 0.0), (1.0, 0.8, 0.3))  # of set B, x, y and z [m]
TIERS = ("map", "map_strict", "solve", "ik", "sampled")
ACCURACY, FALSE, FALSE_STRICT, CHANGED = 0.995, 0.005, 0.001, 0.005


@dataclass(frozen=True, eq=False)
class Asked:
    """Poses of the TCP in the base frame, shape (N, 4, 4), and the ground truth for them, shape (N,), bool.

    Attributes:
        reached: a joint configuration within limits reaches the pose within tolerance.
        exact: a joint configuration within limits reaches the pose exactly.
        free: at least one exact solution has no self collision; None where not all of them can be tried.
    """

    poses: np.ndarray
    reached: np.ndarray
    exact: np.ndarray
    free: np.ndarray | None


def draw(kind: str, name: str, num: int, seed: int) -> np.ndarray:
    """Draw the TCP poses of set 'A' or 'B' in the base frame, shape (num, 4, 4)."""
    rng = np.random.default_rng([seed, "AB".index(kind)])
    poses = np.tile(np.eye(4), (num, 1, 1))
    if kind == "A":
        radius, height = CYLINDERS[name]
        r, angle = radius * np.sqrt(rng.uniform(size=num)), rng.uniform(-np.pi, np.pi, num)
        poses[:, :3, 3] = np.stack([r * np.cos(angle), r * np.sin(angle), rng.uniform(0.0, height, num)], axis=1)
        poses[:, :3, :3] = Rotation.random(num, rng=rng).as_matrix()
    else:
        poses[:, :3, 3] = rng.uniform(*BOX, (num, 3))
        poses[:, :3, :3] = about_z(rng.uniform(-np.pi, np.pi, num)) @ np.diag([1.0, -1.0, -1.0])
    return poses


def about_z(angle: np.ndarray) -> np.ndarray:
    """Rotations about z, shape (N, 3, 3)."""
    return Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0])).as_matrix()


def know(name: str, arm: SerialArm, kind: str, num: int, seed: int, folder: Path) -> Asked:
    """Return a set of poses with their ground truth, cached in a file of the folder."""
    path = folder / f"reach_{name}_{arm.hash}_{kind}_{num}_{seed}.npz"
    poses = draw(kind, name, num, seed)
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        parts = np.array_split(poses, -(-num // 250))
        with ProcessPoolExecutor(os.cpu_count()) as pool:
            found = list(pool.map(_truth, [name] * len(parts), parts))
        reached, exact, free = (np.concatenate(column) for column in zip(*found, strict=True))
        np.savez(path, reached=reached, exact=exact, free=free)
    with np.load(path) as stored:
        free = stored["free"] if len(arm.joints) == 6 else None
        return Asked(poses, stored["reached"], stored["exact"], free)


def _truth(name: str, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    mjm = read_arm(name).mjm
    ik = ExactIk(mjm, name)
    reached, _, exact = ik.reachable(poses)
    free = np.zeros(len(poses), bool)
    if len(ik.screws.lower) == 6:
        data = mujoco.MjData(mjm)
        mujoco.mj_resetDataKeyframe(mjm, data, 0)
        for i in np.flatnonzero(exact):
            free[i] = not all(hits_itself(mjm, data, q) for q in ik.solutions(poses[i]))
    return reached, exact, free


def hits_itself(mjm: mujoco.MjModel, data: mujoco.MjData, joints: np.ndarray) -> bool:
    """Return whether MuJoCo reports a contact of the arm, alone in its model, at joints (n,)."""
    data.qpos[: len(joints)] = joints
    mujoco.mj_kinematics(mjm, data)
    mujoco.mj_comPos(mjm, data)
    mujoco.mj_collision(mjm, data)
    return bool((data.contact.dist[: data.ncon] < 0.0).any())


def moved(poses: np.ndarray, seed: int) -> Iterator[np.ndarray]:
    """Yield the poses in the base frame after base and target moved together, and after the target rotated about z.

    World poses are rounded to float32, as in a simulation.
    """
    rng = np.random.default_rng([seed, 2])
    base = np.tile(np.eye(4), (len(poses), 1, 1))
    base[:, :3, :3] = about_z(rng.uniform(-np.pi, np.pi, len(poses)))
    base[:, :3, 3] = rng.uniform(-2.0, 2.0, (len(poses), 3))
    world = (base @ poses).astype(np.float32)
    base = base.astype(np.float32)
    back = np.swapaxes(base[:, :3, :3], 1, 2)
    together = world.copy()
    together[:, :3, :3] = back @ world[:, :3, :3]
    together[:, :3, 3] = np.einsum("nij,nj->ni", back, world[:, :3, 3] - base[:, :3, 3])
    yield together
    turned = poses.copy()
    turned[:, :3] = about_z(rng.uniform(-np.pi, np.pi, len(poses))) @ poses[:, :3]
    yield turned.astype(np.float32)


def score(accepted: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Compare verdicts with the ground truth, both (N,), bool."""
    wrong = accepted & ~truth
    return {
        "accuracy": float((accepted == truth).mean()),
        "false_positives": float(wrong.mean()),
        "false_of_accepted": float(wrong.sum() / max(accepted.sum(), 1)),
        "false_negatives": float((~accepted & truth).mean()),
    }


def by_map(look: Callable[[np.ndarray], np.ndarray], tier: str, asked: Asked, seed: int) -> dict[str, Any]:
    """Evaluate a map by its lookup, poses (N, 4, 4) to Verdicts (N,), also for poses that were moved."""
    least = Verdict.MIXED_YES if tier == "sampled" else Tier.of(tier).least_verdict
    verdicts = look(asked.poses)
    accepted = verdicts >= least
    mixed = np.isin(verdicts, (Verdict.MIXED_NO, Verdict.MIXED_YES))
    changed, beside = 0.0, 0
    for poses in moved(asked.poses, seed):
        again = look(poses)
        change = (again >= least) != accepted
        changed = max(changed, float(change.mean()))
        beside += int((change & ~mixed & np.isin(again, (Verdict.NO, Verdict.YES))).sum())
    return score(accepted, asked.reached) | {
        "accuracy_without_tolerance": float((accepted == asked.exact).mean()),
        "mixed": float(mixed.mean()),
        "changed": changed,
        "changed_beside_mixed": beside,
    }


def by_solve(mjm: mujoco.MjModel, arm: SerialArm, asked: Asked, device: str) -> dict[str, Any]:
    """Evaluate inverse kinematics, and check each solution with MuJoCo's forward kinematics."""
    quat = Rotation.from_matrix(asked.poses[:, :3, :3]).as_quat(scalar_first=True)
    flat = np.concatenate([asked.poses[:, :3, 3], quat], axis=1)
    solve(arm, flat[:1], device)  # compiles
    start = time.perf_counter()
    joints, accepted = solve(arm, flat, device)
    seconds = time.perf_counter() - start
    data = mujoco.MjData(mjm)
    broken = 0
    for pose, q in zip(asked.poses[accepted], joints[accepted], strict=True):
        data.qpos[arm.qposadr] = q
        mujoco.mj_kinematics(mjm, data)
        distance = np.linalg.norm(data.site(arm.tcp_site).xpos - pose[:3, 3])
        turn = Rotation.from_matrix(data.site(arm.tcp_site).xmat.reshape(3, 3).T @ pose[:3, :3])
        within = ((q >= arm.lower) & (q <= arm.upper)).all()
        broken += not (within and distance < POS_TOL and turn.magnitude() < ROT_TOL)
    return score(accepted, asked.reached) | {"false_accepts": broken, "poses_per_s": round(len(flat) / seconds)}


@dataclass(frozen=True, eq=False)
class Subject:
    """An arm with its maps; None for a map that it does not have or that was not asked for."""

    mjm: mujoco.MjModel
    arm: SerialArm
    reach_map: ReachMap | None
    sampled: SampledMap | None
    device: str

    def judge(self, tier: str, asked: Asked, seed: int) -> dict[str, Any] | None:
        """Evaluate a tier on a set; None if that is not possible."""
        if tier == "solve":
            return by_solve(self.mjm, self.arm, asked, self.device)
        if tier == "ik" and asked.free is not None:
            # Poses that are reachable only within the tolerance count as neither right nor wrong here.
            sure = asked.exact == asked.reached
            return score(
                judge_poses(self.mjm, self.arm, None, asked.poses[sure], Tier.IK, self.device), asked.free[sure]
            )
        if tier == "sampled" and self.sampled is not None:
            sampled = self.sampled
            return by_map(lambda poses: np.where(sampled.verdict(poses), Verdict.YES, Verdict.NO), tier, asked, seed)
        if tier in ("map", "map_strict") and self.reach_map is not None:
            reach_map = self.reach_map
            return by_map(lambda poses: reach_map.verdict(poses, self.device), tier, asked, seed)
        return None


def holds(row: dict[str, Any]) -> bool:
    """Return whether the row meets the targets of the table."""
    if row["tier"] == "sampled":
        return True
    kept = row.get("false_accepts", 0) == 0 and row.get("changed_beside_mixed", 0) == 0
    kept &= row.get("changed", 0.0) <= CHANGED
    if row["tier"] in ("solve", "ik"):
        kept &= row["false_positives"] == 0.0
    if row["tier"] == "map_strict":
        kept &= row["false_of_accepted"] <= FALSE_STRICT
    if row["default"]:
        kept &= row["accuracy"] >= ACCURACY and row["false_of_accepted"] <= FALSE
    return kept


def lookup_rate(reach_map: ReachMap, device: str | None, num: int, repeats: int = 20) -> float:
    """Look up `num` random poses in the box of a map; return the rate [1/s], the median of `repeats` rounds."""
    draws = np.random.default_rng(0)
    half, middle = -reach_map.u_low, reach_map.arm.axis_xy
    high = reach_map.z_low + reach_map.step * (reach_map.nz - 1)
    axis = draws.standard_normal((num, 3), dtype=np.float32)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    pos = draws.uniform([*(middle - half), reach_map.z_low], [*(middle + half), high], (num, 3))
    with wp.ScopedDevice(device) as scope:
        arrays = (wp.array(pos, dtype=wp.vec3), wp.array(axis, dtype=wp.vec3), wp.zeros(num, dtype=wp.uint8))
        view, seconds = reach_map.view(scope), []
        for _ in range(repeats + 1):
            wp.synchronize_device()
            start = time.perf_counter()
            look_up(view, *arrays)
            wp.synchronize_device()
            seconds.append(time.perf_counter() - start)
    return num / float(np.median(seconds[1:]))


def rows(name: str, args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield the lines for an arm."""
    _, mjm, arm = read_arm(name)
    path = map_file(name) if args.maps is None else args.maps / f"{name}.reach"
    reach_map = ReachMap.load(path, arm) if path is not None and path.is_file() else None
    if reach_map is None or path is None:
        print(f"{name} has no map: nothing is said about it", file=sys.stderr)
    else:
        memory, witnesses = reach_map.nbytes
        yield {
            "arm": name,
            "limited": reach_map.limited,
            "turn_error": reach_map.turn_error,
            "map_bytes": memory,
            "witness_bytes": witnesses,
            "file_bytes": path.stat().st_size,
            "lookups_per_s": round(lookup_rate(reach_map, args.device, args.lookups)),
        }
    sampled = None
    if "sampled" in args.tiers:
        sampled = sampled_map(arm, args.device, samples=args.samples, seed=args.seed)
    subject = Subject(mjm, arm, reach_map, sampled, args.device)
    for kind in "AB":
        asked = know(name, arm, kind, args.n, args.seed, args.truth)
        about = {"arm": name, "set": kind, "n": args.n, "seed": args.seed, "reachable": float(asked.reached.mean())}
        for tier in args.tiers:
            found = subject.judge(tier, asked, args.seed)
            if found is not None:
                row = about | {"tier": tier, "default": tier == default_tier(arm, reach_map).word} | found
                yield row | {"holds": holds(row)}


def main() -> int:
    """Print the rows of the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="+", default=list(CYLINDERS), choices=list(CYLINDERS))
    parser.add_argument("--tiers", nargs="+", default=list(TIERS), choices=TIERS)
    parser.add_argument("--n", type=int, default=6000, help="poses per set")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default=None)
    parser.add_argument("--maps", type=Path, default=None, help="folder of maps, ARM.reach; else the shipped ones")
    parser.add_argument("--truth", type=Path, default=Path("results"), help="folder where the ground truth is cached")
    parser.add_argument("--lookups", type=int, default=1 << 24, help="poses in each timed round of lookups")
    parser.add_argument("--samples", type=int, default=20_000_000, help="joint configurations sampled for the baseline")
    args = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING  # what Warp compiles is not part of the output
    args.device = device_name(args.device, "reach")
    kept = True
    for name in args.arms:
        for row in rows(name, args):
            kept &= row.get("holds", True)
            print(json.dumps(row), flush=True)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
