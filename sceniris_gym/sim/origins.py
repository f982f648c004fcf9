"""Origins of worlds, which resets add to all positions that they write."""

import warnings
from typing import Any

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, ModelWarning
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.scene.model import SceneModel


def as_origins(origins: Any, nworld: int, device: wp.Device) -> wp.array:
    """Return the origins of worlds [m], world frame, as a Warp array on `device`, shape (nworld,), vec3.

    Args:
        origins: A Warp array, a torch tensor or a numpy array, shape (nworld, 3). Dense float32 arrays on the device
            are not copied.
        nworld: Number of worlds.
        device: The target device.

    Raises:
        ArgumentTypeError: `origins` is not an array of floats.
        ArgumentError: `origins` has another shape.
    """
    if isinstance(origins, wp.array):
        found = origins
    elif type(origins).__module__ == "torch":
        found = wp.from_torch(origins.detach().float().contiguous())
    else:
        try:
            found = wp.array(np.ascontiguousarray(origins, np.float32), dtype=wp.float32, device=device)
        except (TypeError, ValueError):
            raise ArgumentTypeError(f"origins should be floats, shape ({nworld}, 3), got {short(origins)}.") from None
    if found.dtype is wp.float32 and found.ndim == 2 and found.shape[1] == 3:
        found = found.view(wp.vec3)
    if found.dtype is not wp.vec3 or found.shape != (nworld,):
        shape = tuple(np.shape(origins))
        raise ArgumentError(f"origins should be floats of shape ({nworld}, 3), one per world, got {shape}.")
    return found.to(device)


def warn_of_origins(scene: SceneModel, origins: np.ndarray, where: str) -> None:
    """Warn of geoms that are fixed to the world, because origins move the layouts but not these geoms.

    A geom is fixed to the world if its tree has no free body and no mocap body. Only geoms that collide count. Planes
    do not count, because they look the same from every origin.

    Args:
        scene: The scene.
        origins: Origins [m], shape (nworld, 3).
        where: Name of the caller. The warning begins with this name.
    """
    mjm = scene.mjm
    free = mjm.jnt_bodyid[mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    moves = (mjm.body_mocapid >= 0) | np.isin(np.arange(mjm.nbody), free)
    fixed = ~moves[mjm.body_rootid][mjm.geom_bodyid] & (mjm.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    rules = ContactRules(mjm, scene.config.geometry)
    found = [int(geom) for geom in np.flatnonzero(fixed) if rules.collides(int(geom))]
    if not found or not np.any(origins):
        return
    named = [f"'{mjm.geom(g).name}' of '{mjm.body(int(mjm.geom_bodyid[g])).name}'" for g in found[:3]]
    more = f" and {len(found) - len(named)} more" if len(found) > len(named) else ""
    message = (
        f"{where}: layouts move to the origins of their worlds, but some geometry stays fixed to the world: geoms "
        f"{', '.join(named)}{more}. Layouts do not fit around these geoms, unless the geoms look the same from every "
        "origin. Put the geoms on mocap bodies that also move to the origins, or set all origins to 0."
    )
    warnings.warn(ModelWarning(message), stacklevel=5)
