"""Checks the place of each placed object: support, region, heap, and whether the support covers it from above."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import shapely

from sceniris_gym.audit import supports
from sceniris_gym.audit.collisions import JudgedPairs
from sceniris_gym.audit.distance import Narrow
from sceniris_gym.audit.geometry import Form, Poses, Rows, Solid, rotation
from sceniris_gym.audit.scene import Carrier, JudgedScene, Outlines
from sceniris_gym.audit.supports import EDGE_TOLERANCE, HEIGHT_TOLERANCE, LevelSurface, inside, surface_of
from sceniris_gym.config.bounds import LEAST_GAP
from sceniris_gym.config.objects import ObjectConfig

DEEPEST = 1e-3  # m, greatest depth of the soft contacts in a heap
AS_SETTLED = 1e-5  # greatest difference from a settled row, of a position [m] or an entry of a rotation matrix
_HIGH = 10.0  # m, a solid that is higher than this above a point does not cover the point
_AROUND = np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) * EDGE_TOLERANCE


@dataclass(frozen=True)
class Misplaced:
    """An object in a place that the scene file does not permit.

    Attributes:
        row: The layout.
        name: The object.
        cause: "support" (the pivot is off the surfaces of the support, or outside the region), "footprint" (a part of
            the object overhangs), "overhead" (the support covers the object from above but should not, or the reverse),
            "heap" (no settled row matches), "start" (the fingers do not hold the object, or it is not at its marker) or
            "falls" (the object has to stand, but MuJoCo C moves it by more than 1 cm in half a second).
    """

    row: int
    name: str
    cause: str


class HeapAudit:
    """Compares the objects of each heap with the settled rows in its file. It shares no code with the generator.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: JudgedScene) -> None:
        self.mjm, self.bodies = scene.mjm, scene.bodies
        self._filled = [(heap, scene.carrier(heap.fill).body) for heap in scene.config.heaps.values()]

    def may_touch(self) -> dict[tuple[int, int], float]:
        """Return the pairs of geoms that may touch in a heap, the lower id first -> allowed depth [m]."""
        found, of = {}, self.mjm.geom_bodyid
        root, weld = self.mjm.body_rootid[of], self.mjm.body_weldid[of]
        for heap, filled in self._filled:
            things = np.flatnonzero(np.isin(root, [self.bodies[name] for name in heap.of])).tolist()
            rigid = (root == self.mjm.body_rootid[filled]) & (weld == self.mjm.body_weldid[filled])
            walls = np.flatnonzero(rigid).tolist()
            for i, one in enumerate(things):
                for other in (*things[i + 1 :], *walls):
                    if of[one] != of[other]:
                        found[min(one, other), max(one, other)] = DEEPEST
        return found

    def elsewhere(self, poses: Poses) -> dict[str, np.ndarray]:
        """Return object -> mask of the rows where the object's heap matches no settled row of poses, shape (nrow,)."""
        found = {}
        for heap, filled in self._filled:
            with np.load(Path(str(heap.rows))) as stored:
                pos, quat = stored["pos"].astype(float), stored["quat"].astype(float)
            mats = rotation(quat)
            off = np.zeros((len(poses.xpos), len(pos)))
            for i, name in enumerate(heap.of):
                back = poses.xmat[:, filled].transpose(0, 2, 1)
                at = np.einsum("nij,nj->ni", back, poses.xpos[:, self.bodies[name]] - poses.xpos[:, filled])
                relative = back @ poses.xmat[:, self.bodies[name]]
                off = np.maximum(off, np.abs(at[:, None] - pos[:, i]).max(2))
                off = np.maximum(off, np.abs(relative[:, None] - mats[:, i]).max((2, 3)))
            found |= dict.fromkeys(heap.of, off.min(1) > AS_SETTLED)
        return found


