"""The kinds of starts of a plan as the fields of `device_starts.Starts`."""

from __future__ import annotations

import numpy as np

from sceniris_gym.program.device import fill_struct
from sceniris_gym.program.device_starts import Starts
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.starts import plan_grips, plan_starts


def pack_starts(plan: Plan, bounds: np.ndarray, device: str) -> Starts | None:
    """Return the kinds of starts of a scene on a device; None if it has none.

    Args:
        plan: The plan.
        bounds: Greatest absolute values of qpos, shape (nq,), which are raised to those of all starts.
        device: Warp's name of the device.

    Raises:
        ScenirisError: A kind does not fit the scene; see `plan_grips` and `plan_starts`.
    """
    if not plan.scene.config.start:
        return None
    starts, fields = Starts(), plan_starts(plan, plan_grips(plan))
    draws = fields["draw_range"]
    adr = [r.qposadr for o in plan.objects for r in o.joint_ranges]
    is_drawn = draws[..., :1] <= draws[..., 1:]
    bounds[adr] = np.maximum(bounds[adr], np.where(is_drawn, np.abs(draws), 0.0).max(axis=(0, 2), initial=0.0))
    for one in plan.reaching.arms:
        limits = np.abs([one.arm.lower, one.arm.upper])
        most = np.where(np.isfinite(limits), limits, np.pi).max(axis=0)
        bounds[one.arm.qposadr] = np.maximum(bounds[one.arm.qposadr], most)
        adr, qpos = one.gripper.poses(np.linspace(0.0, 1.0, 17))
        bounds[adr] = np.maximum(bounds[adr], np.abs(qpos).max(axis=0, initial=0.0))
    fill_struct(Starts, starts, fields, device)
    return starts
