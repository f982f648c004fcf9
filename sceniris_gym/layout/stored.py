"""A generator that serves stored layouts: for tests, and for evaluation on a fixed set."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})

VALID = 1


@dataclass(frozen=True)
class ServedLayouts:
    """The rows served last, one per world, under the names of Layouts.

    Attributes:
        seed: seed of each world, shape (nworld,), uint64
        episode: episode of each world, -1 before the first, shape (nworld,), int32
        qpos: joint positions [m, rad], shape (nworld, nq)
        mocap_pos: positions of mocap bodies [m], world frame, shape (nworld, nmocap)
        mocap_quat: their orientations, wxyz inside wp.quat, shape (nworld, nmocap)
        status: 1 (valid) once a world has been served, 0 before, shape (nworld,), int32
        reaching: None, as grasps are not stored
    """

    seed: wp.array
    episode: wp.array
    qpos: wp.array
    mocap_pos: wp.array
    mocap_quat: wp.array
    status: wp.array
    reaching: None = None


@wp.kernel
def _serve(
    # Stored in:
    stored_qpos: wp.array2d[float],
    stored_mocap_pos: wp.array2d[wp.vec3],
    stored_mocap_quat: wp.array2d[wp.quat],
    # In:
    mask: wp.array[wp.bool],
    seed: wp.array[wp.uint64],
    # Layouts out:
    episode_out: wp.array[int],
    qpos_out: wp.array2d[float],
    mocap_pos_out: wp.array2d[wp.vec3],
    mocap_quat_out: wp.array2d[wp.quat],
    status_out: wp.array[int],
):
    worldid = wp.tid()
    if not mask[worldid]:
        return
    episode = episode_out[worldid] + 1
    row = int((seed[worldid] + wp.uint64(episode)) % wp.uint64(stored_qpos.shape[0]))
    for i in range(stored_qpos.shape[1]):
        qpos_out[worldid, i] = stored_qpos[row, i]
    for i in range(stored_mocap_pos.shape[1]):
        mocap_pos_out[worldid, i] = stored_mocap_pos[row, i]
        mocap_quat_out[worldid, i] = stored_mocap_quat[row, i]
    episode_out[worldid] = episode
    status_out[worldid] = VALID


@wp.kernel
def _reseed(
    mask: wp.array[wp.bool],
    seed_in: wp.array[wp.uint64],
    seed_out: wp.array[wp.uint64],
    episode_out: wp.array[int],
):
    worldid = wp.tid()
    if mask[worldid]:
        seed_out[worldid] = seed_in[worldid]
        episode_out[worldid] = -1


class StoredGenerator:
    """Serves row `(seed + episode) mod nrow` of stored layouts, with the interface of LayoutGenerator.

    Args:
        rows: has `qpos` (nrow, nq), `mocap_pos` (nrow, nmocap, 3) and `mocap_quat` (nrow, nmocap, 4) wxyz as numpy
            arrays
        nworld: number of worlds
        seed: seed of world 0, world i has seed + i; or one seed per world
        device: Warp device; None is Warp's current one
    """

    def __init__(self, rows: Any, nworld: int, *, seed: int | Sequence[int] = 0, device: str | None = None) -> None:
        self.device = wp.get_device(device)
        seeds = [seed + i for i in range(nworld)] if isinstance(seed, int) else seed
        with wp.ScopedDevice(self.device):
            self._qpos = wp.array(rows.qpos, dtype=float, ndim=2)
            self._mocap_pos = wp.array(rows.mocap_pos, dtype=wp.vec3, ndim=2)
            self._mocap_quat = wp.array(rows.mocap_quat, dtype=wp.quat, ndim=2)
            self._all = wp.ones(nworld, dtype=wp.bool)
            self.layouts = ServedLayouts(
                seed=wp.array(np.asarray(seeds, np.uint64), dtype=wp.uint64),
                episode=wp.full(nworld, -1, dtype=int),
                qpos=wp.zeros((nworld, self._qpos.shape[1]), dtype=float),
                mocap_pos=wp.zeros((nworld, self._mocap_pos.shape[1]), dtype=wp.vec3),
                mocap_quat=wp.zeros((nworld, self._mocap_pos.shape[1]), dtype=wp.quat),
                status=wp.zeros(nworld, dtype=int),
            )

    def reseed(self, seeds: Any, mask: wp.array | None = None) -> None:
        """Give the masked worlds (None: all) new seeds, shape (nworld,); their next layouts are of episode 0."""
        if not isinstance(seeds, wp.array):
            seeds = wp.array(np.asarray(seeds, np.uint64), dtype=wp.uint64, device=self.device)
        wp.launch(
            _reseed,
            dim=seeds.shape[0],
            inputs=[self._all if mask is None else mask, seeds],
            outputs=[self.layouts.seed, self.layouts.episode],
            device=self.device,
        )

    def generate(self, mask: wp.array | None = None) -> None:
        """Serve the next row to the masked worlds (None: all). No allocation and no host synchronisation."""
        out = self.layouts
        mask = self._all if mask is None else mask
        wp.launch(
            _serve,
            dim=out.episode.shape[0],
            inputs=[self._qpos, self._mocap_pos, self._mocap_quat, mask, out.seed],
            outputs=[out.episode, out.qpos, out.mocap_pos, out.mocap_quat, out.status],
            device=self.device,
        )

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """Return no counts: stored layouts are not searched for."""
        return {}
