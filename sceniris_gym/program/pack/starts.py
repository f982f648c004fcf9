"""The kinds of starts of a plan as the fields of `device_starts.Starts`."""

from __future__ import annotations

import numpy as np

from sceniris_gym.program.device import fill_struct
from sceniris_gym.program.device_starts import Starts
from sceniris_gym.program.placed_object import JointRange
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.starts import StartKind, plan_grips, plan_starts
from sceniris_gym.reach.arm import MAX_JOINTS

_UNDRAWN = (1.0, -1.0)


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
    starts, grips = Starts(), plan_grips(plan)
    kinds = plan_starts(plan, grips)
    _raise_bounds(plan, kinds, bounds)
    ncolumn = 0 if plan.reaching is None else len(plan.reaching.targets)
    draws = [r.qposadr for o in plan.objects for r in o.joint_ranges]

    def table(rows: list, *shape: int) -> np.ndarray:
        return np.reshape(rows, (len(kinds), *shape))

    fields = {
        "weight": np.array([kind.config.weight for kind in kinds]),
        "pose": np.array([int(kind.pose) for kind in kinds]),
        "arm": np.array([kind.arm for kind in kinds]),
        "target": table([np.isin(np.arange(ncolumn), kind.columns) for kind in kinds], ncolumn),
        "grasp": table([kind.grasps for kind in kinds], len(grips)),
        "lift": table([kind.config.lift or (0.0, 0.0) for kind in kinds], 2),
        "arm_range": table([[_interval(k.arm_joints.get(i)) for i in range(MAX_JOINTS)] for k in kinds], MAX_JOINTS, 2),
        "draw_range": table([[_interval(k.draws.get(adr)) for adr in draws] for k in kinds], len(draws), 2),
        "marker": table([[k.markers.get(i, -1) for i in range(len(plan.objects))] for k in kinds], len(plan.objects)),
        "grip_share": np.array([grip.share for grip in grips], float),
        "grip_pos": np.reshape([grip.pos for grip in grips], (-1, 3)),
        "home_pos": plan.home.xpos,
        "home_quat": plan.home.xquat,
        "bank_start": np.zeros(0),
    }
    fill_struct(Starts, starts, fields, device)
    return starts


def _interval(drawn: JointRange | None) -> tuple[float, float]:
    return _UNDRAWN if drawn is None else (drawn.low, drawn.high)


def _raise_bounds(plan: Plan, kinds: tuple[StartKind, ...], bounds: np.ndarray) -> None:
    """Raise bounds to the greatest absolute values of arms, fingers and joints in all starts."""
    for kind in kinds:
        for adr, drawn in kind.draws.items():
            bounds[adr] = max(bounds[adr], abs(drawn.low), abs(drawn.high))
    for one in () if plan.reaching is None else plan.reaching.arms:
        limits = np.abs([one.arm.lower, one.arm.upper])
        bounds[one.arm.qposadr] = np.maximum(
            np.where(np.isfinite(limits), limits, np.pi).max(axis=0), bounds[one.arm.qposadr]
        )
        adr, qpos = one.gripper.poses(np.linspace(0.0, 1.0, 17))
        bounds[adr] = np.maximum(bounds[adr], np.abs(qpos).max(axis=0, initial=0.0))
