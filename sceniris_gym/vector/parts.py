"""A joint, its body and its grasps, where the present variant of an object determines them."""

import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import ArgumentError
from sceniris_gym.grasping.grasps import PREFIX
from sceniris_gym.scene.support import subtree
from sceniris_gym.vector import rotations
from sceniris_gym.vector.base_frame import BaseFrame
from sceniris_gym.vector.names import SCALAR, find_body, unknown
from sceniris_gym.vector.variants import VariantView


class _Part:
    """A joint of an object in each of its variants.

    Args:
        view: The present variants.
        name: An object or a robot.
        joint: The joint's name inside it, or one of the object's `parts`.
        where: The caller, for error messages.

    Raises:
        UnknownNameError: The scene has no such object, or it has no such slide or hinge.
    """

    def __init__(self, view: VariantView, name: str, joint: str, where: str) -> None:
        scene, self._view = view.scene, view
        owner = scene.sim.owners.get(find_body(scene.sim, name, where), "")
        self._owner = owner if owner in view.names else None
        joints = [scene.joints(one) for one in scene.config.variants.get(owner, (owner,) if owner else ())]
        scalar = [{local: i for local, i in of.items() if scene.mjm.jnt_type[i] in SCALAR} for of in joints]
        self.ids = [of.get(joint, -1) for of in scalar]
        if max(self.ids, default=-1) < 0:
            raise unknown(scene, f"joint of '{name}'", joint, where, {local for of in scalar for local in of})

    def chosen(self, rows: Tensor) -> Tensor:
        """Return for each world the row of its variant, from rows of all variants and a last one for no variant."""
        return rows[self._view.index(None) if self._owner is None else self._view.number(self._owner)]


class JointReading(_Part):
    """The position of a joint in each world. The arguments are those of the present variants' joints."""

    def __init__(self, view: VariantView, name: str, joint: str, where: str) -> None:
        super().__init__(view, name, joint, where)
        sim = view.scene.sim.mjm
        ids = np.array([*(view.scene.sim_joint(i) if i >= 0 else -1 for i in self.ids), -1])
        self._table = torch.tensor(np.stack([ids, sim.jnt_qposadr[ids], sim.jnt_limited[ids]], 1), device=view.device)

    def read(self, qpos: Tensor, ranges: Tensor) -> Tensor:
        """Return the position [m or rad] and its share of the joint's range, shape (num_envs, 2).

        Args:
            qpos: Joint positions, shape (num_envs, nq).
            ranges: Ranges of all joints, with a row for each world or one for all.
        """
        rows = torch.arange(len(qpos), device=qpos.device)
        joint, adr, limited = self.chosen(self._table).expand(len(qpos), -1).unbind(1)
        position, (low, high) = qpos[rows, adr], ranges[rows % len(ranges), joint].unbind(1)
        share = torch.where(limited > 0, ((position - low) / (high - low)).clamp(0.0, 1.0), torch.nan)
        return torch.where(joint[:, None] >= 0, torch.stack([position, share], dim=1), torch.nan)


class PartBody(_Part):
    """The body of a part in each world."""

    def __init__(self, view: VariantView, name: str, joint: str, where: str) -> None:
        super().__init__(view, name, joint, where)
        scene = view.scene
        bodies = [*(scene.sim_bodies[scene.mjm.jnt_bodyid[i]] if i >= 0 else -1 for i in self.ids), -1]
        self._bodies = torch.tensor(np.array(bodies, int), device=view.device)

    def read(self) -> Tensor:
        """Return the id of the body, -1 in worlds without the part, shape (num_envs,), or (1,) without variants."""
        return self.chosen(self._bodies)


class PartGrasps(_Part):
    """The grasps at a part: the sites `grasp_*` of the joint's body, and of the bodies that move with it.

    Raises:
        UnknownNameError: As in `_Part`.
        ArgumentError: The part has no such site in any variant.
    """

    def __init__(self, view: VariantView, name: str, joint: str, where: str) -> None:
        super().__init__(view, name, joint, where)
        scene, mjm = view.scene, view.scene.mjm
        bodies = [subtree(mjm, int(mjm.jnt_bodyid[i])) if i >= 0 else [] for i in self.ids]
        grasps = [i for i in range(mjm.nsite) if mjm.site(i).name.rpartition("/")[2].startswith(PREFIX)]
        found = [[i for i in grasps if mjm.site_bodyid[i] in of] for of in [*bodies, []]]
        if not any(found):
            raise ArgumentError(f"{where}: part '{joint}' of '{name}' has no sites '{PREFIX}*' in its assets. Add one.")
        body = np.zeros((len(found), max(map(len, found))), int)
        pose = np.full((*body.shape, 7), np.nan, np.float32)
        for row, sites in enumerate(found):
            body[row, : len(sites)] = scene.sim_bodies[mjm.site_bodyid[sites]]
            pose[row, : len(sites)] = np.hstack([mjm.site_pos[sites], mjm.site_quat[sites]])
        self._body, self._pose = torch.tensor(body, device=view.device), torch.tensor(pose, device=view.device)

    def pose(self, base: BaseFrame, xpos: Tensor, xquat: Tensor) -> Tensor:
        """Return the TCP pose of each grasp, shape (num_envs, ngrasp, 7). The arguments are as in `TargetGrasps`."""
        rows, body = torch.arange(len(xpos), device=xpos.device)[:, None], self.chosen(self._body)
        xpos, xquat, (pos, quat) = xpos[rows, body], xquat[rows, body], self.chosen(self._pose).split([3, 4], dim=-1)
        return base.pose(xpos + rotations.rotate(xquat, pos), rotations.multiply(xquat, quat))
