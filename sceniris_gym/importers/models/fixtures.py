"""Finds the joints of furniture and hands in a model that a scene can draw."""

from typing import Any

import mujoco
import numpy as np

from sceniris_gym.scene.couplings import joint_couplings

# More joints than this share the pattern "*", if it draws them all in the same way.
_LISTED = 3
# Greatest distance of a draw from the start pose, relative to the joint's range. Far-opened doors of neighbours meet.
_SHARE = 0.3
_DRAWN = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))


def joint_draws(mjm: mujoco.MjModel, bodies: list[int]) -> dict[str, Any]:
    """Return a value of `joints` that draws each named slide and hinge in bodies. Without such joints, it is empty.

    Joints that follow others are left out. The range of a joint without limits counts as 1 rad or m.

    Args:
        mjm: The model.
        bodies: The bodies, first a child of the world.
    """
    following = [coupling.follower for coupling in joint_couplings(mjm, "init")]
    inside = np.flatnonzero(np.isin(mjm.jnt_bodyid, bodies)).tolist()
    prefix, draws = mjm.body(bodies[0]).name.rpartition("/")[0] + "/", {}
    for i in inside:
        if mjm.joint(i).name and mjm.jnt_type[i] in _DRAWN and i not in following:
            span = float(np.ptp(mjm.jnt_range[i])) if mjm.jnt_limited[i] else 1.0
            draws[mjm.joint(i).name.removeprefix(prefix)] = {"noise": float(f"{_SHARE * span:.2g}")}
    first = next(iter(draws.values()), None)
    is_pattern = _LISTED < len(draws) == len(inside) and all(draw == first for draw in draws.values())
    return {"*": first} if is_pattern else draws
