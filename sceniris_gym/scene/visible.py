"""Geoms that pictures show: each body once, though it may have geoms for looks and others that collide."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.scene.assemble import MARK_GROUP

VISIBLE_GROUPS = (0, 1, 2, MARK_GROUP)
"""Geom groups in pictures: those that MuJoCo's viewer shows, and markers."""

HIDDEN_GROUP = 5


def picture_groups(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the group of each geom, shape (ngeom,), with shapes for collisions in HIDDEN_GROUP.

    A geom that collides is hidden if its body also has geoms for looks alone, in another group that is visible. Geoms
    of the world are all drawn, as a floor is none of the things on it.
    """
    groups = mjm.geom_group.copy()
    visible = np.isin(groups, VISIBLE_GROUPS) & (mjm.geom_rgba[:, 3] > 0.0)
    collides = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    looks = set(zip(mjm.geom_bodyid[visible & ~collides], groups[visible & ~collides], strict=True))
    bodies = {body for body, _ in looks} - {0}
    for geom in np.flatnonzero(visible & collides):
        body = int(mjm.geom_bodyid[geom])
        if body in bodies and (body, groups[geom]) not in looks:
            groups[geom] = HIDDEN_GROUP
    return groups
