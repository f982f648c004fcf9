"""Check of heaps: their things lie in the container as one of the settled rows has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sceniris_gym.audit.geometry import Poses, rotation
from sceniris_gym.audit.scene import JudgedScene

DEEPEST = 1e-3  # m; greatest depth of the soft contacts of a heap
AS_SETTLED = 1e-5  # m, and per entry of a rotation matrix; greatest difference from a settled row


class HeapAudit:
    """Judges heaps by the file of their rows, with a reader of its own.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: JudgedScene) -> None:
        self.mjm, self.bodies = scene.mjm, scene.bodies
        self._filled = [(heap, scene.carrier(heap.fill).body) for heap in scene.config.heaps.values()]

    def may_touch(self) -> dict[tuple[int, int], float]:
        """Return pairs of geoms, the lower id first, that were settled together -> greatest depth [m]."""
        found, of = {}, self.mjm.geom_bodyid
        root, weld = self.mjm.body_rootid[of], self.mjm.body_weldid[of]
        for heap, filled in self._filled:
            things = np.flatnonzero(np.isin(root, [self.bodies[name] for name in heap.of])).tolist()
            rigid = (root == self.mjm.body_rootid[filled]) & (weld == self.mjm.body_weldid[filled])
            walls = np.flatnonzero(rigid).tolist()
            for i, one in enumerate(things):
                for other in (*things[i + 1 :], *walls):
                    if of[one] != of[other]:
                        found[min(one, other), max(one, other)] = DEEPEST
        return found

    def elsewhere(self, poses: Poses) -> dict[str, np.ndarray]:
        """Return thing -> rows in which its heap matches none of the settled rows, shape (nrow,)."""
        found = {}
        for heap, filled in self._filled:
            with np.load(Path(str(heap.rows))) as stored:
                pos, quat = stored["pos"].astype(float), stored["quat"].astype(float)
            mats = rotation(quat)
            off = np.zeros((len(poses.xpos), len(pos)))
            for i, name in enumerate(heap.of):
                back = poses.xmat[:, filled].transpose(0, 2, 1)
                at = np.einsum("nij,nj->ni", back, poses.xpos[:, self.bodies[name]] - poses.xpos[:, filled])
                turn = back @ poses.xmat[:, self.bodies[name]]
                off = np.maximum(off, np.abs(at[:, None] - pos[:, i]).max(2))
                off = np.maximum(off, np.abs(turn[:, None] - mats[:, i]).max((2, 3)))
            found |= dict.fromkeys(heap.of, off.min(1) > AS_SETTLED)
        return found
