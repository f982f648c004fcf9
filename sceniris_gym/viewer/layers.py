"""The layers of the viewer: drawings over the first world that users can show and hide."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np
import trimesh
from shapely.geometry import Point

from sceniris_gym.config.relations import Sector
from sceniris_gym.errors import ScenirisError
from sceniris_gym.geometry.pieces import PieceType, extract_pieces
from sceniris_gym.geometry.supports import polygons_of
from sceniris_gym.pictures.reach_picture import reached_share
from sceniris_gym.program.reach import load_map, robot_arm
from sceniris_gym.reach.map import ReachMap
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.viewer.regions import relation_area, sketch_regions
from sceniris_gym.viewer.shown import ShownWorld, sketch_grasps
from sceniris_gym.viewer.sketch import GREEN, GREY, PALETTE, RED, Sketch

_MOST = 2.0  # m, half the edge of the square that is drawn for an endless plane
_LIFT = 0.004  # m from the object's pivot up to the area of the first relation, and from each area to the next
_OVER = 0.02  # m, height of the ends of arrows above an object
_LINE = 0.06  # m, distance between the labels of an object's relations
_BEYOND = 0.15  # m, an endless area is drawn up to this distance behind the object
_LOOKED = 0.3  # m, greatest distance of a neighbour that is drawn
_ROUNDING = 1.0e-6  # m, tolerance of distances
_ABOVE = 0.06  # m, height of a label above its line
# a slice of the reach map
_PIXELS = 96
_DIRECTIONS = 48
_FULL = np.array([38.0, 110.0, 190.0])
_OPACITY = 170.0  # of 255, at points that every direction reaches


def sketch_pieces(world: ShownWorld, opacity: float = 1.0) -> Sketch:
    """Draw the collision geometry of all visible bodies, with the convex hulls of meshes. Planes are grey."""
    sketch, data = Sketch(), world.data
    hidden = set(world.hidden_bodies())
    pieces = [p for p in extract_pieces(world.compiled.mjm, "physics") if p.body not in hidden]
    for piece in pieces:
        if piece.type == PieceType.PLANE:
            x, y = np.where(piece.size[:2] > 0.0, piece.size[:2], _MOST)
            corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
            rotation, at = data.geom_xmat[piece.geom].reshape(3, 3), data.geom_xpos[piece.geom]
            sketch.surfaces.append((corners @ rotation.T + at, np.array([[0, 1, 2], [0, 2, 3]]), GREY, 0.4 * opacity))
    for number, body in enumerate(sorted({p.body for p in pieces})):
        if meshes := [p.mesh for p in pieces if p.body == body and p.mesh is not None and p.type != PieceType.PLANE]:
            vertices, faces = trimesh.util.append_faces([m.vertices for m in meshes], [m.faces for m in meshes])
            sketch.surfaces.append((world.from_body(body, vertices), faces, PALETTE[number % len(PALETTE)], opacity))
    return sketch


def sketch_relations(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw the relations of all objects, or of the object `only`: an arrow from each anchor, and the allowed area."""
    sketch = Sketch()
    number = 0
    for name in [only] if only is not None else world.placed_names:
        for i, relation in enumerate(world.compiled.config.parts[name].relations):
            area = relation_area(world, name, relation)
            if area is None:
                continue
            colour = PALETTE[number % len(PALETTE)]
            number += 1
            at = world.standing(name)[0][:3]
            anchors = [anchor for anchor in relation.anchors if world.is_shown(anchor)]
            height = float(at[2]) + number * _LIFT
            if isinstance(relation, Sector) and relation.high == math.inf:
                apex = Point(*world.standing(anchors[0])[0][:2])
                area = area.intersection(apex.buffer(apex.distance(Point(*at[:2])) + _BEYOND))
            sketch.area(polygons_of(area), height, colour, 0.3)
            tip = _above(world, name)
            sketch.arrows += [(np.stack([_tail(world, anchor, tip), tip]), colour) for anchor in anchors]
            sketch.labels.append((f"{name}: {relation.summary}", tip + [0.0, 0.0, _LINE * (i + 1)]))
    return sketch


