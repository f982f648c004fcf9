"""Which pairs of solids must be apart, and by how much."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.tools.audit.geometry import Solid

WORLD = "world"


@dataclass(frozen=True)
class Judged:
    """A pair of solids that must be apart.

    Attributes:
        first, second: Indices into the list of solids.
        clearance: Least distance between them [m], unless one supports the other.
        owners: The objects they belong to.
    """

    first: int
    second: int
    clearance: float
    owners: tuple[str, str]


class Tree:
    """Which object owns each body of a model, and which bodies a layout can move.

    Args:
        mjm: The model.
        bodies: Object name -> root body id; a body outside all objects belongs to the top-level body above it.
    """

    def __init__(self, mjm: mujoco.MjModel, bodies: Mapping[str, int]) -> None:
        roots = {body: name for name, body in bodies.items()}
        self.mjm = mjm
        self.owner: list[str] = [WORLD]
        self.movable = np.zeros(mjm.nbody, bool)
        self.fixture = np.zeros(mjm.nbody, bool)
        for body in range(1, mjm.nbody):
            parent = mjm.body_parentid[body]
            inherited = self.owner[parent] if parent else mjm.body(body).name or f"body {body}"
            self.owner.append(roots.get(body, inherited))
            self.fixture[body] = self.fixture[parent] or mjm.body_mocapid[body] >= 0
            self.movable[body] = self.movable[parent] or self.fixture[body] or mjm.body_jntnum[body] > 0

    def bodies_of(self, name: str) -> list[int]:
        """Return the body ids of an object."""
        return [body for body, owner in enumerate(self.owner) if owner == name]


def judged_pairs(tree: Tree, solids: list[Solid], geometry: str, clearances: Mapping[str, float]) -> list[Judged]:
    """List the pairs of solids of different objects that a layout must keep apart.

    Contact bits (of the physics) and exclusions are honoured. Two bodies that no layout moves are not judged; fixtures
    are kept apart from each other and from the static scene, although MuJoCo reports no contacts between them.

    Args:
        tree: Owners of the bodies.
        solids: The solids of the model.
        geometry: "physics" or "visual".
        clearances: Clearance [m] of each placed object; a pair keeps the larger one.
    """
    judged = []
    for first in range(len(solids)):
        for second in range(first + 1, len(solids)):
            geoms = solids[first].geom, solids[second].geom
            body1, body2 = (int(tree.mjm.geom_bodyid[g]) for g in geoms)
            owners = tree.owner[body1], tree.owner[body2]
            if owners[0] == owners[1] or not (tree.movable[body1] or tree.movable[body2]):
                continue
            if _excluded(tree.mjm, body1, body2) or (geometry == "physics" and not _bits_meet(tree.mjm, *geoms)):
                continue
            if not (tree.fixture[body1] or tree.fixture[body2]) and _filtered(tree.mjm, body1, body2):
                continue
            clearance = max(clearances.get(owner, 0.0) for owner in owners)
            judged.append(Judged(first, second, clearance, owners))
    return judged


def _bits_meet(mjm: mujoco.MjModel, geom1: int, geom2: int) -> bool:
    return bool(
        mjm.geom_contype[geom1] & mjm.geom_conaffinity[geom2] or mjm.geom_contype[geom2] & mjm.geom_conaffinity[geom1]
    )


def _excluded(mjm: mujoco.MjModel, body1: int, body2: int) -> bool:
    return (min(body1, body2) << 16) + max(body1, body2) in mjm.exclude_signature


def _filtered(mjm: mujoco.MjModel, body1: int, body2: int) -> bool:
    """Return whether MuJoCo skips the pair because one body is welded to the other or is its parent."""
    weld1, weld2 = mjm.body_weldid[body1], mjm.body_weldid[body2]
    if weld1 == weld2:
        return True
    parent1, parent2 = (mjm.body_weldid[mjm.body_parentid[w]] for w in (weld1, weld2))
    return weld1 != 0 and weld2 != 0 and (weld1 == parent2 or weld2 == parent1)