class StandingAudit:
    """Checks the places of objects in layouts.

    Args:
        scene: The scene.
        outlines: Outlines of the objects.
        heaps: The check of heaps.
        pairs: The pairs of solids that must be apart.

    Attributes:
        hulls: Object name -> corners of its convex hull in the start pose [m], in the frame of its root, shape (n, 3).
        surfaces: Function of a key ('on', 'in' or 'inside') and a carrier. It returns the level surfaces of the
            carrier, in the frame of the carrier's body.
    """

    def __init__(self, scene: JudgedScene, outlines: Outlines, heaps: HeapAudit, pairs: JudgedPairs) -> None:
        self.scene, self.outlines, self._heaps = scene, outlines, heaps
        self._planes = [s.geom for s in scene.solids if s.form is Form.HALFSPACE]
        ray = Solid(-1, Form.ROUNDED, np.array([[0, 0, 0], [0, 0, _HIGH]]), np.zeros((0, 3), int), 0.0, np.zeros(3))
        self._narrow = Narrow([*scene.solids, ray])
        self.hulls = scene.hulls(scene.solids)
        self.surfaces = cache(self._surfaces)
        self._pairs, self._touch = pairs, cache(self._touching)

    def check(self, poses: Poses, there: Rows) -> tuple[list[Misplaced], dict[str, np.ndarray]]:
        """Judge all placed objects in the rows where they are present.

        Args:
            poses: World poses of the rows.
            there: Object name -> mask of the rows with the object, shape (nrow,).

        Returns:
            The misplaced objects, and object name -> id of the supporting body in each row, shape (nrow,), -1 without
            support.
        """
        supporting, elsewhere = {}, self._heaps.elsewhere(poses)
        wrong = {(name, "heap"): rows for name, rows in elsewhere.items()}
        for name, part in self.scene.placed.items():
            if name in elsewhere:
                continue
            rows = np.flatnonzero(there[name])
            body, found = self._check(name, part, poses.take(rows)) if len(rows) else (np.zeros(0, int), {})
            if part.support is not None:
                supporting[name] = np.full(len(there[name]), -1)
                supporting[name][rows] = body
            for cause, mask in found.items():
                wrong[name, cause] = np.zeros(len(there[name]), bool)
                wrong[name, cause][rows] = mask
        found = [Misplaced(int(row), *key) for key, rows in wrong.items() for row in np.flatnonzero(rows)]
        return sorted(found, key=lambda m: (m.row, m.name)), supporting

    def _check(self, name: str, part: ObjectConfig, poses: Poses) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Judge a placed object. Return its supporting body in each row, and a mask of the rows for each cause."""
        outline = self.outlines.outline(name, poses)
        pivots, erosion = outline.pivot, part.ratio_on_support / 2 * (outline.high - outline.low).min(1)
        if part.support is None:
            return np.full(len(pivots), -1), {"support": ~_in_space(part, pivots)}
        if name in self.scene.config.all_robots:  # a robot stands on its lowest point, which may not be its origin
            pivots = np.column_stack([pivots[:, :2], self._corners(name, poses)[:, :, 2].min(axis=1)])
        carrier = self.scene.carrier(part.support.parent)
        body, stands = self._supporting(name, part, carrier, poses, pivots, erosion)
        covered = self._wrongly_covered(part.support.word, carrier, poses, pivots)
        return body, {"support": body < 0, "footprint": (body >= 0) & ~stands, "overhead": covered}

    def _supporting(
        self, name: str, part: ObjectConfig, carrier: Carrier, poses: Poses, pivots: np.ndarray, erosion: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the supporting body in each row, and a mask of the rows where it carries the required footprint.

        An object has support if its pivot (nrow, 3) is in its region and at the right height over a surface, at least
        `erosion` [m] (nrow,) from the surface's edge. Otherwise, the body is -1.
        """
        assert part.support is not None
        ground = carrier.body
        body, stands = np.full(len(pivots), -1), np.zeros(len(pivots), bool)
        local = self.in_frame(ground, poses, pivots[:, None])[:, 0]
        whole = part.ratio_on_support == 1.0
        corners = self.in_frame(ground, poses, self._corners(name, poses))[:, :, :2] if whole else local[:, None, :2]
        surfaces = self.surfaces(part.support.word, carrier)
        if not surfaces:  # a body of `{any: NAME}` that is covered where the start pose does not show it
            return body, stands
        bounds = shapely.total_bounds([surface.area for surface in surfaces])
        for surface in surfaces:
            off = np.abs(local[:, 2] - surface.height - self.gap(name, carrier))
            level = np.flatnonzero(off <= HEIGHT_TOLERANCE)
            allowed = inside(surface.area, local[level, :2], erosion[level])
            allowed &= _in_region(surface.area, bounds, part, local[level, :2])
            on = level[allowed]
            body[on] = ground
            stands[on] = not whole or _all_inside(surface.area, corners[on])
        return body, stands

    def gap(self, name: str, carrier: Carrier) -> float:
        """Return an object's height [m] above its support: `gap` in the scene file, or more to avoid a contact."""
        touch = self._touch(name, carrier.body)
        return max(self.scene.placed[name].gap, touch + LEAST_GAP if touch > 0.0 else 0.0)

    def _touching(self, name: str, body: int) -> float:
        """Return the distance [m] at which contacts of an object with a carrying body act, 0 without contacts."""
        of, owners = self.scene.mjm.geom_bodyid, (name, self.scene.tree.owner[body])
        pairs = self._pairs.between(*owners) if self._pairs.of.keys() >= {*owners} else ()
        ends = [
            (pair.margin, {int(of[self.scene.solids[i].geom]) for i in (pair.first, pair.second)}) for pair in pairs
        ]
        return max((margin for margin, bodies in ends if body in bodies), default=0.0)

    def in_frame(self, body: int, poses: Poses, points: np.ndarray) -> np.ndarray:
        """Return world points (nrow, n, 3) in the frame of a body, NaN in rows where the body is tilted."""
        local = (points - poses.xpos[:, body, None]) @ poses.xmat[:, body]
        return np.where(poses.xmat[:, body, 2, 2][:, None, None] >= supports.UPRIGHT, local, np.nan)

    def _corners(self, name: str, poses: Poses) -> np.ndarray:
        """Return the corners of an object's hull in each row [m], world frame, shape (nrow, n, 3)."""
        root = self.scene.bodies[name]
        return self.hulls[name] @ poses.xmat[:, root].transpose(0, 2, 1) + poses.xpos[:, root, None]

    def _surfaces(self, word: str, carrier: Carrier) -> list[LevelSurface]:
        """Return the level surfaces of a support, in the frame of its body."""
        body, geom = carrier.body, carrier.geom
        if carrier.is_ground:
            assert self.scene.config.floor is not None
            x, y = (extent / 2 for extent in self.scene.config.floor.size)
            return [LevelSurface(0.0, shapely.box(-x, -y, x, y))]
        # Space above a static support counts as open: the collision checks handle objects above it.
        open_above = word == "on" and carrier.owner is not None
        size = self.scene.mjm.geom_size
        rectangles = [supports.plane_surface(size[g], *self.scene.at_home(g, body)) for g in self.planes(carrier)]
        found = supports.level_surfaces(self._triangles(body), open_above=open_above, only=geom)
        return found + [surface for surface in rectangles if surface is not None]

    def planes(self, carrier: Carrier) -> list[int]:
        """Return the ids of the plane geoms of a support."""
        of = self.scene.mjm.geom_bodyid
        return [g for g in self._planes if of[g] == carrier.body and carrier.geom in (None, g)]

    def _triangles(self, body: int) -> dict[int, np.ndarray]:
        """Return the outward triangles [m] of each geom of a body, by geom id, shape (n, 3, 3), in the body's frame."""
        parts = {}
        for solid in self.scene.solids:
            if self.scene.mjm.geom_bodyid[solid.geom] == body and solid.form is not Form.HALFSPACE:
                vertices, faces = surface_of(solid)
                pos, mat = self.scene.at_home(solid.geom, body)
                parts[solid.geom] = (vertices @ mat.T + pos)[faces]
        return parts

    def _wrongly_covered(self, word: str, carrier: Carrier, poses: Poses, pivots: np.ndarray) -> np.ndarray:
        """Return a mask of the rows where the support covers the object but should not, or the reverse, shape (nrow,).

        Close to an edge, rounding decides whether a vertical ray hits. A row therefore only counts as wrong if five
        rays give this result: from the pivot, and from four points around it.
        """
        wrong = np.zeros(len(pivots), bool)
        if word == "in" or carrier.is_ground or (word == "on" and carrier.owner is None):
            return wrong
        rows = np.arange(len(pivots))
        for shift in _AROUND:
            covered = self._covered(carrier, poses, rows, pivots[rows] + shift)
            rows = rows[covered if word == "on" else ~covered]
        wrong[rows] = True
        return wrong

    def _covered(self, carrier: Carrier, poses: Poses, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return whether the support (object or body) has a solid above each point (n, 3) of the rows (n,)."""
        covered = np.zeros(len(rows), bool)
        for i, solid in enumerate(self.scene.solids):
            body = int(self.scene.mjm.geom_bodyid[solid.geom])
            other = self.scene.tree.owner[body] != carrier.owner if carrier.owner is not None else body != carrier.body
            if other or solid.form is Form.HALFSPACE:
                continue
            for k in np.flatnonzero(~covered):
                pose = poses.geom_xpos[rows[k], solid.geom], poses.geom_xmat[rows[k], solid.geom]
                covered[k] = self._narrow.distance(i, len(self.scene.solids), pose, (points[k], np.eye(3))) <= 0.0
        return covered


def _in_space(part: ObjectConfig, points: np.ndarray) -> np.ndarray:
    """Return a mask of the points (n, 3) that lie in the object's 3D region: in its box, or at one of its points."""
    assert part.region is not None
    if part.region.points is not None:
        return _at_one_of(part.region.points, points)
    low, high = np.array(part.region.box)
    return np.all((points >= low - EDGE_TOLERANCE) & (points <= high + EDGE_TOLERANCE), axis=1)


def _at_one_of(allowed: tuple[tuple[float, ...], ...], points: np.ndarray) -> np.ndarray:
    """Return a mask of the points (n, k) that equal an allowed point, up to the edge tolerance in each coordinate."""
    return np.any([(np.abs(points - np.array(at)) <= EDGE_TOLERANCE).all(axis=1) for at in allowed], axis=0)


def _in_region(area: shapely.Geometry, bounds: np.ndarray, part: ObjectConfig, points: np.ndarray) -> np.ndarray:
    """Return a mask of the points (n, 2) that are on a surface and in the object's region.

    `bounds` (4,) enclose all surfaces of the support.
    """
    if (region := part.region) is None:
        return inside(area, points)
    if region.points is not None:
        return _at_one_of(region.points, points)
    if region.polygon is not None:
        return inside(shapely.intersection(area, shapely.Polygon(region.polygon)), points)
    corners = np.array(region.box)
    if region.box is None:
        corners = bounds[:2] + (bounds[2:] - bounds[:2]) * np.array(region.fraction)
    return inside(shapely.intersection(area, shapely.box(*corners.ravel())), points)


def _all_inside(area: shapely.Geometry, corners: np.ndarray) -> np.ndarray:
    """Return a mask of the rows of corners (n, k, 2) whose hull lies inside the area."""
    grown = shapely.buffer(area, EDGE_TOLERANCE, join_style="mitre")
    shapely.prepare(grown)
    return np.asarray(shapely.covers(grown, shapely.convex_hull(shapely.multipoints(corners))))
