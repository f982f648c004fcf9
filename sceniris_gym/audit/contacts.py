"""Asks MuJoCo C what collides in layouts, and judges it: a contact is a missed collision, or says why it is none.

MuJoCo's own rules hold as it applies them: contact bits, `exclude` and `pair`, margins, parents and welded bodies. Two
kinds of contact are allowed for:

- What carries an object may come within the margin of the pair, but not intersect it.
- Geoms that touch at home already, in poses relative to each other that no placing changes: of links of a robot, of
  doors of a cabinet, of a robot and the desk it is mounted on. They may be as deep as they are at home.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sceniris_gym.audit.geometry import home_of
from sceniris_gym.audit.pairs import Tree
from sceniris_gym.scene.layout_table import LayoutTable

CONTACT_TOLERANCE = 1e-5  # m; deeper than that is a collision
ROUNDING = 1e-6  # m; contacts of geoms that stay as they are at home are deeper and less deep by this
_APART = 1000.0  # m; distance between placed objects where contacts at home are looked for


@dataclass(frozen=True)
class Contact:
    """A contact of two geoms in a layout.

    Attributes:
        row: The layout.
        geoms: Ids of the two geoms, the lower one first.
        owners: Names of the two objects.
        depth: By how much they are nearer than the distance from which MuJoCo acts [m]; that distance is 0 for what
            carries an object, and where there is no margin.
        home: The same at home where the two geoms touch there, else None.
    """

    row: int
    geoms: tuple[int, int]
    owners: tuple[str, str]
    depth: float
    home: float | None

    @property
    def excess(self) -> float:
        """How much deeper it is than it may be [m]."""
        return self.depth - (self.home or 0.0)

    @property
    def acts(self) -> bool:
        """Whether it is deeper than it may be, by however little."""
        return self.excess > (0.0 if self.home is None else ROUNDING)


@dataclass(frozen=True)
class Allowed:
    """Two bodies whose contacts are allowed for.

    Attributes:
        names: Names of the two bodies.
        why: The reason.
        home: How deep they are in each other at home [m], 0 if they only touch.
        depth: How deep at most they are in the layouts [m].
    """

    names: tuple[str, str]
    why: str
    home: float
    depth: float


class ContactAudit:
    """Judges the contacts of layouts.

    Args:
        tree: Owners of the bodies.
        placed: Name -> root body id of the objects whose poses are drawn.
        markers: Names of objects that may be in anything.

    Attributes:
        at_home: Pairs of geoms, the lower id first, that touch at home -> how deep they are in each other there [m].
            Those of heaps, which touch as MuJoCo settled them, are added with how deep they may be.
    """

    def __init__(self, tree: Tree, placed: Mapping[str, int], markers: set[str]) -> None:
        self.tree, self._markers = tree, markers
        self._data = mujoco.MjData(tree.mjm)
        self.at_home = self._touching_at_home(placed)

    def contacts(self, table: LayoutTable, supporting: Mapping[str, np.ndarray]) -> Iterator[Contact]:
        """Yield the deepest contact of every two geoms in every row, also those that are allowed.

        Args:
            table: The layouts.
            supporting: Object name -> id of the body that carries it in each row, shape (nrow,), -1 for none.
        """
        mjm, data, owner = self.tree.mjm, self._data, self.tree.owner
        for row in range(len(table)):
            table.put(data, row)
            mujoco.mj_kinematics(mjm, data)
            deepest: dict[tuple[int, int], float] = {}
            for geoms, dist, margin in _pairs(mjm, data):
                bodies = mjm.geom_bodyid[list(geoms)]
                carried = any(
                    owner[one] in supporting and supporting[owner[one]][row] == other
                    for one, other in (bodies, bodies[::-1])
                )
                depth = -dist if carried else margin - dist
                deepest[geoms] = max(depth, deepest.get(geoms, 0.0))
            for geoms, depth in sorted(deepest.items()):
                first, second = (int(mjm.geom_bodyid[g]) for g in geoms)
                owners = owner[first], owner[second]
                if depth > 0.0 and not self._markers.intersection(owners):
                    yield Contact(row, geoms, owners, depth, self.at_home.get(geoms))

    def _touching_at_home(self, placed: Mapping[str, int]) -> dict[tuple[int, int], float]:
        """Find geoms that touch at home, each placed object far from all others, so that nothing is said of these."""
        mjm, owner, data = self.tree.mjm, self.tree.owner, home_of(self.tree.mjm, self.tree.keyframe)
        for i, body in enumerate(placed.values(), start=1):
            away = [_APART * i, 0.0, _APART]
            if mjm.body_mocapid[body] >= 0:
                data.mocap_pos[mjm.body_mocapid[body]] = away
            elif mjm.body_jntnum[body] and int(mjm.jnt_type[mjm.body_jntadr[body]]) == mujoco.mjtJoint.mjJNT_FREE:
                adr = mjm.jnt_qposadr[mjm.body_jntadr[body]]
                data.qpos[adr : adr + 3] = away
        mujoco.mj_kinematics(mjm, data)
        wide = copy(mjm)  # finds as well what is nearer than the tolerance
        wide.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_OVERRIDE
        wide.opt.o_margin = CONTACT_TOLERANCE
        found: dict[tuple[int, int], float] = {}
        for model in (wide, mjm):
            for geoms, dist, margin in _pairs(model, data):
                owners = {owner[int(mjm.geom_bodyid[g])] for g in geoms}
                if len(owners) == 1 or not owners & set(placed):
                    depth = margin - dist if model is mjm else -dist
                    found[geoms] = max(depth, found.get(geoms, 0.0))
        return found


class ContactTally:
    """Sorts contacts into missed collisions and what is allowed for, as they come in.

    Args:
        mjm: The model.
        geometry: "physics" or "visual"; with the latter all contacts are allowed for.
        heaped: Pairs of geoms, the lower id first, that touch as MuJoCo settled them.

    Attributes:
        deepest: The contact that is deepest beyond what it may be, None if there is none.
    """

    def __init__(self, mjm: mujoco.MjModel, geometry: str, heaped: Collection[tuple[int, int]] = ()) -> None:
        self._mjm, self._visual, self._heaped = mjm, geometry == "visual", heaped
        self._allowed: dict[tuple[int, int], Allowed] = {}
        self.deepest: Contact | None = None

    def add(self, start: int, contacts: Iterable[Contact]) -> list[Contact]:
        """Return those of some contacts that are missed collisions; their rows are counted from `start` on."""
        missed = []
        for c in contacts:
            if self._visual or c.home is not None:
                self._allow(c)
            if self._visual or c.excess <= 0.0:
                continue
            if self.deepest is None or c.excess > self.deepest.excess:
                self.deepest = replace(c, row=start + c.row)
            if c.excess > CONTACT_TOLERANCE:
                missed.append(c)
        return missed

    def allowed(self) -> list[Allowed]:
        """Return the pairs of bodies whose contacts were allowed for."""
        return [self._allowed[bodies] for bodies in sorted(self._allowed)]

    def _allow(self, c: Contact) -> None:
        first, second = sorted(int(self._mjm.geom_bodyid[g]) for g in c.geoms)
        names = tuple(self._mjm.body(b).name or f"body {b}" for b in (first, second))
        why = "the scene keeps what is drawn apart" if c.home is None else "they touch at home"
        why = "they lie in a heap" if c.geoms in self._heaped else why
        other = self._allowed.get((first, second))
        home, depth = c.home or 0.0, c.depth
        if other is not None:
            why = other.why if c.home is None else why
            home, depth = max(home, other.home), max(depth, other.depth)
        self._allowed[first, second] = Allowed((names[0], names[1]), why, home, depth)


def _pairs(mjm: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[tuple[int, int], float, float]]:
    """Yield geoms, distance [m] and the distance from which MuJoCo acts, of all contacts at the poses in `data`."""
    mujoco.mj_comPos(mjm, data)
    mujoco.mj_collision(mjm, data)
    contacts = data.contact
    for geoms, dist, margin in zip(
        contacts.geom.tolist(), contacts.dist.tolist(), contacts.includemargin.tolist(), strict=True
    ):
        if min(geoms) >= 0 and dist <= margin:
            yield (min(geoms), max(geoms)), dist, margin
