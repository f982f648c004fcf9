"""Layouts seen from above: pivots, headings and bounds from MuJoCo C, and supports and regions from shapely."""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import MultiPoint, Polygon, box

from sceniris_gym.config.relations import Joined, Relation
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.resting_poses import heading_of
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.plan import PlacedObject
from sceniris_gym.viewer.regions import Standing, area_of

_FAR = 10.0  # m, beyond the extent of all supports
_UNIT_BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


@dataclass(frozen=True)
class Bounds:
    """An object's pivot [m], shape (3,), its heading [rad], and its bounds around the pivot, aligned with the heading.

    The pivot of the robot is its base.
    """

    pivot: np.ndarray
    heading: float
    low: np.ndarray
    high: np.ndarray

    @property
    def shape(self) -> shapely.Geometry:
        """The bounds in the world frame."""
        return self.to_world(_box(self.low, self.high))

    def to_world(self, shape: shapely.Geometry) -> shapely.Geometry:
        """Transform a shape given around the pivot, aligned with the heading, to the world frame."""
        return _moved(shape, self.pivot, self.heading)

    @property
    def standing(self) -> Standing:
        """Place and bounds in the form of the viewer."""
        return np.array([*self.pivot, self.heading]), np.array([*self.low, *self.high])

    @property
    def front(self) -> np.ndarray:
        """Unit vector to the front, shape (2,)."""
        return np.array([math.sin(self.heading), -math.cos(self.heading)])


