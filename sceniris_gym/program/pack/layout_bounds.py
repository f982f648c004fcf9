"""Bounds of the numbers of a layout, for the last check before it is served."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.config.bounds import MOST_WIDE
from sceniris_gym.program.plan import Plan
from sceniris_gym.scene.parking import PARKING_SPACING

# Shares and absolute numbers by which rounding may exceed a bound.
_ROUNDING = 1.0e-3


def layout_bounds(plan: Plan) -> dict[str, np.ndarray]:
    """Return the fields `bound_*`, greatest absolute values, and `quat_qposadr`, addresses of quaternions in qpos.

    Drawn joints and their followers stay within what is drawn, and all others at home. Placed objects stay within what
    the scene may reach; absent ones are parked the further out the more there are.
    """
    mjm = plan.scene.mjm
    far = MOST_WIDE + PARKING_SPACING * len(plan.slots)
    bound = np.abs(plan.scene.home_qpos)
    is_free, is_ball = (mjm.jnt_type == kind for kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL))
    places = mjm.jnt_qposadr[is_free][:, None] + np.arange(3)
    bound[places] = np.maximum(bound[places], far)
    quats = (mjm.jnt_qposadr + 3 * is_free)[is_free | is_ball]
    bound[quats[:, None] + np.arange(4)] = 1.0
    for o in plan.objects:
        for adr, ends in o.spans.items():
            bound[adr] = max(map(abs, ends))
    mocap = np.full(mjm.nmocap, 3.0 * far)
    bodies = np.flatnonzero(mjm.body_mocapid >= 0)
    mocap[mjm.body_mocapid[bodies]] += np.abs(mjm.body_pos[bodies]).sum(axis=1)
    return {
        "bound_qpos": (1.0 + _ROUNDING) * bound + _ROUNDING,
        "bound_mocap": mocap,
        "quat_qposadr": quats,
    }
