"""Contacts of layouts in MuJoCo C: missed collisions, and allowed contacts with the reason.

MuJoCo applies its rules: contact bits, `exclude` and `pair`, margins, parents and welded bodies. Two kinds of contact
are allowed:

- An object may be within the contact margin of its support, but must not intersect it.
- If two geoms touch in the start pose, and layouts do not change their relative pose, the depth of the start pose is
  allowed. Examples: links of a robot, doors of a cabinet, a robot and its desk.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace

import mujoco

from sceniris_gym.audit.collisions import Tree
from sceniris_gym.audit.geometry import Rows, home_of
from sceniris_gym.scene.layout_table import LayoutTable

CONTACT_TOLERANCE = 1e-5  # m, a deeper contact is a collision
ROUNDING = 1e-6  # m, variation of the depth of contacts between geoms that stay as they are at home
_APART = 1000.0  # m, distance between placed objects in the search for contacts at home


@dataclass(frozen=True)
class Contact:
    """A contact of two geoms in a layout.

    Attributes:
        row: The layout.
        geoms: Ids of the two geoms, the lower one first.
        owners: Names of the two objects.
        depth: How much nearer [m] the geoms are than their margin, the distance at which MuJoCo starts to act. Between
            an object and its support, the depth of the penetration.
        home: The depth in the start pose [m]. None if the two geoms are apart in the start pose.
    """

    row: int
    geoms: tuple[int, int]
    owners: tuple[str, str]
    depth: float
    home: float | None

    @property
    def excess(self) -> float:
        """The depth beyond the allowed depth [m]."""
        return self.depth - (self.home or 0.0)


Allowed = dict[tuple[str, str], tuple[str, float, float]]
"""Names of two bodies with allowed contacts -> the reason, the depth of their contact in the start pose [m], 0 if they
only touch, and the greatest depth in the layouts [m]."""


class ContactAudit:
    """Judges the contacts of layouts.

    Args:
        tree: Owners of the bodies.
        placed: Name -> root body id of the objects whose poses are drawn.
        markers: Names of objects that may intersect anything.

    Attributes:
        at_home: Pair of geoms that touch in the start pose, the lower id first -> their depth [m]. The auditor adds
            pairs of geoms in heaps with an allowed depth, because MuJoCo settled these geoms in contact.
    """

    def __init__(self, tree: Tree, placed: Mapping[str, int], markers: set[str]) -> None:
        self.tree, self._markers = tree, markers
        self._data = mujoco.MjData(tree.mjm)
        self.at_home = self._touching_at_home(placed)

    def contacts(self, table: LayoutTable, supporting: Rows) -> Iterator[Contact]:
        """Yield the deepest contact of every pair of geoms in every row, including allowed contacts.

        Args:
            table: The layouts.
            supporting: Object name -> id of the supporting body in each row, shape (nrow,), -1 without support.
        """
        mjm, data, owner = self.tree.mjm, self._data, self.tree.owner
        for row in range(len(table)):
            table.put(data, row)
            mujoco.mj_kinematics(mjm, data)
            for geoms, (dist, margin) in deepest_contacts(mjm, data).items():
                bodies = mjm.geom_bodyid[list(geoms)]
                carried = any(
                    owner[one] in supporting and supporting[owner[one]][row] == other
                    for one, other in (bodies, bodies[::-1])
                )
                depth = -dist if carried else margin - dist
                owners = owner[bodies[0]], owner[bodies[1]]
                if depth > 0.0 and not self._markers.intersection(owners):
                    yield Contact(row, geoms, owners, depth, self.at_home.get(geoms))

    def _touching_at_home(self, placed: Mapping[str, int]) -> dict[tuple[int, int], float]:
        """Return pairs of geoms that touch in the start pose -> depth [m].

        Placed objects are first moved far away from all other objects.
        """
        mjm, owner, data = self.tree.mjm, self.tree.owner, home_of(self.tree.mjm, self.tree.keyframe)
        for i, body in enumerate(placed.values(), start=1):
            away = [_APART * i, 0.0, _APART]
            if mjm.body_mocapid[body] >= 0:
                data.mocap_pos[mjm.body_mocapid[body]] = away
            elif mjm.body_jntnum[body] and int(mjm.jnt_type[mjm.body_jntadr[body]]) == mujoco.mjtJoint.mjJNT_FREE:
                adr = mjm.jnt_qposadr[mjm.body_jntadr[body]]
                data.qpos[adr : adr + 3] = away
        mujoco.mj_kinematics(mjm, data)
        wide = copy(mjm)  # also reports geoms that are apart, but nearer than the tolerance
        wide.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_OVERRIDE
        wide.opt.o_margin = CONTACT_TOLERANCE
        found: dict[tuple[int, int], float] = {}
        for model in (wide, mjm):
            for geoms, (dist, margin) in deepest_contacts(model, data).items():
                owners = {owner[int(mjm.geom_bodyid[g])] for g in geoms}
                if len(owners) == 1 or not owners & set(placed):
                    depth = margin - dist if model is mjm else -dist
                    found[geoms] = max(depth, found.get(geoms, 0.0))
        return found


class ContactTally:
    """Running counts of missed collisions and allowed contacts.

    Args:
        mjm: The model.
        geometry: "physics" or "visual". With "visual", all contacts are allowed.
        heaped: Pairs of geoms, the lower id first, that MuJoCo settled in contact.

    Attributes:
        deepest: The contact with the greatest excess, or None.
    """

    def __init__(self, mjm: mujoco.MjModel, geometry: str, heaped: Collection[tuple[int, int]] = ()) -> None:
        self._mjm, self._visual, self._heaped = mjm, geometry == "visual", heaped
        self._allowed: dict[tuple[int, int], tuple[str, float, float]] = {}  # pair of bodies -> value of `Allowed`
        self.deepest: Contact | None = None

    def add(self, start: int, contacts: Iterable[Contact]) -> list[Contact]:
        """Count the contacts of a chunk of rows that begins at row `start`, and return the missed collisions."""
        missed = []
        for c in contacts:
            if self._visual or c.home is not None:
                first, second = sorted(int(self._mjm.geom_bodyid[g]) for g in c.geoms)
                unknown = ("the scene keeps visual geoms apart", 0.0, 0.0)
                why, home, depth = self._allowed.get((first, second), unknown)
                if c.home is not None:
                    why = "they lie in a heap" if c.geoms in self._heaped else "they touch at home"
                self._allowed[first, second] = why, max(c.home or 0.0, home), max(c.depth, depth)
            if self._visual or c.excess <= 0.0:
                continue
            if self.deepest is None or c.excess > self.deepest.excess:
                self.deepest = replace(c, row=start + c.row)
            if c.excess > CONTACT_TOLERANCE:
                missed.append(c)
        return missed

    def allowed(self) -> Allowed:
        """Return the pairs of bodies with allowed contacts."""
        names = [self._mjm.body(b).name or f"body {b}" for b in range(self._mjm.nbody)]
        return {(names[one], names[other]): found for (one, other), found in sorted(self._allowed.items())}


def deepest_contacts(mjm: mujoco.MjModel, data: mujoco.MjData) -> dict[tuple[int, int], tuple[float, float]]:
    """Return the deepest contact of each pair of geoms at the poses in `data`.

    Returns:
        Pair of geoms, the lower id first -> their distance, and the distance at which MuJoCo starts to act [m].
    """
    mujoco.mj_comPos(mjm, data)
    mujoco.mj_collision(mjm, data)
    columns = (data.contact.geom, data.contact.dist, data.contact.includemargin)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    acting = sorted((min(g), max(g), -dist, margin) for g, dist, margin in rows if min(g) >= 0 and dist <= margin)
    return {(first, second): (-depth, margin) for first, second, depth, margin in acting}  # keeps the last, the deepest