class View:
    """Layouts of a scene, one per world, seen from above.

    Args:
        config: The scene.
        nworld: Number of layouts. World i has seed i.
    """

    def __init__(self, config: SceneConfig, nworld: int) -> None:
        self.config = config
        self.compiled = compile_scene(config, "cpu", overrides={"bank": 16})
        generator = LayoutGenerator(self.compiled, nworld)
        generator.generate()
        layouts = generator.layouts
        self._fresh = layouts.status.cpu().numpy() == LayoutStatus.VALID
        self._present = layouts.present.cpu().numpy() == 1
        qpos, pos, quat = layouts.qpos.cpu().numpy(), layouts.mocap_pos.cpu().numpy(), layouts.mocap_quat.cpu().numpy()
        self._states = [self._posed(*row) for row in zip(qpos, pos, quat, strict=True)]
        drawn = [i for name in self.names for i in self.compiled.scene.joint_configs(name)]
        adr = self.compiled.mjm.jnt_qposadr[drawn]
        qpos[:, adr] = self.compiled.home_qpos[adr]
        self._with_joints_at_home = [self._posed(*row) for row in zip(qpos, pos, quat, strict=True)]

    @property
    def names(self) -> tuple[str, ...]:
        """All objects, then the robots."""
        return self.compiled.slots

    def is_placed(self, name: str) -> bool:
        """Return whether a pose is sampled for the object, or for the base of the robot."""
        return name in self.config.parts and self.config.parts[name].is_placed

    def is_point(self, name: str) -> bool:
        """Return whether the object has no extent."""
        return not self._geoms(self.compiled.scene.subtree(name))

    def is_fresh(self, i: int) -> bool:
        """Return whether world i has a fresh layout, not a layout from the bank."""
        return bool(self._fresh[i])

    def is_present(self, name: str, i: int) -> bool:
        """Return whether an object is present in world i."""
        return bool(self._present[i, self.names.index(name)])

    def worlds(self, name: str) -> list[int]:
        """Return the worlds with an object."""
        return [int(i) for i in np.flatnonzero(self._present[:, self.names.index(name)])]

    def stays(self, name: str) -> bool:
        """Return whether an object and its joints have the same state in all worlds, to a few millimetres."""
        at = np.array([self._states[i].xpos[self.bodies(name)] for i in self.worlds(name)])
        return bool(np.ptp(at, axis=0).max() < 0.005)

    def bounds(self, name: str, i: int) -> Bounds:
        """Return the bounds of an object in world i. Sampled joints change only the height of its pivot."""
        return self._bounds(name, self.bodies(name), i)

    def root_bounds(self, name: str, i: int) -> Bounds:
        """Return the bounds of only an object's root body, without the bodies that its joints move."""
        return self._bounds(name, self.bodies(name)[:1], i)

    def outline(self, body: int, i: int = 0) -> shapely.Geometry | None:
        """Return the rectangle around a body's geoms in world i, aligned with its x axis, None without geoms."""
        points = self._points(self._states[i], [body])
        if not len(points):
            return None
        heading = self._heading(body, i)
        local = points[:, :2] @ _turn(heading)
        return _moved(_box(local.min(0), local.max(0)), np.zeros(2), heading)

    def boxes_from_the_front(self, body: int, i: int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the low and high corners in x and z [m] of a body's geoms in world i."""
        parts = [self._points_of(self._states[i], g)[:, [0, 2]] for g in self._geoms([body])]
        return [(p.min(0), p.max(0)) for p in parts]

    def owner(self, name: str) -> str | None:
        """Return the object below an object, 'floor' on the floor, or None in the air."""
        support = self.config.parts[name].support
        return None if support is None else support.parent.split("/")[0]

    @cached_property
    def extent(self) -> float:
        """Width of all supports [m], or of all objects in a scene without supports. It scales the marks."""
        shapes = [s for name in self.names if self.is_placed(name) for s in self.supports(name)]
        shapes = shapes or [self.root_bounds(name, 0).shape for name in self.names]
        x0, y0, x1, y1 = shapely.union_all(shapes).bounds
        return max(x1 - x0, (y1 - y0) * 4 / 3)

    def bodies(self, name: str) -> list[int]:
        """Return all bodies of an object."""
        return self.compiled.scene.subtree(name)

    def moving_bodies(self, name: str) -> list[int]:
        """Return the bodies that sampled joints move, or only the hand of a robot."""
        joints = self.compiled.scene.joint_configs(name)
        if name in self.config.all_robots:
            return [b for b in self.bodies(name) if self.compiled.mjm.body(b).name.endswith("/hand")]
        return [int(self.compiled.mjm.jnt_bodyid[j]) for j in joints]

    def supports(self, name: str, i: int = 0) -> list[shapely.Geometry]:
        """Return the outlines of an object's support surfaces, or of its box in space, in world i."""
        plan = self._plan(name)
        if plan.ground is None:
            region = self.config.parts[name].region
            assert region is not None
            assert region.corners is not None
            return [MultiPoint([corner[:2] for corner in region.corners]).envelope]
        surfaces = {(s.height, s.outline.wkb): s for mine in plan.surfaces for s in mine}
        return [self._on_body(plan.ground, s.outline, i) for s in surfaces.values()]

    def region(self, name: str, i: int = 0) -> shapely.Geometry | None:
        """Return the region of an object in world i, or None if the region depends on the object's orientation."""
        plan, config = self._plan(name), self.config.parts[name]
        if plan.ground is None:
            return shapely.union_all(self.supports(name, i))
        if plan.erosion > 0.0 or any(mine is not plan.surfaces[0] for mine in plan.surfaces):
            return None
        region = shapely.union_all([self._on_body(plan.ground, s.region, i) for s in plan.surfaces[0]])
        for relation in config.relations:
            if relation.by_bounds or isinstance(relation, Joined):
                return None
            region = region.intersection(self._relation(name, relation, plan.ground, i))
        return region

    def _relation(self, name: str, relation: Relation, ground: int, i: int) -> shapely.Geometry:
        """Return the region of a relation in world i: everywhere if its frame or too many anchors are absent."""
        anchors = [self.bounds(a, i).standing for a in relation.anchors if self.is_present(a, i)]
        turned_by = [other for key, other in relation.references if key == "frame"]
        if len(anchors) < relation.least_anchors or not all(self.is_present(other, i) for other in turned_by):
            return box(-_FAR, -_FAR, _FAR, _FAR)
        frame = relation.reference_frame
        turned = {"world": 0.0, "support": self._heading(ground, i)}
        heading = turned[frame] if frame in turned else self.bounds(frame, i).heading
        own, robots = self.bounds(name, i).standing, self.config.all_robots
        return area_of(relation, own, anchors, relation.heading(robots) + heading, robots)

    def _plan(self, name: str) -> PlacedObject:
        return next(o for o in self.compiled.plan.objects if o.name == name)

    def _on_body(self, body: int, shape: shapely.Geometry, i: int) -> shapely.Geometry:
        return _moved(shape, self._states[i].xpos[body], self._heading(body, i))

    def _heading(self, body: int, i: int) -> float:
        xmat = self._states[i].xmat[body]
        return math.atan2(xmat[3], xmat[0])

    def _bounds(self, name: str, bodies: list[int], i: int) -> Bounds:
        data, root = self._states[i], self.bodies(name)[0]
        heading = heading_of(data.xmat[root].reshape(3, 3))
        turn = _turn(heading)
        still, now = self._points(self._with_joints_at_home[i], bodies), self._points(data, bodies)
        if not len(now):
            return Bounds(data.xpos[root].copy(), heading, np.zeros(2), np.zeros(2))
        local = still[:, :2] @ turn
        middle = data.xpos[root, :2] @ turn if name in self.config.all_robots else 0.5 * (local.min(0) + local.max(0))
        local = now[:, :2] @ turn - middle
        return Bounds(np.array([*turn @ middle, now[:, 2].min()]), heading, local.min(0), local.max(0))

    def _points(self, data: mujoco.MjData, bodies: Container[int]) -> np.ndarray:
        """Return the corners of the collision geoms of bodies [m], shape (n, 3)."""
        return np.concatenate([np.zeros((0, 3)), *(self._points_of(data, g) for g in self._geoms(bodies))])

    def _points_of(self, data: mujoco.MjData, geom: int) -> np.ndarray:
        return self._corners[geom] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]

    @cached_property
    def _corners(self) -> dict[int, np.ndarray]:
        """Geom -> its corners in its frame: the vertices of a mesh, or the corners of the box of another geom."""
        mjm = self.compiled.mjm
        found = {}
        for g in self._geoms(range(1, mjm.nbody)):
            mesh = mjm.geom_dataid[g]
            if mjm.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH:
                first = mjm.mesh_vertadr[mesh]
                found[g] = mjm.mesh_vert[first : first + mjm.mesh_vertnum[mesh]].astype(float)
            else:
                found[g] = mjm.geom_aabb[g, :3] + mjm.geom_aabb[g, 3:] * _UNIT_BOX
        return found

    def _geoms(self, bodies: Container[int]) -> list[int]:
        mjm = self.compiled.mjm
        solid = np.flatnonzero(mjm.geom_contype | mjm.geom_conaffinity)
        return [int(g) for g in solid if mjm.geom_bodyid[g] in bodies]

    def _posed(self, qpos: np.ndarray, mocap_pos: np.ndarray, mocap_quat: np.ndarray) -> mujoco.MjData:
        data = mujoco.MjData(self.compiled.mjm)
        data.qpos[:] = qpos
        if self.compiled.mjm.nmocap:
            data.mocap_pos[:], data.mocap_quat[:] = mocap_pos, mocap_quat
        mujoco.mj_kinematics(self.compiled.mjm, data)
        return data


def _box(low: np.ndarray, high: np.ndarray) -> Polygon:
    return box(float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _turn(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _moved(shape: shapely.Geometry, at: np.ndarray, heading: float) -> shapely.Geometry:
    """Transform a shape from a frame at `at` [m], rotated by `heading` [rad], to the world frame."""
    turned = affinity.rotate(shape, heading, origin=(0.0, 0.0), use_radians=True)
    return affinity.translate(turned, float(at[0]), float(at[1]))
