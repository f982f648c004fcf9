"""Check of starts: what is held touches the fingers of its robot from two sides, what is placed is at its marker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from sceniris_gym.audit.collisions import Conflict
from sceniris_gym.audit.contacts import Contact
from sceniris_gym.audit.geometry import Poses, Rows
from sceniris_gym.audit.relations import Excess
from sceniris_gym.audit.scene import JudgedScene, Outlines
from sceniris_gym.audit.standing import Misplaced
from sceniris_gym.scene.layout_table import LayoutTable

Sides = dict[tuple[int, str], set[int]]
"""(Row, object) -> geoms of a robot that touch it."""
_AT_MARKER = 1e-4  # m; greatest distance of an object from its marker, seen from above


class StartAudit:
    """Judges the starts of layouts, and says what they excuse.

    Args:
        scene: The scene.
        outlines: Outlines of the objects.
    """

    def __init__(self, scene: JudgedScene, outlines: Outlines) -> None:
        self.scene, self._outlines, groups = scene, outlines, scene.config.groups
        kinds = [(i, kind, kind.targets(groups)) for i, kind in enumerate(scene.config.start)]
        self._grasped = [(i, name) for i, kind, names in kinds if kind.robot == "grasp" for name in names]
        self._moved = [(i, n) for i, kind, names in kinds for n in (*(names if kind.is_held else ()), *kind.place)]
        placed = {name for kind in scene.config.start for name in kind.place}
        supports = {name: scene.config.parts[name].support for name in placed}
        carriers = {name: scene.carrier(support.parent).body for name, support in supports.items() if support}
        self._carriers = {name: scene.tree.owner[body] for name, body in carriers.items()}

    def grasped(self, table: LayoutTable) -> dict[str, np.ndarray]:
        """Return object -> rows in which an arm holds it."""
        return _rows(table, self._grasped)

    def moved(self, table: LayoutTable) -> dict[str, np.ndarray]:
        """Return object -> rows in which its support, region, relations and orientation do not say where it is."""
        return _rows(table, self._moved)

    def excuse(self, excess: Excess, moved: Rows) -> Excess:
        """Return violations without those of objects that are moved, or that refer to one that is."""
        found = dict(excess)
        parts = self.scene.config.parts
        for key in excess:
            if key[0] in parts and key[1] != "present":
                names = {key[0], *parts[key[0]].needs}
                for rows in (moved[name] for name in names & moved.keys()):
                    found[key] = np.where(rows, np.nan, found[key])
        return found

    def excuses(self, table: LayoutTable, conflict: Conflict, grasped: Rows) -> bool:
        """Return whether a start excuses a conflict: of an arm and what it holds, or of clearances alone.

        An arm that has left its start pose, and what it holds in the air, keep no clearance; they only touch nothing. A
        thing at its marker keeps none from its support, as everywhere.
        """
        number, owners, config = int(table.start[conflict.row]), set(conflict.owners), self.scene.config
        if number < 0:
            return False
        if self._holds(conflict.owners, conflict.row, grasped):
            return True
        kind = config.start[number]
        targets = kind.targets(config.groups)
        free = {*map(config.robot_for, targets), *(targets if kind.is_held else ())}
        stands = any(owners == {name, self._carriers[name]} for name in kind.place)
        return conflict.distance > 0.0 and (stands or bool(free & owners))

    def _holds(self, owners: tuple[str, str], row: int, grasped: Rows) -> bool:
        """Return whether two owners are an object and the robot that holds it."""
        return any(
            one in grasped and grasped[one][row] and self.scene.config.robot_for(one) == other
            for one, other in (owners, owners[::-1])
        )

    def between(self, contacts: Iterable[Contact], grasped: Rows, sides: Sides) -> Iterator[Contact]:
        """Yield the contacts that no start excuses, and collect the robot's geoms that touch what it holds.

        Args:
            contacts: The contacts.
            grasped: As from `grasped`.
            sides: Filled with the robot's geoms that touch what it holds.
        """
        for contact in contacts:
            if not self._holds(contact.owners, contact.row, grasped):
                yield contact
                continue
            for geom, other in zip(contact.geoms, contact.owners[::-1], strict=True):
                if other in grasped:
                    sides.setdefault((contact.row, other), set()).add(geom)

    def check(self, table: LayoutTable, poses: Poses, there: Rows, sides: Sides) -> list[Misplaced]:
        """Return what is not held, or not at its marker, although the start says so; `sides` as from `between`."""
        found = [
            Misplaced(int(row), name, "start")
            for name, rows in self.grasped(table).items()
            for row in np.flatnonzero(rows & there[name])
            if len(sides.get((int(row), name), ())) < 2
        ]
        for i, kind in enumerate(self.scene.config.start):
            for name, marker in kind.place.items():
                own, other = (self._outlines.outline(n, poses).pivot[:, :2] for n in (name, marker))
                away = np.linalg.norm(own - other, axis=1) > _AT_MARKER
                found += [Misplaced(int(row), name, "start") for row in np.flatnonzero((table.start == i) & away)]
        return found


def _rows(table: LayoutTable, named: Sequence[tuple[int, str]]) -> dict[str, np.ndarray]:
    """Return object -> rows with one of the kinds of starts that are listed with it."""
    return {name: np.isin(table.start, [i for i, other in named if other == name]) for _, name in named}
