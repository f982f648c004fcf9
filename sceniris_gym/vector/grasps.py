"""`TargetGrasps`: the grasps that the layouts of an object were accepted for."""

from __future__ import annotations

import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.vector import rotations
from sceniris_gym.vector.base_frame import BaseFrame
from sceniris_gym.vector.names import unknown
from sceniris_gym.vector.variants import VariantView


class TargetGrasps:
    """The accepted grasps of a reachable object, of whichever variant is present.

    Args:
        layouts: The layouts of the worlds.
        view: The variants that worlds have.
        name: The object.
        where: Name of the caller in an error.

    Raises:
        UnknownNameError: The object does not have to be reachable, or does not exist.
    """

    def __init__(self, layouts: Layouts, view: VariantView, name: str, where: str) -> None:
        scene, device, reaching = view.scene, view.device, layouts.reaching
        targets = () if reaching is None else reaching.targets
        members = scene.config.variants.get(name, (name,))
        found = [i for i, target in enumerate(targets) if target.name in members]
        if reaching is None or not found:
            valid = {scene.config.owners.get(target.name, target.name) for target in targets}
            raise unknown(scene, "reachable object", name, where, valid)
        self._grasp, self._columns = wp.to_torch(layouts.grasp), torch.tensor(found, device=device)
        self._qpos = {array: wp.to_torch(getattr(layouts, array)) for array in ("grasp_qpos", "pregrasp_qpos")}
        self._joints = len(reaching.arm_of(targets[found[0]]).arm.joints)
        self._rows = torch.arange(len(layouts.grasp), device=device)
        sets = [targets[i].grasp_set.grasps for i in found]
        grasps = [grasp for one in sets for grasp in one]
        # at most one variant has a grasp, and each has its own after those of the variants before
        self._first = torch.tensor(np.cumsum([0, *map(len, sets[:-1])]), device=device)
        self._body = torch.tensor(scene.sim_bodies[[grasp.body for grasp in grasps]], device=device)
        self._pos, self._quat = (
            torch.tensor(np.array(values), dtype=torch.float32, device=device)
            for values in zip(*((grasp.pos, grasp.quat) for grasp in grasps), strict=True)
        )

    def pose(self, base: BaseFrame, xpos: Tensor, xquat: Tensor) -> Tensor:
        """Return the TCP pose of the grasp, shape (num_envs, 7); NaN in worlds without one.

        Args:
            base: The frame of the pose.
            xpos: Positions of all bodies in the world [m], shape (num_envs, nbody, 3).
            xquat: Their orientations there (wxyz), shape (num_envs, nbody, 4).
        """
        own = self._grasp[:, self._columns]  # the number within the set of each variant, -1 for none
        chosen = torch.where(own >= 0, own + self._first, -1).amax(dim=1)
        i = chosen.clamp(min=0).long()
        xpos, xquat = xpos[self._rows, self._body[i]], xquat[self._rows, self._body[i]]
        pos, quat = rotations.rotate(xquat, self._pos[i]), rotations.multiply(xquat, self._quat[i])
        return torch.where(chosen[:, None] >= 0, base.pose(xpos + pos, quat), torch.nan)

    def joints(self, array: str) -> Tensor:
        """Return `grasp_qpos` or `pregrasp_qpos` of the present variant [rad or m], shape (num_envs, joints)."""
        there = self._grasp[:, self._columns].argmax(dim=1)  # absent variants have -1
        return self._qpos[array][self._rows, self._columns[there], : self._joints]
