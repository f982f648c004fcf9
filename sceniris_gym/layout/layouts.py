"""`Layouts`: what a reset writes, one row per world, and what is counted along the way."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause
from sceniris_gym.program.reach import Reaching
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.scene.addresses import joint_address, pose_address


class Status(IntEnum):
    """What a row holds."""

    NONE = 0
    """Nothing yet, or (only while a scene is being compiled) no valid layout was found."""
    VALID = 1
    """A fresh layout that passed every test."""
    FALLBACK = 2
    """Attempts and restarts ran out: a layout from the split's bank of valid ones in the CompiledScene."""


@wp.struct
class LayoutsView:
    """The arrays of a `Layouts` as device code takes them."""

    seed: wp.array[wp.uint64]
    episode: wp.array[int]
    qpos: wp.array2d[float]
    mocap_pos: wp.array2d[wp.vec3]
    mocap_quat: wp.array2d[wp.quat]
    status: wp.array[int]
    attempts: wp.array[int]
    first_pass_valid: wp.array[int]
    present: wp.array2d[int]
    grasp: wp.array2d[int]
    grasp_qpos: wp.array3d[float]
    pregrasp_qpos: wp.array3d[float]
    rejections: wp.array2d[wp.int64]  # more than 32 bits in long runs
    pending_episode: wp.array[int]  # the episode that is being made
    row_rejections: wp.array3d[int]  # candidates that were rejected for the row, by object and cause
    place: wp.array2d[wp.vec4]
    bounds: wp.array2d[wp.vec4]
    variant: wp.array2d[int]
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.vec4]
    record_all: int
    rejected_count: wp.array[int]
    rejected_cause: wp.array[int]
    rejected_object: wp.array[int]
    rejected_qpos: wp.array2d[float]
    rejected_mocap_pos: wp.array2d[wp.vec3]
    rejected_mocap_quat: wp.array2d[wp.quat]


def _part(poses: wp.array, first: int, dtype: type) -> wp.array:
    """Numbers from `first` on of `poses` (nrow, n, width) as vectors or quaternions (nrow, n), in the same memory."""
    part = wp.array(
        ptr=poses.ptr + 4 * first, dtype=dtype, shape=poses.shape[:2], strides=poses.strides[:2], device=poses.device
    )
    part._ref = poses  # the memory is that of the poses
    return part


