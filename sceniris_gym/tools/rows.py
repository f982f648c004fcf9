"""Layouts on the host, as MuJoCo states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True)
class Rows:
    """Layouts as MuJoCo states.

    Attributes:
        qpos: joint positions, shape (nrow, nq).
        mocap_pos: positions of the mocap bodies [m], shape (nrow, nmocap, 3).
        mocap_quat: orientations of the mocap bodies (w, x, y, z), shape (nrow, nmocap, 4).
        present: which objects are there and not left out by their groups, shape (nrow, nslot): the objects in the order
            of the scene file, then the robot if there is one. None where all of them are there.
    """

    qpos: np.ndarray
    mocap_pos: np.ndarray
    mocap_quat: np.ndarray
    present: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.qpos)

    def __getitem__(self, index: slice | np.ndarray) -> Rows:
        present = None if self.present is None else self.present[index]
        return Rows(self.qpos[index], self.mocap_pos[index], self.mocap_quat[index], present)

    def chunks(self, size: int) -> Iterator[tuple[int, Rows]]:
        """Yield the first row index and the rows of each chunk of at most `size` rows."""
        for start in range(0, len(self), size):
            yield start, self[slice(start, start + size)]

    def put(self, data: mujoco.MjData, i: int) -> None:
        """Write row `i` into `data`; nothing is computed from it yet."""
        data.qpos[:] = self.qpos[i]
        data.mocap_pos[:] = self.mocap_pos[i]
        data.mocap_quat[:] = self.mocap_quat[i]