def _above(world: ShownWorld, name: str) -> np.ndarray:
    """Return the point [m] where an object's arrows start or end, shape (3,): above its pivot and its highest part."""
    at = world.standing(name)[0]
    return np.array([at[0], at[1], max(at[2], world.box(name)[1][2]) + _OVER])


def _tail(world: ShownWorld, anchor: str, tip: np.ndarray) -> np.ndarray:
    """Return the start [m] of an arrow from an anchor to `tip`, shape (3,).

    The start is above the anchor. But if the anchor is higher than `tip`, and `tip` is beside the anchor, the start is
    at the side of the anchor.
    """
    low, high = world.box(anchor, root_alone=True)
    tail = _above(world, anchor)
    if tip[2] >= high[2] or np.all((low[:2] <= tip[:2]) & (tip[:2] <= high[:2])):
        return tail
    tail[2] = max(tip[2], low[2])
    far = (tip - tail)[:2]
    ends = np.where(far > 0.0, high[:2], low[:2]) - tail[:2]
    share = np.divide(ends, far, out=np.ones(2), where=far != 0.0).min()
    return tail + np.clip(share, 0.0, 1.0) * (tip - tail)


def sketch_clearances(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw a line from each placed object to its nearest neighbour. A line is red if it is shorter than the clearance.

    If `only` is given, draw only the line of this object.
    """
    sketch, drawn, config = Sketch(), set(), world.compiled.config
    clearances = {name: part.clearance for name, part in {**config.objects, **config.all_robots}.items()}
    for name in [only] if only is not None else world.placed_names:
        nearest = nearest_to(world, name)
        if nearest is None or (nearest.other, name) in drawn:
            continue
        drawn.add((name, nearest.other))
        asked = max(clearances.get(part, 0.0) for part in (name, nearest.other))
        sketch.lines.append((nearest.ends, GREEN if nearest.distance >= asked - _ROUNDING else RED))
        text = f"{name} to {nearest.other}: {1e3 * nearest.distance:.0f} mm, at least {1e3 * asked:g}"
        sketch.labels.append((text, nearest.ends.mean(axis=0) + [0.0, 0.0, _ABOVE]))
    return sketch


class Nearest(NamedTuple):
    """The nearest neighbour of an object.

    Attributes:
        other: Name of the neighbour: an object, a static geom, or a body.
        ends: Ends of the shortest line from the object to the neighbour, (2, 3) [m].
        distance: Length of this line [m], negative if the object and the neighbour overlap.
    """

    other: str
    ends: np.ndarray
    distance: float


def nearest_to(world: ShownWorld, name: str) -> Nearest | None:
    """Return the nearest neighbour with collision geometry of an object, or None if all are farther than 0.3 m.

    The object's support, the objects on it, and the objects of its heap are left out, because `clearance` does not
    apply to them.
    """
    mjm, data, scene = world.compiled.mjm, world.data, world.compiled.scene
    own = set(scene.subtree(name))
    heaped = {other for heap in world.compiled.config.heaps.values() if name in heap.of for other in heap.of}
    aside = {*own, world.placed(name).ground, *world.hidden_bodies()}
    aside |= {body for body, other in scene.owners.items() if other in heaped}
    collides = np.flatnonzero((mjm.geom_contype | mjm.geom_conaffinity) != 0).tolist()
    body_of, grounds = mjm.geom_bodyid.tolist(), {other: world.placed(other).ground for other in world.placed_names}
    best, found = _LOOKED, None
    for a in (g for g in collides if body_of[g] in own):
        for b in (g for g in collides if body_of[g] not in aside):
            if grounds.get(scene.owners.get(body_of[b], "")) == body_of[a]:
                continue
            ends = np.zeros(6)
            distance = mujoco.mj_geomDistance(mjm, data, a, b, best, ends)
            if distance < best:
                best, found = distance, Nearest(_owner(world, b), ends.reshape(2, 3), distance)
    return found


def _owner(world: ShownWorld, geom: int) -> str:
    """Return the name of the object that has a geom. For other geoms, return the name of the geom or of its body."""
    scene = world.compiled.scene
    body = int(scene.mjm.geom_bodyid[geom])
    own = scene.mjm.geom(geom).name if scene.mjm.body_weldid[body] == 0 else ""
    return scene.owners.get(body) or own or (scene.mjm.body(body).name if body else "static geometry")


def sketch_names(world: ShownWorld, only: str | None = None) -> Sketch:
    """Write the name of each object above the object. If `only` is given, write only this name."""
    sketch = Sketch()
    for name in world.compiled.object_names:
        if world.is_shown(name) and only in (None, name):
            low, high = world.box(name)
            sketch.labels.append((name, np.array([*(low + high)[:2] / 2.0, high[2] + 0.01])))
    return sketch


class ReachSlice(NamedTuple):
    """A horizontal slice of an arm's reach map.

    Attributes:
        map: The arm's map.
        body: Id of the base body of the arm.
    """

    map: ReachMap
    body: int

    @classmethod
    def of(cls, scene: SceneModel) -> list[ReachSlice]:
        """Return a slice for each robot that has a map."""
        found = []
        for name, robot in scene.config.all_robots.items():
            with contextlib.suppress(ScenirisError):
                reach_map = load_map(robot_arm(scene, name), robot, scene.config.where)
                if reach_map is not None:
                    found.append(cls(reach_map, scene.bodies[name]))
        return found

    @property
    def span(self) -> float:
        """Half the edge of the square that the slice covers [m]."""
        return -self.map.u_low

    def picture(self, data: mujoco.MjData, height: float) -> np.ndarray:
        """Return an RGBA picture of the slice at a height [m] in the world, (n, n, 4) uint8.

        A pixel is more opaque if the arm reaches the point in more approach directions. The picture shows a square with
        edges of `2 * span` [m] around the axis of the arm's first joint. In the picture, the x axis of the arm's base
        points right, and the y axis points up.
        """
        ticks = (np.arange(_PIXELS) + 0.5) / _PIXELS * 2.0 * self.span - self.span
        across, up = np.meshgrid(ticks, ticks[::-1])
        points = np.stack([across, up, np.full_like(across, height - data.xpos[self.body, 2])], axis=-1)
        share = reached_share(self.map, points + [*self.map.arm.axis_xy, 0.0], _DIRECTIONS, "cpu")
        picture = np.empty((_PIXELS, _PIXELS, 4), np.uint8)
        picture[..., :3] = _FULL
        picture[..., 3] = np.round(_OPACITY * share)
        return picture

    def pose(self, data: mujoco.MjData, height: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the position of the slice's middle in the world [m], and the orientation of the slice (wxyz)."""
        axis = data.xmat[self.body].reshape(3, 3) @ [*self.map.arm.axis_xy, 0.0]
        return np.array([*(data.xpos[self.body] + axis)[:2], height]), data.xquat[self.body]


PARKED, REACH = "parked objects", "reach map"
SEEN, COLLIDED, BOTH = "what is seen", "what collides", "both"
"""The choices of geometry to draw. Collision geometry is only drawn in the first world."""
LAYERS: dict[str, tuple[Callable[[ShownWorld, str | None], Sketch] | None, str]] = {
    "names": (sketch_names, "The name of every object."),
    "regions": (sketch_regions, "Where the pivot of each object may be, given the joints of this world."),
    "relations": (sketch_relations, "An arrow from each anchor, and the area in which the relation holds."),
    "clearances": (sketch_clearances, "The distance to each nearest object, and the least distance. Red: too near."),
    "grasps": (sketch_grasps, "The grasp for which each reachable object was accepted. Blue is the approach axis."),
    PARKED: (None, "Objects that their group left out, in a row in front of the scene."),
    REACH: (None, "A slice of the arm's reach map, at the height that the slider sets."),
}
"""Name of a layer -> its function, and its hint. The function takes a world, and one object or None for all objects.

A layer has no function if it moves bodies or is a picture.
"""
