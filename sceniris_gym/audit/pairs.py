"""Pairs of solids that must be apart, and their clearances."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import mujoco

from sceniris_gym.audit.geometry import Solid

WORLD = "world"


@dataclass(frozen=True)
class Judged:
    """A pair of solids that must be apart.

    Attributes:
        first, second: Indices into the list of solids.
        clearance: Least distance between them [m], unless one supports the other.
        owners: The objects that own them; the same one twice for two parts of an object.
        margin: Distance below which MuJoCo acts on the two [m].
    """

    first: int
    second: int
    clearance: float
    owners: tuple[str, str]
    margin: float = 0.0


class Tree:
    """Owners of the bodies of a model, and the bodies that a layout can move.

    Args:
        mjm: The model.
        bodies: Object name -> root body id; a body outside all objects belongs to the top-level body above it.
        keyframe: The keyframe that is the start pose; None for 'home'.
    """

    def __init__(self, mjm: mujoco.MjModel, bodies: Mapping[str, int], keyframe: str | None = None) -> None:
        roots = {body: name for name, body in bodies.items()}
        self.mjm, self.keyframe = mjm, keyframe
        self.owner: list[str] = [WORLD]
        self.fixture = mjm.body_mocapid[mjm.body_rootid] >= 0
        self.movable = self.fixture | (mjm.body_weldid != 0)
        for body in range(1, mjm.nbody):
            parent = mjm.body_parentid[body]
            inherited = self.owner[parent] if parent else mjm.body(body).name or f"body {body}"
            self.owner.append(roots.get(body, inherited))


def judged_pairs(
    tree: Tree,
    solids: list[Solid],
    geometry: str,
    clearances: Mapping[str, float],
    jointed: Collection[str] = (),
    at_home: Collection[tuple[int, int]] = (),
    placed: Collection[str] | None = None,
) -> list[Judged]:
    """List the pairs of solids that a layout must keep apart.

    Contact bits (of the physics), explicit pairs and exclusions are honoured. Two bodies that no layout moves are not
    judged. Fixtures are kept apart from each other and from the static scene, although MuJoCo reports no contacts
    between them. Parts of one object are judged by MuJoCo's rules if a layout draws its joints.

    Args:
        tree: Owners of the bodies.
        solids: The solids of the model.
        geometry: "physics" or "visual".
        clearances: Clearance [m] of each placed object; a pair keeps the larger one.
        jointed: Names of the objects whose joints are drawn.
        at_home: Pairs of geoms, the lower id first, that touch at home; MuJoCo alone judges them. With "visual" their
            bodies are not judged at all.
        placed: Names of the objects that layouts place, None for all. Two other objects keep no clearance, and MuJoCo
            alone judges them if their joints are not drawn either, because they stay as they are at home.
    """
    mjm = tree.mjm
    touching = {frozenset(mjm.geom_bodyid[list(geoms)].tolist()) for geoms in at_home if geometry == "visual"}
    explicit = {frozenset(p): float(m) for *p, m in zip(mjm.pair_geom1, mjm.pair_geom2, mjm.pair_margin, strict=True)}
    moved = None if placed is None else {*placed, *jointed}
    judged = []
    for first in range(len(solids)):
        for second in range(first + 1, len(solids)):
            geoms = solids[first].geom, solids[second].geom
            body1, body2 = (int(mjm.geom_bodyid[g]) for g in geoms)
            owners = tree.owner[body1], tree.owner[body2]
            own = owners[0] == owners[1]
            if not (tree.movable[body1] or tree.movable[body2]) or (own and owners[0] not in jointed):
                continue
            if geoms in at_home or frozenset((body1, body2)) in touching:
                continue
            if moved is not None and not moved.intersection(owners):
                continue
            margin = explicit.get(frozenset(geoms))
            if margin is None:
                excluded = (min(body1, body2) << 16) + max(body1, body2) in mjm.exclude_signature
                g, h = geoms
                bits = mjm.geom_contype[g] & mjm.geom_conaffinity[h] | mjm.geom_contype[h] & mjm.geom_conaffinity[g]
                if excluded or (geometry == "physics" and not bits):
                    continue
                if (own or not (tree.fixture[body1] or tree.fixture[body2])) and _filtered(mjm, body1, body2):
                    continue
                margin = float(mjm.geom_margin[list(geoms)].sum())
            keeps = not own and (placed is None or bool({*owners} & {*placed}))
            clearance = max(clearances.get(owner, 0.0) for owner in owners) if keeps else 0.0
            judged.append(Judged(first, second, clearance, owners, margin if geometry == "physics" else 0.0))
    return judged


def _filtered(mjm: mujoco.MjModel, body1: int, body2: int) -> bool:
    """Return whether MuJoCo skips the pair, because one body is welded to the other or is its parent."""
    weld1, weld2 = mjm.body_weldid[body1], mjm.body_weldid[body2]
    if weld1 == weld2:
        return True
    if mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT:
        return False
    parent1, parent2 = (mjm.body_weldid[mjm.body_parentid[w]] for w in (weld1, weld2))
    return bool(weld1 != 0 and weld2 != 0 and (weld1 == parent2 or weld2 == parent1))
