"""`GripCloser`: the joint positions that controls hold at the start: fingers around a thing are asked to close."""

from __future__ import annotations

import numpy as np
import warp as wp

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device_starts import StartPose, Starts
from sceniris_gym.sim.rest import RestMap

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _close(
    # In:
    starts: Starts,
    adr: wp.array2d[int],
    closed: wp.array2d[float],
    mask: wp.array[wp.bool],
    rows: wp.array[int],
    start: wp.array[int],
    poses_have_rows: bool,
    qpos_in: wp.array2d[float],
    # Out:
    held_out: wp.array2d[float],
):
    worldid = wp.tid()
    if not mask[worldid]:
        return
    row, pose_row = int(worldid), int(worldid)
    if rows:
        row = rows[worldid]
        if poses_have_rows:
            pose_row = row
    for i in range(held_out.shape[1]):
        held_out[worldid, i] = qpos_in[pose_row, i]
    kind = start[row]
    if kind < 0 or kind >= starts.pose.shape[0]:
        return
    if starts.pose[kind] >= StartPose.STANDING:
        arm = starts.arm[kind]
        for i in range(adr.shape[1]):
            if adr[arm, i] >= 0:
                held_out[worldid, adr[arm, i]] = closed[arm, i]


class GripCloser:
    """Writes the joint positions that the controls of the masked worlds hold: the layout's, but for closing fingers.

    Args:
        compiled: A scene with kinds of starts.
        nworld: Number of worlds.
        mask: The worlds, shape (nworld,), bool; read at every launch.
        rest: Controls and activations at rest.

    Raises:
        NotSupportedError: No position actuator closes a gripper that a start closes on something.
    """

    def __init__(self, compiled: CompiledScene, nworld: int, mask: wp.array, rest: RestMap) -> None:
        starts, full, sim = compiled.starts, compiled.mjm, compiled.sim_mjm
        assert starts is not None
        arms = () if compiled.reaching is None else compiled.reaching.arms
        closes = set(starts.arm.numpy()[starts.pose.numpy() >= StartPose.STANDING].tolist())
        driven, rows = set(rest.qposadr.numpy().tolist()), []
        of_joint = dict(zip(full.jnt_qposadr.tolist(), range(full.njnt), strict=True))
        for i, one in enumerate(arms):
            adr, qpos = one.gripper.poses(np.zeros(1))
            if compiled.sim_mjm is not full:
                adr = [sim.joint(full.joint(of_joint[a]).name).qposadr[0] for a in adr.tolist()]
            rows.append(dict(zip(map(int, adr), qpos[0].tolist(), strict=True)))
            if i in closes and not driven & rows[-1].keys():
                raise NotSupportedError(
                    f"{compiled.config.where}: start: the gripper of '{one.robot}' has no position actuator that would "
                    "keep it closed. Give it one, as in <position joint=...>, or start from 'home' or 'pregrasp'."
                )
        width = max(map(len, rows), default=0)
        padded = [[*row.items(), *[(-1, 0.0)] * (width - len(row))] for row in rows]
        self._starts, self._mask, self._device = starts, mask, mask.device
        with wp.ScopedDevice(self._device):
            self._adr = wp.array([[a for a, _ in row] for row in padded], dtype=int, ndim=2)
            self._closed = wp.array([[q for _, q in row] for row in padded], dtype=float, ndim=2)
            self._held = wp.zeros((nworld, sim.nq), dtype=float)

    def launch(self, qpos: wp.array, start: wp.array, rows: wp.array | None, poses_have_rows: bool) -> wp.array:
        """Return the joint positions that controls hold, shape (nworld, nq), brought up to date in the masked worlds.

        Args:
            qpos: Joint positions of the layouts.
            start: Kinds of start of the layouts, shape (nrow,).
            rows: Row of `start` for every masked world, shape (nworld,), int32; None gives world i row i.
            poses_have_rows: Whether these are rows of `qpos` as well, which has a row for each world otherwise.
        """
        inputs = [self._starts, self._adr, self._closed, self._mask, rows, start, poses_have_rows, qpos]
        wp.launch(_close, self._held.shape[0], inputs=inputs, outputs=[self._held], device=self._device)
        return self._held
