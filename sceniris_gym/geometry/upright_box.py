"""The upright box around geoms, wherever they are."""

import mujoco
import numpy as np


def upright_box(mjm: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper corner [m] of a box along the world's axes that holds the boxes of geoms.

    Args:
        mjm: The model.
        data: Its state, with the poses of geoms up to date.
        geoms: Numbers of geoms, at least one; no planes.
    """
    mats = data.geom_xmat[geoms].reshape(-1, 3, 3)
    middle = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", mats, mjm.geom_aabb[geoms, :3])
    half = np.einsum("gij,gj->gi", np.abs(mats), mjm.geom_aabb[geoms, 3:])
    return (middle - half).min(axis=0), (middle + half).max(axis=0)
