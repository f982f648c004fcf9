"""The parking ground of absent group members: a square lattice far away, out of reach of placed objects.

Absent objects are parked without a collision test, and placed objects are not tested against them. That is correct as
long as each absent object has its own place on the lattice, and other objects stay away from it.
`program/checks/places.py` ensures both.
"""

import math

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError

PARKING_FROM = 40.0
"""First corner [m] of the lattice, far from every scene."""
PARKING_SPACING = 2.0
"""Distance [m] between neighbours on the lattice."""
PARKING_COLUMNS = 8
"""Number of places in a row of the lattice."""

SLAB = "parking_ground"
"""Name of the geom that `add_parking_ground` adds."""
GROUND_RISE = 1.0e-3
"""Geoms that rise less than this [m] above the ground count as part of it."""


def add_parking_ground(spec: mujoco.MjSpec, nslot: int) -> None:
    """Add a slab far away that holds absent objects, with room for `nslot` objects."""
    low, high = _corners(nslot)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + 1.0
    spec.worldbody.add_geom(
        name=SLAB, type=mujoco.mjtGeom.mjGEOM_BOX, pos=[*middle, -0.05], size=[*half, 0.05], group=3
    )


def has_parking_ground(mjm: mujoco.MjModel, nslot: int, where: str) -> bool:
    """Return whether the model has ground at z = 0 for parked objects: a plane, or a large enough slab.

    Raises:
        SceneKeyError: A plane lies above the parking ground.
    """
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    low, high = _corners(nslot)
    corners = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
    found = False
    for geom in np.flatnonzero(mjm.geom_type == mujoco.mjtGeom.mjGEOM_PLANE):
        over = (corners - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)[:, 2]
        if not mjm.geom_contype[geom] | mjm.geom_conaffinity[geom]:
            continue
        if over.min() < -GROUND_RISE:
            raise SceneKeyError(
                f"{where}: groups: the plane '{mjm.geom(geom).name or geom}' lies above the ground (z = 0) at "
                f"({PARKING_FROM:g}, {PARKING_FROM:g}) m, where absent objects are parked. Lower it, or make it a box."
            )
        found = found or over.max() < GROUND_RISE
    slab = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_GEOM, SLAB)
    if found or slab < 0:
        return found
    middle, half = data.geom_xpos[slab, :2], mjm.geom_size[slab, :2]
    return bool(np.all(middle - half <= low) and np.all(middle + half >= high))


def is_parked(points: np.ndarray) -> np.ndarray:
    """Return whether each point [m], shape (..., 3), lies on the parking ground: bool, shape (...)."""
    return np.all(points[..., :2] > PARKING_FROM - 0.5 * PARKING_SPACING, axis=-1)


def _corners(nslot: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper corner [m] of the parking rectangle, with a margin of half a place."""
    rows = max(PARKING_COLUMNS, math.ceil(nslot / PARKING_COLUMNS))
    low = np.full(2, PARKING_FROM - 0.5 * PARKING_SPACING)
    return low, low + PARKING_SPACING * np.array([PARKING_COLUMNS, rows])
