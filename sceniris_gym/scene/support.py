"""Supports of objects: the floor, a part of another object, or a static geom or body of the scene's model."""

from collections.abc import Mapping
from typing import NamedTuple

import mujoco
import numpy as np


class Support(NamedTuple):
    """A support, found by its name.

    Attributes:
        body: Id of the support's body, 0 for the world.
        owner: The object that the support is part of. None for the floor, and for a static geom or body outside
            objects.
        geom: Id of the geom if the support is a single geom. None for a whole body or the floor.
        is_floor: Whether the support is the ground workspace, the scene's `floor`.
    """

    body: int
    owner: str | None = None
    geom: int | None = None
    is_floor: bool = False


def static_supports(mjm: mujoco.MjModel, bodies: Mapping[str, int]) -> dict[str, Support]:
    """Return the named static bodies and geoms, by name. A geom takes precedence over a body.

    Args:
        mjm: The model.
        bodies: Root body ids of the objects, by name. Objects own the supports in their subtrees.
    """
    owners = {body: name for name, root in bodies.items() for body in subtree(mjm, root)}
    still = is_static(mjm)
    found = {mjm.body(b).name: Support(int(b), owners.get(b)) for b in np.flatnonzero(still)[1:]}
    for geom in np.flatnonzero(still[mjm.geom_bodyid]):
        body = int(mjm.geom_bodyid[geom])
        found[mjm.geom(geom).name] = Support(body, owners.get(body), int(geom))
    found.pop("", None)
    return found


def is_static(mjm: mujoco.MjModel) -> np.ndarray:
    """Return which bodies never move, shape (nbody,): bodies fixed to the world, but not to a mocap body."""
    return (mjm.body_weldid == 0) & (mjm.body_mocapid[mjm.body_rootid] < 0)


def subtree(mjm: mujoco.MjModel, root: int) -> list[int]:
    """Return the ids of a body and of all bodies below it, in ascending order."""
    end = root + 1  # bodies are numbered depth first: descendants follow a body
    while end < mjm.nbody and mjm.body_parentid[end] >= root:
        end += 1
    return list(range(root, end))
