"""Check of heaps: their things lie in the container as one of the settled rows has them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from sceniris_gym.audit.carriers import carrier_of
from sceniris_gym.audit.geometry import Poses, rotation
from sceniris_gym.config.scene import SceneConfig

DEEPEST = 1e-3  # m; greatest depth of the soft contacts of a heap
AS_SETTLED = 1e-5  # m, and per entry of a rotation matrix; greatest difference from a settled row


class HeapAudit:
    """Judges heaps by the file of their rows, with a reader of its own.

    Args:
        config: The scene.
        mjm: The model.
        bodies: Object name -> root body id.
    """

    def __init__(self, config: SceneConfig, mjm: mujoco.MjModel, bodies: Mapping[str, int]) -> None:
        self.config, self.mjm, self.bodies = config, mjm, bodies
        self.things = frozenset(name for heap in config.heaps.values() for name in heap.of)

    def may_touch(self) -> dict[tuple[int, int], float]:
        """Return pairs of geoms, the lower id first, that were settled together -> greatest depth [m]."""
        found = {}
        for heap in self.config.heaps.values():
            roots = {self.bodies[name] for name in heap.of}
            filled = self._rigid(self._filled(heap.fill))
            things = [g for g in range(self.mjm.ngeom) if self.mjm.body_rootid[self.mjm.geom_bodyid[g]] in roots]
            walls = [g for g in range(self.mjm.ngeom) if int(self.mjm.geom_bodyid[g]) in filled]
            for i, one in enumerate(things):
                for other in (*things[i + 1 :], *walls):
                    if self.mjm.geom_bodyid[one] != self.mjm.geom_bodyid[other]:
                        found[min(one, other), max(one, other)] = DEEPEST
        return found

    def elsewhere(self, poses: Poses) -> dict[str, np.ndarray]:
        """Return thing -> rows in which its heap matches none of the settled rows, shape (nrow,)."""
        found = {}
        for heap in self.config.heaps.values():
            with np.load(Path(str(heap.rows))) as stored:
                pos, quat = stored["pos"].astype(float), stored["quat"].astype(float)
            mats = np.array([rotation(q) for q in quat.reshape(-1, 4)]).reshape(*quat.shape[:2], 3, 3)
            filled = self._filled(heap.fill)
            off = np.zeros((len(poses.xpos), len(pos)))
            for i, name in enumerate(heap.of):
                back = poses.xmat[:, filled].transpose(0, 2, 1)
                at = np.einsum("nij,nj->ni", back, poses.xpos[:, self.bodies[name]] - poses.xpos[:, filled])
                turn = back @ poses.xmat[:, self.bodies[name]]
                off = np.maximum(off, np.abs(at[:, None] - pos[:, i]).max(2))
                off = np.maximum(off, np.abs(turn[:, None] - mats[:, i]).max((2, 3)))
            found |= dict.fromkeys(heap.of, off.min(1) > AS_SETTLED)
        return found

    def _filled(self, fill: str) -> int:
        return carrier_of(self.mjm, self.bodies, self.config, fill).body

    def _rigid(self, body: int) -> set[int]:
        """Return all bodies of an object that are rigidly connected to one of its bodies."""
        top = body
        while self.mjm.body_parentid[top] != 0 and not self.mjm.body_jntnum[top]:
            top = int(self.mjm.body_parentid[top])
        inside = {top}
        for other in range(top + 1, self.mjm.nbody):
            if int(self.mjm.body_parentid[other]) in inside and self.mjm.body_jntnum[other] == 0:
                inside.add(other)
        return inside
