"""The scene that the audit judges: owners of bodies, carriers of objects, solids and start pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import mujoco
import numpy as np

from sceniris_gym.audit.geometry import Form, Solid, convex_hull, home_of, solids_of, subtree
from sceniris_gym.audit.pairs import Tree
from sceniris_gym.audit.supports import surface_of
from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.scene import SceneConfig


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


class JudgedScene:
    """A scene as the audit sees it.

    Args:
        mjm: The model.
        config: The scene.
        bodies: Object name -> root body id.

    Attributes:
        tree: Owners of the bodies.
        markers: Names of the objects that may intersect anything.
        placed: Object name -> its ObjectConfig, for all placed objects.
        solids: The solids of its geometry, without those of markers.
        home: The model at the start pose.

    Raises:
        NotSupportedError: A geom has a type that the audit does not know.
    """

    def __init__(self, mjm: mujoco.MjModel, config: SceneConfig, bodies: Mapping[str, int]) -> None:
        self.mjm, self.config, self.bodies = mjm, config, bodies
        self.tree, self.home = Tree(mjm, bodies, config.home), home_of(mjm, config.home)
        self.markers = {name for name, part in config.objects.items() if part.kind == "marker"}
        self.placed = {name: part for name, part in config.parts.items() if part.is_placed}
        self.solids = [s for s in solids_of(mjm, config.geometry) if self.owner(s) not in self.markers]

    def owner(self, solid: Solid) -> str:
        """Return the name of the object that a solid belongs to."""
        return self.tree.owner[self.mjm.geom_bodyid[solid.geom]]

    def at_home(self, geom: int, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Return position [m] (3,) and rotation (3, 3) of a geom in the frame of a body at the start pose."""
        home, back = self.home, self.home.xmat[body].reshape(3, 3).T
        return back @ (home.geom_xpos[geom] - home.xpos[body]), back @ home.geom_xmat[geom].reshape(3, 3)

    def carrier(self, parent: str) -> Carrier:
        """Return the carrier of an object.

        Args:
            parent: Its name in the scene file: 'floor', 'object', 'object/body', a geom or a body that never moves.
        """
        mjm, bodies = self.mjm, self.bodies
        if parent == FLOOR and self.config.floor is not None:
            return Carrier(0, is_ground=True)
        owner, _, part = parent.partition("/")
        if parent in bodies:
            return Carrier(bodies[parent], owner=parent)
        if owner in bodies:
            own = self.config.objects[owner].body or owner
            spaces = (own, own.rpartition("/")[0])  # names of an attached model have a prefix
            names = [part, *(f"{space}/{part}" for space in spaces)]
            ids = [mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, name) for name in reversed(names)]
            inside = [i for i in ids if i in subtree(mjm, bodies[owner])]
            if inside:
                return Carrier(inside[0], owner=owner)
        geom = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_GEOM, parent)
        body = int(mjm.geom_bodyid[geom]) if geom >= 0 else mjm.body(parent).id
        _, nearest = max(((root, n) for n, root in bodies.items() if body in subtree(mjm, root)), default=(0, None))
        return Carrier(body, geom if geom >= 0 else None, nearest)

    def hulls(self, solids: list[Solid]) -> dict[str, np.ndarray]:
        """Return the corners of the convex hulls of placed objects in their roots' frames at home [m], by name.

        Args:
            solids: Solids of the model; an object without any is a point.

        Returns:
            Object name -> corners, shape (n, 3).
        """
        parts: dict[str, list[np.ndarray]] = {name: [] for name in self.placed}
        for solid in solids:
            name = self.owner(solid)
            if name in parts and solid.form is not Form.HALFSPACE:
                pos, mat = self.at_home(solid.geom, self.bodies[name])
                parts[name].append(surface_of(solid)[0] @ mat.T + pos)
        return {
            name: convex_hull(np.concatenate(points))[0] if points else np.zeros((1, 3))
            for name, points in parts.items()
        }
