"""One world as the layers see it: its scene, and its state."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.geometry.upright_box import upright_box
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.plan import PlacedObject
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.scene.parking import PARKING_FROM


@dataclass(frozen=True)
class ShownWorld:
    """One world on show.

    Attributes:
        compiled: Its scene.
        table: Its layout, one row.
        unplaced: Objects that are shown nowhere, as they have no place yet.
        stands: Where each slot is, as the generator has it: pivot [m] and heading [rad], and bounds, shape (nslot, 4)
            each; None for a state that it does not have, where it is worked out from that.
    """

    compiled: CompiledScene
    table: LayoutTable
    unplaced: frozenset[str] = frozenset()
    stands: tuple[np.ndarray, np.ndarray] | None = None

    @cached_property
    def data(self) -> mujoco.MjData:
        """The state, kinematics up to date."""
        data = mujoco.MjData(self.compiled.mjm)
        self.table.put(data, 0)
        mujoco.mj_kinematics(self.compiled.mjm, data)
        mujoco.mj_comPos(self.compiled.mjm, data)
        return data

    @cached_property
    def absent(self) -> list[str]:
        """Objects that their groups left out."""
        return [name for name in self.compiled.object_names if not self.is_present(name)]

    def is_present(self, name: str) -> bool:
        """Whether an object takes part in this layout."""
        return bool(self.table.present[0, self.compiled.slots.index(name)])

    def is_shown(self, name: str) -> bool:
        """Whether an object stands somewhere in this world."""
        return self.is_present(name) and name not in self.unplaced

    def standing(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return where an object is as relations see it: pivot [m] and heading [rad], and bounds; see `Plan.place`."""
        slot = self.compiled.slots.index(name)
        if self.stands is not None:
            return self.stands[0][slot], self.stands[1][slot]
        plan = self.compiled.plan
        variants = self.placed(name).variants if name in self.compiled.placed else []
        if not variants:
            return plan.place[slot], plan.bounds[slot]
        root = self.compiled.scene.bodies[name]
        mat = self.data.xmat[root].reshape(3, 3)
        turns = [mat @ matrix(variant.quat).T for variant in variants]
        best = int(np.argmax([turn[2, 2] for turn in turns]))  # that about the vertical alone
        heading = np.arctan2(turns[best][1, 0], turns[best][0, 0])
        return np.array([*self.data.xpos[root] + mat @ variants[best].pivot, heading]), variants[best].bounds

    def box(self, name: str, root_alone: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner [m] of the upright box around an object, or around its root body alone."""
        mjm, data = self.compiled.mjm, self.data
        bodies = [self.compiled.scene.bodies[name]] if root_alone else self.compiled.scene.subtree(name)
        geoms = np.flatnonzero(np.isin(mjm.geom_bodyid, bodies))
        if not len(geoms):
            at = data.xpos[self.compiled.scene.bodies[name]]
            return at, at
        return upright_box(mjm, data, geoms)

    def placed(self, name: str) -> PlacedObject:
        """The step of the program that places an object."""
        return self.compiled.plan.objects[self.compiled.placed.index(name)]

    @property
    def placed_names(self) -> list[str]:
        """Objects, and robots whose base is drawn, that were placed in this world, in the order of the scene file."""
        parts = self.compiled.config.parts
        return [name for name in parts if parts[name].is_placed and self.is_shown(name)]

    def hidden_bodies(self, with_absent: bool = True) -> list[int]:
        """Bodies of objects that are not to be seen."""
        names = [*self.unplaced, *(self.absent if with_absent else [])]
        return [body for name in names for body in self.compiled.scene.subtree(name)]

    def parked_offsets(self, low: np.ndarray) -> dict[int, np.ndarray]:
        """How far the bodies of absent objects are from a row before the scene, whose lower corner is `low` [m]."""
        offsets = {}
        for i, name in enumerate(self.absent):
            at = np.array([low[0] + 0.15 + 0.3 * i, low[1] - 0.2, low[2]])
            root = self.data.xpos[self.compiled.scene.bodies[name]].copy()
            root[2] = 0.0 if root[0] > PARKING_FROM / 2.0 else root[2]
            offsets |= dict.fromkeys(self.compiled.scene.subtree(name), at - root)
        return offsets
