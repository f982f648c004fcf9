"""The body that carries an object in a layout, by the name that its scene file gives it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import mujoco

from sceniris_gym.audit.geometry import subtree
from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.scene import SceneConfig


class Carrier(NamedTuple):
    """The carrier of an object.

    Attributes:
        body: Id of the body; 0 for the world.
        geom: Id of the one geom that carries; None for any geom of the body.
        owner: The object that owns the body; None for the world and for bodies that never move.
    """

    body: int
    geom: int | None = None
    owner: str | None = None


def is_ground(config: SceneConfig, parent: str) -> bool:
    """Return whether a support is the ground workspace, whose size is in the scene file."""
    return parent == FLOOR and config.floor is not None


def carrier_of(mjm: mujoco.MjModel, bodies: Mapping[str, int], config: SceneConfig, parent: str) -> Carrier:
    """Return the carrier of an object.

    Args:
        mjm: The model.
        bodies: Object name -> root body id.
        config: The scene.
        parent: Its name in the scene file: 'floor', 'object', 'object/body', a geom or a body that never moves.
    """
    if is_ground(config, parent):
        return Carrier(0)
    owner, _, part = parent.partition("/")
    if parent in bodies:
        return Carrier(bodies[parent], owner=parent)
    if owner in bodies:
        own = config.objects[owner].body or owner
        spaces = (own, own.rpartition("/")[0])  # names of an attached model have a prefix
        names = [part, *(f"{space}/{part}" for space in spaces)]
        ids = [mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, name) for name in reversed(names)]
        inside = [i for i in ids if i in subtree(mjm, bodies[owner])]
        if inside:
            return Carrier(inside[0], owner=owner)
    roots = {body: name for name, body in bodies.items()}
    geom = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_GEOM, parent)
    if geom >= 0:
        body = int(mjm.geom_bodyid[geom])
        return Carrier(body, geom, _owner(mjm, body, roots))
    body = mjm.body(parent).id
    return Carrier(body, owner=_owner(mjm, body, roots))


def _owner(mjm: mujoco.MjModel, body: int, roots: Mapping[int, str]) -> str | None:
    while body and body not in roots:
        body = int(mjm.body_parentid[body])
    return roots.get(body)
