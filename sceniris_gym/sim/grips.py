"""Grips at the start: controls ask fingers around a thing to close, and hold the rest of the pose."""

from __future__ import annotations

import numpy as np
import warp as wp

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device_starts import StartPose
from sceniris_gym.sim.rest import RestMap, rest_value

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Grips:
    """The arms that hold something at the start; empty in scenes without."""

    arm: wp.array[int]  # of each kind of start, -1 if its arm holds nothing
    closed: wp.array2d[float]  # positions of each arm's closed fingers in qpos, nan elsewhere; shape (narm, nq)


@wp.func
def control_at_start(grips: Grips, kind: int, rest: RestMap, worldid: int, elemid: int, qpos: wp.array[float]) -> float:
    """Return the control or activation `elemid` of a world with a kind of start, -1 for none."""
    arm = int(-1)
    if kind >= 0 and kind < grips.arm.shape[0]:
        arm = grips.arm[kind]
    term = rest.rowadr[elemid]
    if arm >= 0 and term < rest.rowadr[elemid + 1]:
        if not wp.isnan(grips.closed[arm, rest.qposadr[term]]):  # it holds fingers, and fingers alone
            return rest_value(rest, worldid, elemid, grips.closed[arm])
    return rest_value(rest, worldid, elemid, qpos)


def grips_of(compiled: CompiledScene, rest: RestMap, device: wp.Device) -> Grips:
    """Return the grips of a scene, with addresses of the scene as it is simulated.

    Raises:
        NotSupportedError: No position actuator closes a gripper that a start closes on something.
    """
    grips, full, sim, starts = Grips(), compiled.mjm, compiled.sim_mjm, compiled.starts
    if compiled.reaching is None or starts is None:
        return grips
    arm, arms = np.where(starts.pose.numpy() >= StartPose.STANDING, starts.arm.numpy(), -1), compiled.reaching.arms
    closed = np.full((len(arms), sim.nq), np.nan)
    names = {int(adr): full.joint(i).name for i, adr in enumerate(full.jnt_qposadr)}
    for i, one in enumerate(arms):
        adr, qpos = one.gripper.poses(np.zeros(1))
        own = adr.tolist() if sim is full else [int(sim.joint(names[a]).qposadr[0]) for a in adr.tolist()]
        closed[i, own] = qpos[0]
        if i in arm and not np.isin(rest.qposadr.numpy(), own).any():
            raise NotSupportedError(
                f"{compiled.config.where}: start: the gripper of '{one.robot}' has no position actuator that would "
                "keep it closed. Give it one, as in <position joint=...>, or start from 'home' or 'pregrasp'."
            )
    with wp.ScopedDevice(device):
        grips.arm, grips.closed = wp.array(arm, dtype=int), wp.array(closed, dtype=float, ndim=2)
    return grips
