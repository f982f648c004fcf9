"""Supports of objects: the floor, a part of another object, or a static geom or body of the scene's own model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True)
class Support:
    """A support, found by its name.

    Attributes:
        body: Id of its body; 0 for the world.
        owner: The object that it is part of; None for the floor, and for static geoms and bodies outside of objects.
        geom: Id of the one geom that it consists of; None for all of the body, or for the floor.
        is_floor: Whether it is the ground workspace that the scene's `floor` describes.
    """

    body: int
    owner: str | None = None
    geom: int | None = None
    is_floor: bool = False


def static_supports(mjm: mujoco.MjModel, bodies: Mapping[str, int]) -> dict[str, Support]:
    """Return the static bodies and geoms that have names, by name; a geom takes precedence over a body.

    Args:
        mjm: The model.
        bodies: Root body ids of the objects, by name, which own the supports below them.
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
    """Return which bodies never move: without a joint up to the world, and not below a mocap body; shape (nbody,)."""
    return (mjm.body_weldid == 0) & (mjm.body_mocapid[mjm.body_rootid] < 0)


def subtree(mjm: mujoco.MjModel, root: int) -> list[int]:
    """Return the ids of a body and of all bodies below it, in ascending order."""
    end = root + 1  # bodies are numbered depth first: descendants follow a body
    while end < mjm.nbody and mjm.body_parentid[end] >= root:
        end += 1
    return list(range(root, end))
