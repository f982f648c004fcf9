"""The supports of a model: that of a body in the start pose, and all that it could stand on."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import shapely

from sceniris_gym.geometry.framing import upright_box
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.geometry.supports import SupportSurface, level_surfaces
from sceniris_gym.scene.support import Support, is_static, static_supports, subtree

_GEOM = mujoco.mjtObj.mjOBJ_GEOM


@dataclass(frozen=True)
class FoundSupport:
    """A support by its name in a scene file, with its level surfaces.

    Attributes:
        name: Its name in a scene file.
        body: Id of the body that it is part of.
        surfaces: Its level surfaces, lowest first; empty if it has none.
        open_above: Whether they are open above, so that things stand 'on' it and not 'in' it.
    """

    name: str
    body: int
    surfaces: tuple[SupportSurface, ...]
    open_above: bool

    @property
    def area(self) -> float:
        """The area of its surfaces [m^2]."""
        return sum(s.outline.area for s in self.surfaces)

    @property
    def extent(self) -> tuple[float, float]:
        """The lengths of its surfaces' bounds along the x and y axes of its body [m]."""
        x0, y0, x1, y1 = shapely.union_all([s.outline for s in self.surfaces]).bounds
        return x1 - x0, y1 - y0

    @property
    def is_endless(self) -> bool:
        """True if one of its surfaces is a plane without sizes."""
        return any(s.is_endless for s in self.surfaces)


def geom_beneath(mjm: mujoco.MjModel, data: mujoco.MjData, root: int) -> int | None:
    """Return the first colliding geom straight below the middle of a body and its descendants; None if there is none.

    The ray begins at the top of the body, so that a geom that the body is sunk into counts. Geoms that move and lie
    higher than the foot of the body do not count: they stand on it.

    Args:
        mjm: The model.
        data: The model in its start pose, after `mj_kinematics`.
        root: The body.
    """
    own = np.isin(mjm.geom_bodyid, subtree(mjm, root))
    low = high = data.xpos[root]
    if own.any():
        low, high = upright_box(mjm, data, np.flatnonzero(own))
    at, down, hit = np.array([*(low + high)[:2] / 2.0, high[2]]), np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
    counts = ((mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)) & ~own
    seen = copy.copy(mjm)  # MuJoCo's rays pass through transparent geoms
    seen.geom_matid[:], seen.geom_rgba[:, 3] = -1, counts
    while mujoco.mj_ray(seen, data, at, down, None, 1, -1, hit, None) >= 0.0:
        if is_static(mjm)[mjm.geom_bodyid[hit[0]]] or upright_box(mjm, data, hit)[0][2] < low[2]:
            return int(hit[0])
        seen.geom_rgba[hit, 3] = 0.0
    return None


def supports_of(
    mjm: mujoco.MjModel, bodies: Mapping[str, int], robots: Iterable[int], pieces: Sequence[Piece]
) -> list[FoundSupport]:
    """Return everything that never moves and has a name and a level surface, the largest first.

    Robots are left out, and so is a body all of whose surface belongs to one geom that has a name.

    Args:
        mjm: The model.
        bodies: Root bodies of the objects of the scene, by name.
        robots: Root bodies of robots.
        pieces: The pieces of the model.
    """
    found = [support_of(name, support, pieces) for name, support in static_supports(mjm, bodies).items()]
    found = [s for s in found if s.surfaces and mjm.body_rootid[s.body] not in set(robots)]
    geoms = {(s.body, round(s.area, 6)) for s in found if mujoco.mj_name2id(mjm, _GEOM, s.name) >= 0}
    kept = [s for s in found if mujoco.mj_name2id(mjm, _GEOM, s.name) >= 0 or (s.body, round(s.area, 6)) not in geoms]
    return sorted(kept, key=lambda s: -s.area)


def support_of(name: str, support: Support, pieces: Sequence[Piece]) -> FoundSupport:
    """Return a support with its level surfaces: those that are open above, or, without any, those that are covered."""
    own = [p for p in pieces if p.body == support.body]
    above = level_surfaces(support.body, own, open_above=True, geom=support.geom)
    found = above or level_surfaces(support.body, own, open_above=False, geom=support.geom)
    return FoundSupport(name, support.body, tuple(found), bool(above))


def named_support(mjm: mujoco.MjModel, geom: int, bodies: Mapping[str, int]) -> tuple[str, Support] | None:
    """Return the support that a geom belongs to, by its name: the geom, its body, or a part of an object; or None."""
    body = int(mjm.geom_bodyid[geom])
    owner = next((name for name, root in bodies.items() if body in subtree(mjm, root)), None)
    if owner is not None:
        root = mjm.body(bodies[owner]).name
        part = mjm.body(body).name.removeprefix(f"{root.rpartition('/')[0] or owner}/")
        name = owner if body == bodies[owner] else f"{owner}/{part}"
        return (name, Support(body, owner)) if body == bodies[owner] or part else None
    if not is_static(mjm)[body]:
        return None
    if mjm.geom(geom).name:
        return mjm.geom(geom).name, Support(body, None, geom)
    return (mjm.body(body).name, Support(body)) if body > 0 and mjm.body(body).name else None
