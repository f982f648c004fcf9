"""`JointWriter` sets joint positions and controls that hold them. `PoseWriter` sets poses of free and mocap bodies."""

from collections.abc import Sequence

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.errors import ArgumentError
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.rest import RestMap
from sceniris_gym.sim.versions import sleeps
from sceniris_gym.sim.write import StateWriter, poses_of


class JointWriter:
    """Writes positions of hinges and slides, zero velocities, and the controls and activations that hold these joints.

    A reset would write the same controls and activations for these positions. The histories of delayed actuators are
    filled with these controls.

    Args:
        mjm: The model.
        d: Data of the worlds.
        rest: The controls and activations that hold a pose in each world.
        joints: Ids of the joints.
    """

    def __init__(self, mjm: mujoco.MjModel, d: mjw.Data, rest: RestMap, joints: Sequence[int]) -> None:
        self._qpos = wp.to_torch(d.qpos)
        self._columns = torch.tensor(mjm.jnt_qposadr[list(joints)], dtype=torch.int64, device=self._qpos.device)
        self._mask = torch.zeros(d.nworld, dtype=torch.bool, device=self._qpos.device)
        self._writer = StateWriter(mjm, d, wp.from_torch(self._mask, dtype=wp.bool), rest, joints=joints)
        self._poses = poses_of(d)

    def write(self, qpos: Tensor, mask: Tensor) -> None:
        """Set the joints to `qpos`, shape (num_envs, njoint), in the masked worlds. Other worlds do not change."""
        self._mask.copy_(mask)
        self._qpos[:, self._columns] = torch.where(mask[:, None], qpos, self._qpos[:, self._columns])
        self._writer.launch(self._poses)


class PoseWriter:
    """Writes the pose of a free body or a mocap body. The body is then at rest and awake.

    Args:
        batch: The worlds.
        body: Id of the body.
        device: Torch device.

    Attributes:
        owner: The object with the root body `body`, or None if `body` is another body of the scene's `model`.

    Raises:
        ArgumentError: The body is a robot, a fixture or a static object, or hangs on joints.
    """

    def __init__(self, batch: Batch, body: int, device: torch.device) -> None:
        scene, mjm, data = batch.scene, batch.scene.mjm, batch.data
        self.owner = next((name for name, root in scene.bodies.items() if root == body), None)
        refused = _refused(scene, self.owner, body)
        if refused is not None:
            movable = [name for name, root in scene.bodies.items() if _refused(scene, name, root) is None]
            raise ArgumentError(
                f"scene '{scene.config.name}': State.put_pose: '{self.owner or mjm.body(body).name}' is {refused}. "
                f"Give a free object or a marker: {', '.join(movable) or 'the scene has none'}."
            )
        mocap, joint = int(mjm.body_mocapid[body]), int(mjm.body_jntadr[body])
        if mocap >= 0:
            self._pose = (wp.to_torch(data.mocap_pos)[:, mocap], wp.to_torch(data.mocap_quat)[:, mocap])
        else:
            adr = int(mjm.jnt_qposadr[joint])
            self._pose = (wp.to_torch(data.qpos)[:, adr : adr + 3], wp.to_torch(data.qpos)[:, adr + 3 : adr + 7])
        dofs = np.flatnonzero(np.isin(mjm.dof_bodyid, subtree(mjm, body)))
        self._qvel, self._dofs = wp.to_torch(data.qvel), torch.tensor(dofs, device=device)
        self._trees = torch.tensor(np.unique(mjm.dof_treeid[dofs]), device=device)
        self._sleep = None
        if len(dofs) and sleeps(batch.model):
            self._sleep = wp.to_torch(data.tree_asleep), wp.to_torch(data.tree_awake)

    def write(self, pose: Tensor, mask: Tensor) -> None:
        """Set the pose of the body in the masked worlds. Other worlds do not change.

        Args:
            pose: Position [m] and orientation (wxyz), world frame, shape (nworld, 7).
            mask: Which worlds, shape (nworld,), bool.
        """
        mask = mask[:, None]
        for array, value in zip(self._pose, (pose[:, :3], pose[:, 3:]), strict=True):
            array.copy_(torch.where(mask, value, array))
        self._qvel[:, self._dofs] = torch.where(mask, 0.0, self._qvel[:, self._dofs])
        if self._sleep is not None:
            asleep, awake = self._sleep
            asleep[:, self._trees] = torch.where(mask, -(1 + mujoco.mjMINAWAKE), asleep[:, self._trees])
            awake[:, self._trees] = torch.where(mask, 1, awake[:, self._trees])


def _refused(scene: SceneModel, owner: str | None, body: int) -> str | None:
    """Return the reason why the pose of a body cannot be set, or None if it can be set (a free or a mocap body)."""
    mjm, joint = scene.mjm, int(scene.mjm.body_jntadr[body])
    if owner in scene.config.all_robots:
        return "a robot (set its joints with State.put_joints)"
    if owner is not None and (kind := scene.config.objects[owner].kind) in ("fixture", "static"):
        return f"of the kind '{kind}', which keeps its pose in the layout"
    free = joint >= 0 and mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
    if free or mjm.body_mocapid[body] >= 0:
        return None
    return "not a free or mocap body (set its joints with State.put_joints)"