@dataclass(frozen=True)
class Layouts(StaysHere):
    """Layouts of `nworld` worlds: Warp arrays on the device of the compiled scene, of which only the contents change.

    Attributes:
        compiled: The scene that the rows belong to.
        view: The arrays as device code takes them; see `create` for their length.
        mocap_pose: What `mocap_pos` and `mocap_quat` are parts of: an unused number, position and orientation, shape
            (nrow, nmocap, 8). So a pose is seven numbers in a row, and a quaternion lies where vectors of four may.
        seed: 64-bit seed of each world, shape (nworld,), uint64.
        episode: Episode of the current row, -1 before the first, shape (nworld,), int32.
        qpos: Joint positions [m, rad] in the order of the MjModel, quaternions wxyz, shape (nworld, nq).
        mocap_pos: Positions of mocap bodies [m], world frame, shape (nworld, nmocap).
        mocap_quat: Their orientations, wxyz inside `wp.quat`, shape (nworld, nmocap).
        status: A `Status` per world, shape (nworld,), int32.
        attempts: Candidates drawn for the row, all objects and restarts together, shape (nworld,), int32.
        first_pass_valid: 1 where no restart was needed, shape (nworld,), int32.
        present: 1 where an object is present, 0 where its group left it out, shape (nworld, nslot), slots in the order
            of `CompiledScene.slots`.
        grasp: The accepted grasp of each ReachTarget, as an index into its GraspSet in `CompiledScene.reaching`; -1
            where the object is absent; shape (nworld, nreach), targets in placement order.
        grasp_qpos: The joints [rad, m] of the target's arm in that grasp, shape (nworld, nreach, MAX_JOINTS); nan
            beyond the arm's joints, and everywhere if the arm's map alone decided.
        pregrasp_qpos: The same for the pre-grasp, shape (nworld, nreach, MAX_JOINTS); nan for tiers below `clear`.
        rejections: Running count of the candidates that were rejected for the layouts in these rows, and for those that
            were in them before, int64, shape (nobject, ncause), objects in placement order.
    """

    SEND = "its arrays as copies on the host, such as layouts.qpos.numpy().copy(), or the ids that make its rows again"

    compiled: CompiledScene
    view: LayoutsView
    mocap_pose: wp.array

    def pose(self, name: str) -> Any:
        """Return the poses of an object as a torch tensor in the memory of the layouts, which later layouts overwrite.

        Args:
            name: An object of the scene, or "robot".

        Returns:
            Position [m] and orientation (wxyz) of its root body in the world frame, shape (nworld, 7).

        Raises:
            UnknownNameError: The scene has no such object.
            NotSupportedError: Its root hangs on joints, from which its pose follows.
        """
        kind, number = pose_address(self.compiled.scene, name, "Layouts.pose")
        if kind == "qpos":
            return wp.to_torch(self.qpos)[:, number : number + 7]
        if kind == "mocap":
            return wp.to_torch(self.mocap_pose)[: self.nworld, number, 1:]
        still = np.concatenate([self.compiled.home_xpos[number], self.compiled.home_xquat[number]])
        return wp.to_torch(wp.array(still, dtype=float, device=self.compiled.device)).expand(self.nworld, 7)

    def joint(self, name: str) -> Any:
        """Return the positions of a joint as a torch tensor in the memory of the layouts, as `pose` does.

        Args:
            name: Its name in the model, `object/joint`, or the name inside its object if only one has it.

        Returns:
            Positions [m or rad], shape (nworld,); for a ball joint or a freejoint shape (nworld, 4) or (nworld, 7).

        Raises:
            UnknownNameError: There is no such joint, or several objects have one of that name.
        """
        adr, width = joint_address(self.compiled.scene, name, "Layouts.joint")
        qpos = wp.to_torch(self.qpos)
        return qpos[:, adr] if width == 1 else qpos[:, adr : adr + width]

    @classmethod
    def create(
        cls, compiled: CompiledScene, nworld: int, *, rejected: int = 0, every_cause: bool = False, rows: int = 0
    ) -> "Layouts":
        """Allocate room for `nworld` layouts, and for a record of the first `rejected` candidates that collided.

        With `every_cause` the record is of all that were rejected where they would have stood. `rows` more layouts that
        are being made follow those of the worlds in `view`.
        """
        device = compiled.device
        mjm = compiled.mjm
        nmocap = max(mjm.nmocap, 1)
        mocap_pos, mocap_quat = np.zeros((nmocap, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (nmocap, 1))
        mocap = np.flatnonzero(mjm.body_mocapid >= 0)
        mocap_pos[mjm.body_mocapid[mocap]] = mjm.body_pos[mocap]  # where those stay that are never placed
        mocap_quat[mjm.body_mocapid[mocap]] = mjm.body_quat[mocap]
        nslot, nrow = len(compiled.home_place), nworld + rows
        view = LayoutsView()
        with wp.ScopedDevice(device):
            view.seed = wp.zeros(nworld, dtype=wp.uint64)
            view.episode = wp.full(nworld, -1, dtype=int)
            view.qpos = wp.array(np.tile(compiled.home_qpos, (nrow, 1)), dtype=float, shape=(nrow, mjm.nq))
            padding = np.zeros((nmocap, 1))
            mocap_pose = wp.array(np.tile(np.hstack([padding, mocap_pos, mocap_quat]), (nrow, 1, 1)), dtype=float)
            view.mocap_pos = _part(mocap_pose, 1, wp.vec3)
            view.mocap_quat = _part(mocap_pose, 4, wp.quat)
            view.status = wp.zeros(nworld, dtype=int)
            view.attempts = wp.zeros(nworld, dtype=int)
            view.first_pass_valid = wp.zeros(nworld, dtype=int)
            view.rejections = wp.zeros((max(len(compiled.placed), 1), len(Cause)), dtype=wp.int64)
            view.pending_episode = wp.full(nworld, -1, dtype=int)
            view.row_rejections = wp.zeros((nrow, *view.rejections.shape), dtype=int)
            view.present = wp.ones((nrow, nslot), dtype=int)
            view.place = wp.array(np.tile(compiled.home_place, (nrow, 1, 1)), dtype=wp.vec4, shape=(nrow, nslot))
            view.bounds = wp.array(np.tile(compiled.home_bounds, (nrow, 1, 1)), dtype=wp.vec4, shape=(nrow, nslot))
            nreach = 0 if compiled.reaching is None else len(compiled.reaching.targets)
            view.variant = wp.zeros((nrow, nreach), dtype=int)
            view.grasp = wp.full((nrow if nreach else nworld, nreach), -1, dtype=int)
            view.grasp_qpos = wp.full((nworld, nreach, MAX_JOINTS), wp.nan, dtype=float)
            view.pregrasp_qpos = wp.full((nworld, nreach, MAX_JOINTS), wp.nan, dtype=float)
            view.body_pos = wp.array(np.tile(compiled.home_xpos, (nrow, 1, 1)), dtype=wp.vec3)
            view.body_quat = wp.array(np.tile(compiled.home_xquat, (nrow, 1, 1)), dtype=wp.vec4)
            view.record_all = int(every_cause)
            view.rejected_count = wp.zeros(1, dtype=int)
            view.rejected_cause = wp.zeros(rejected, dtype=int)
            view.rejected_object = wp.zeros(rejected, dtype=int)
            view.rejected_qpos = wp.zeros((rejected, mjm.nq), dtype=float)
            view.rejected_mocap_pos = wp.zeros((rejected, nmocap), dtype=wp.vec3)
            view.rejected_mocap_quat = wp.zeros((rejected, nmocap), dtype=wp.quat)
        return cls(compiled, view, mocap_pose)

    def _of_worlds(self, array: wp.array) -> wp.array:
        """The rows of the worlds, without those that are being made."""
        if array.shape[0] == self.nworld or array.size == 0:  # Warp cannot slice an array without elements
            return array
        return array[: self.nworld]

    @property
    def nworld(self) -> int:
        """Number of rows."""
        return self.view.seed.shape[0]

    @property
    def reaching(self) -> Reaching | None:
        """The arms, and their reach targets with their grasps; None if there are none."""
        return self.compiled.reaching

    @property
    def seed(self) -> wp.array:
        """See the class."""
        return self.view.seed

    @property
    def episode(self) -> wp.array:
        """See the class."""
        return self.view.episode

    @property
    def qpos(self) -> wp.array:
        """See the class."""
        return self._of_worlds(self.view.qpos)

    @property
    def mocap_pos(self) -> wp.array:
        """See the class."""
        return self._of_worlds(self.view.mocap_pos)

    @property
    def mocap_quat(self) -> wp.array:
        """See the class."""
        return self._of_worlds(self.view.mocap_quat)

    @property
    def status(self) -> wp.array:
        """See the class."""
        return self.view.status

    @property
    def attempts(self) -> wp.array:
        """See the class."""
        return self.view.attempts

    @property
    def first_pass_valid(self) -> wp.array:
        """See the class."""
        return self.view.first_pass_valid

    @property
    def present(self) -> wp.array:
        """See the class."""
        return self._of_worlds(self.view.present)

    @property
    def grasp(self) -> wp.array:
        """See the class."""
        return self._of_worlds(self.view.grasp)

    @property
    def grasp_qpos(self) -> wp.array:
        """See the class."""
        return self.view.grasp_qpos

    @property
    def pregrasp_qpos(self) -> wp.array:
        """See the class."""
        return self.view.pregrasp_qpos

    @property
    def rejections(self) -> wp.array:
        """See the class."""
        return self.view.rejections
