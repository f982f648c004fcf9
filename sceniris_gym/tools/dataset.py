"""Layouts in numbers: made chunk by chunk, kept as arrays, written as a data set with the model they belong to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.layout.generate import LayoutGenerator, as_seeds
from sceniris_gym.layout.layouts import Status
from sceniris_gym.scene.world import World
from sceniris_gym.tools.files import replacing
from sceniris_gym.tools.rows import Rows

CHUNK = 4096  # worlds that are made at once
_OF_REACH = ("grasp", "grasp_pose", "grasp_qpos", "pregrasp_qpos")


@dataclass(frozen=True)
class LayoutTable:
    """Layouts and how they came about, one row each.

    Attributes:
        qpos: joint positions, shape (nrow, nq), float32.
        mocap_pos: positions of the mocap bodies [m], shape (nrow, nmocap, 3), float32.
        mocap_quat: orientations of the mocap bodies (w, x, y, z), shape (nrow, nmocap, 4), float32.
        present: which objects are there and not left out by their groups, shape (nrow, nslot), bool: the objects in the
            order of the scene file, then the robot if there is one.
        valid: whether the layout is freshly made and valid, not one of the bank, shape (nrow,), bool.
        first_pass_valid: whether it was valid without a restart, shape (nrow,), bool.
        attempts: candidates drawn for it, shape (nrow,), int32.
        status: `Status` codes, shape (nrow,), int32.
        seed: seed of the world, shape (nrow,), uint64.
        episode: episode of the world, shape (nrow,), int32.
        grasp: the accepted grasp of each reachable object, its place among the object's grasps, -1 where the object is
            absent, shape (nrow, nreach), int32.
        grasp_pose: its TCP in the world frame, position [m] and orientation (w, x, y, z), nan where there is none,
            shape (nrow, nreach, 7), float32.
        grasp_qpos: the arm's joints [rad or m] in that grasp, nan where only the arm's map was asked, shape (nrow,
            nreach, njoint), float32.
        pregrasp_qpos: the same before the grasp, nan for tiers below `clear`.
    """

    qpos: np.ndarray
    mocap_pos: np.ndarray
    mocap_quat: np.ndarray
    present: np.ndarray
    valid: np.ndarray
    first_pass_valid: np.ndarray
    attempts: np.ndarray
    status: np.ndarray
    seed: np.ndarray
    episode: np.ndarray
    grasp: np.ndarray
    grasp_pose: np.ndarray
    grasp_qpos: np.ndarray
    pregrasp_qpos: np.ndarray

    def __len__(self) -> int:
        return len(self.qpos)

    @property
    def rows(self) -> Rows:
        """The layouts alone."""
        return Rows(self.qpos, self.mocap_pos, self.mocap_quat, self.present)


def read_table(generator: LayoutGenerator, nrow: int | None = None) -> LayoutTable:
    """Copy the first `nrow` layouts (None: all) of a generator to the host."""
    layouts, nmocap = generator.layouts, generator.world.mjm.nmocap

    def read(array: wp.array) -> np.ndarray:
        return array.numpy()[:nrow].copy()  # on a CPU `numpy()` is a view of what the next reset overwrites

    status, grasp = read(layouts.status), read(layouts.grasp)
    njoint = 0 if layouts.reaching is None else len(layouts.reaching.arm.joints)
    rows = Rows(
        read(layouts.qpos),
        read(layouts.mocap_pos)[:, :nmocap],
        read(layouts.mocap_quat)[:, :nmocap],
        read(layouts.present) != 0,
    )
    return LayoutTable(
        **vars(rows),
        valid=status == Status.VALID,
        first_pass_valid=read(layouts.first_pass_valid) != 0,
        attempts=read(layouts.attempts),
        status=status,
        seed=read(layouts.seed),
        episode=read(layouts.episode),
        grasp=grasp,
        grasp_pose=grasp_poses(generator.world, rows, grasp),
        grasp_qpos=read(layouts.grasp_qpos)[:, :, :njoint],
        pregrasp_qpos=read(layouts.pregrasp_qpos)[:, :, :njoint],
    )


def grasp_poses(world: World, rows: Rows, grasp: np.ndarray) -> np.ndarray:
    """Return the TCP poses (x, y, z, w, x, y, z) of grasps in the world frame, shape (nrow, nreach, 7), float32.

    Args:
        world: the scene.
        rows: the layouts.
        grasp: the grasp of each reachable object, -1 for none, shape (nrow, nreach).
    """
    poses = np.full((*grasp.shape, 7), np.nan, np.float32)
    if world.reaching is None:
        return poses
    data = mujoco.MjData(world.mjm)
    for i in range(len(rows)):
        rows.put(data, i)
        mujoco.mj_kinematics(world.mjm, data)
        for k, column in enumerate(world.reaching.columns):
            if grasp[i, k] >= 0:
                g = column.grasps.grasps[grasp[i, k]]
                pos, quat = np.empty(3), np.empty(4)
                mujoco.mju_mulPose(pos, quat, data.xpos[g.body], data.xquat[g.body], g.pos, g.quat)
                poses[i, k] = *pos, *quat
    return poses


def make_table(
    world: World,
    n: int,
    seed: int,
    *,
    split: str = "train",
    chunk: int = CHUNK,
    progress: Callable[[int], object] = lambda _: None,
) -> LayoutTable:
    """Make n layouts: row i is episode 0 of seed + i, whatever n and the size of the chunks are.

    Args:
        world: the scene.
        n: number of layouts.
        seed: seed of the first row.
        split: "train" or "eval".
        chunk: how many are made at once.
        progress: called with the number of layouts made since the last call.

    Raises:
        SeedError: the seed is not a 64-bit integer.
    """
    seeds = as_seeds(seed, n)
    generator = LayoutGenerator(world, min(chunk, n), split=split)
    wanted = np.arange(generator.nworld)
    tables = []
    for start in range(0, n, chunk):
        count = min(chunk, n - start)
        generator.reseed(np.resize(seeds[start : start + count], generator.nworld))
        generator.generate(wp.array(wanted < count, dtype=bool, device=world.device))
        tables.append(read_table(generator, count))
        progress(count)
    columns = {f.name: np.concatenate([getattr(t, f.name) for t in tables]) for f in fields(LayoutTable)}
    return LayoutTable(**columns)


def write_dataset(world: World, table: LayoutTable, folder: Path) -> None:
    """Write `layouts.npz` and `scene.zip`, which stock MuJoCo opens; neither is ever there half written.

    Grasps are in it where anything is to be reachable.

    Args:
        world: the scene.
        table: its layouts.
        folder: where to; made if it is not there.
    """
    columns: dict[str, Any] = {f.name: getattr(table, f.name) for f in fields(LayoutTable)}
    columns["object_names"] = np.array(world.object_names)
    if world.reaching is None:
        columns = {name: column for name, column in columns.items() if name not in _OF_REACH}
    else:
        columns["reachable_names"] = np.array(world.reaching.names)
    with replacing(folder / "scene.zip") as scene, replacing(folder / "layouts.npz") as layouts:
        with scene.open("wb") as file:
            world.scene.spec.to_zip(file)
        with layouts.open("wb") as file:
            np.savez(file, **columns)
