"""Statics of layouts: every object has the centre of mass of all that it carries over the patch that it stands on.

An oracle of the kernel that judges standing, in double precision and by shapely, without MuJoCo's contacts.
"""

from __future__ import annotations

import numpy as np
import shapely

from sceniris_gym.audit.auditor import Auditor, presence
from sceniris_gym.audit.geometry import Form, Poses, poses_of, solids_of, subtree
from sceniris_gym.audit.scene import Carrier
from sceniris_gym.audit.supports import HEIGHT_TOLERANCE, surface_of
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.scene.layout_table import LayoutTable

LOW = 5e-4  # m; what is this near to the lowest point touches the support, also as a curved foot rocks by 2.5 degrees
EDGE = 1e-4  # m; a centre of mass this far outside of a patch is still over it
_APART = 5e-3  # m; what carries a thing ends this far above what is seen of it, at most: 1.8 mm with shipped ones
_ENDLESS = shapely.box(-1e4, -1e4, 1e4, 1e4)


class Balance:
    """Judges the statics of layouts, level by level: a support carries the weight of everything above it.

    Contacts are rigid here. Layouts do not tell the masses of their episodes, so objects are left out where `randomize`
    moves the centre of what they carry.

    Args:
        auditor: The audit of the scene, which says where supports are.
    """

    def __init__(self, auditor: Auditor) -> None:
        self._standing, self._starts = auditor.standing, auditor.starts
        self._scene = scene = auditor.scene
        self._solids = [s for s in solids_of(scene.mjm, "physics") if s.form is not Form.HALFSPACE]
        filling = {name for heap in scene.config.heaps.values() for name in heap.of}
        objects = {n: p for n, p in scene.placed.items() if p.support is not None and n in scene.config.objects}
        self._owner = {n: self._carrier(p).owner for n, p in objects.items() if p.has_to_stand or n in filling}
        self._loads = {name: [name] for name in self._owner}  # all that each of them carries, itself first
        for name in self._owner:
            below = self._owner[name]
            while below in self._loads:
                self._loads[below].append(name)
                below = self._owner[below]
        self._judged = [name for name in self._owner if name not in filling and not self._is_drawn(name)]

    def falling(self, table: LayoutTable) -> list[tuple[int, str]]:
        """Return the objects that fall over, or make what is below them fall, with their rows."""
        poses, there = poses_of(self._scene.mjm, table), presence(self._scene.config, table)
        _, supporting = self._standing.check(poses, there)
        moved = self._starts.moved(table, there)
        weight = {name: self._weight(name, poses) * there[name][:, None] for name in self._owner}
        load = {name: np.sum([weight[other] for other in others], axis=0) for name, others in self._loads.items()}
        found = []
        for name in self._judged:
            elsewhere = moved.get(name, np.zeros(len(table), bool))
            rows = np.flatnonzero((supporting[name] >= 0) & there[name] & (load[name][:, 0] > 0.0) & ~elsewhere)
            if not len(rows):
                continue
            center = load[name][rows, 1:] / load[name][rows, :1]
            carried = self._carried(name, Poses(*(array[rows] for array in vars(poses).values())), center)
            found += [(int(row), name) for row in rows[~carried]]
        return sorted(found)

    def _carrier(self, part: ObjectConfig) -> Carrier:
        assert part.support is not None
        return self._scene.carrier(part.support.parent)

    def _is_drawn(self, name: str) -> bool:
        """Return whether draws move the centre of mass of an object with all that it carries."""
        load = self._loads[name]
        words = {word for each in load for word in self._scene.config.objects[each].randomize}
        single = len(load) == 1 and len(subtree(self._scene.mjm, self._scene.bodies[name])) == 1
        return "ipos" in words or ("mass" in words and not single)

    def _weight(self, name: str, poses: Poses) -> np.ndarray:
        """Return the mass that gravity acts on, and its first moment, in each row [kg, kg m], shape (nrow, 4)."""
        mjm = self._scene.mjm
        bodies = sorted(subtree(mjm, self._scene.bodies[name]))
        mass = mjm.body_mass[bodies] * (1.0 - mjm.body_gravcomp[bodies])
        center = poses.xpos[:, bodies] + np.einsum("nbij,bj->nbi", poses.xmat[:, bodies], mjm.body_ipos[bodies])
        total = np.full((len(center), 1), mass.sum())
        return np.hstack([total, np.einsum("b,nbi->ni", mass, center)])

    def _carried(self, name: str, poses: Poses, center: np.ndarray) -> np.ndarray:
        """Return a mask of the rows in which a centre of mass (nrow, 3) is over the patch that an object stands on."""
        part, standing, mjm = self._scene.placed[name], self._standing, self._scene.mjm
        carrier = self._carrier(part)
        bodies = subtree(mjm, self._scene.bodies[name])
        parts = [
            surface_of(s)[0] @ poses.geom_xmat[:, s.geom].transpose(0, 2, 1) + poses.geom_xpos[:, s.geom, None]
            for s in self._solids
            if int(mjm.geom_bodyid[s.geom]) in bodies
        ]
        ground = [standing.in_frame(carrier.body, poses, points) for points in parts]
        at = standing.in_frame(carrier.body, poses, center[:, None])[:, 0, :2]
        lowest = np.min([points[:, :, 2].min(1) for points in ground], axis=0)
        over = np.zeros(len(center), bool)
        height = 2 * HEIGHT_TOLERANCE if self._scene.config.geometry == "physics" else _APART
        for surface in standing.surfaces("in", carrier):
            off = np.abs(lowest - surface.height - standing.gap(name, carrier))
            level = np.flatnonzero(off <= height)
            area = _ENDLESS if carrier.is_ground or standing.planes(carrier) else surface.area
            touching = [shapely.intersection(_feet(points[level], lowest[level]), area) for points in ground]
            pieces = [shapely.geometrycollections(list(piece)) for piece in zip(*touching, strict=True)]
            patch = shapely.convex_hull(np.array(pieces, object))
            over[level] |= shapely.distance(patch, shapely.points(at[level])) <= EDGE
        return over


def _feet(points: np.ndarray, lowest: np.ndarray) -> np.ndarray:
    """Return the hull of the low points of a convex solid in each row, from its vertices (nrow, n, 3)."""
    row, number = np.nonzero(points[:, :, 2] <= lowest[:, None] + LOW)
    feet = np.full(len(points), shapely.Point(), object)
    if len(row):
        clouds = shapely.multipoints(points[row, number, :2], indices=np.unique(row, return_inverse=True)[1])
        feet[np.unique(row)] = shapely.convex_hull(clouds)
    return feet
