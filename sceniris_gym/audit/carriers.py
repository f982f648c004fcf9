"""The body that carries an object in a layout, by the name that its scene file gives it."""

from __future__ import annotations

from typing import NamedTuple

import mujoco

from sceniris_gym.audit.geometry import subtree
from sceniris_gym.audit.scene import JudgedScene
from sceniris_gym.config.fields import FLOOR


class Carrier(NamedTuple):
    """The carrier of an object.

    Attributes:
        body: Id of the body; 0 for the world.
        geom: Id of the one geom that carries; None for any geom of the body.
        owner: The object that owns the body; None for the world and for bodies that never move.
        is_ground: Whether it is the ground workspace, whose size is in the scene file.
    """

    body: int
    geom: int | None = None
    owner: str | None = None
    is_ground: bool = False


def carrier_of(scene: JudgedScene, parent: str) -> Carrier:
    """Return the carrier of an object.

    Args:
        scene: The scene.
        parent: Its name in the scene file: 'floor', 'object', 'object/body', a geom or a body that never moves.
    """
    mjm, bodies = scene.mjm, scene.bodies
    if parent == FLOOR and scene.config.floor is not None:
        return Carrier(0, is_ground=True)
    owner, _, part = parent.partition("/")
    if parent in bodies:
        return Carrier(bodies[parent], owner=parent)
    if owner in bodies:
        own = scene.config.objects[owner].body or owner
        spaces = (own, own.rpartition("/")[0])  # names of an attached model have a prefix
        names = [part, *(f"{space}/{part}" for space in spaces)]
        ids = [mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, name) for name in reversed(names)]
        inside = [i for i in ids if i in subtree(mjm, bodies[owner])]
        if inside:
            return Carrier(inside[0], owner=owner)
    geom = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_GEOM, parent)
    body = int(mjm.geom_bodyid[geom]) if geom >= 0 else mjm.body(parent).id
    roots, above = {root: name for name, root in bodies.items()}, body
    while above and above not in roots:
        above = int(mjm.body_parentid[above])
    return Carrier(body, geom if geom >= 0 else None, roots.get(above))
