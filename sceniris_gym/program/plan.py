"""The placement program on the host: the order of placing, and the places and poses of each object.

The result is plain NumPy. `pack/` flattens it into the fields of `device.Program`.
"""

import graphlib
import heapq
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sceniris_gym.config.objects import JointConfig, ObjectConfig
from sceniris_gym.config.relations import Relation
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import Piece, PieceType
from sceniris_gym.geometry.resting_poses import HomeShape, StablePose, heading_of, of_heading_zero
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.placed_object import JointRange, PlacedObject, may_lean, obstacles, surfaces_of
from sceniris_gym.program.reach import Reaching, plan_reaching
from sceniris_gym.program.resting import stable_poses
from sceniris_gym.program.standing import Stance, stances
from sceniris_gym.progress import tell
from sceniris_gym.scene.couplings import driven_by, free_range
from sceniris_gym.scene.heaps import HeapPoses, heap_poses
from sceniris_gym.scene.model import SceneModel


@dataclass(frozen=True, eq=False)
class Plan:
    """The placement program on the host.

    Attributes:
        scene: The scene.
        objects: Its objects in placement order.
        pieces: All obstacles, sorted by body, planes before solid pieces.
        slots: Name of each slot: all objects in the order of the scene file, then the robots.
        columns: Name of each column of the two arrays below: the slots, then one more column for each object with
            variants. In a world, this column has the values of the present variant.
        pivot_pose: For each column, the pivot [m] (for a robot, the base) and heading [rad] in the start pose, shape
            (ncolumn, 4).
        bounds: For each column, the bounds [m] in the start pose relative to the pivot, along the axes of the heading:
            low x, low y, high x, high y, shape (ncolumn, 4).
    """

    scene: SceneModel
    objects: list[PlacedObject]
    pieces: list[Piece]
    slots: tuple[str, ...]
    columns: tuple[str, ...]
    pivot_pose: np.ndarray
    bounds: np.ndarray

    @cached_property
    def reaching(self) -> Reaching:
        """The arms of the scene and their reach targets, planned on first access by `plan_reaching`."""
        return plan_reaching(self.scene, self.objects, self.pieces)

    @cached_property
    def stances(self) -> list[Stance]:
        """The stance of each object, computed on first access."""
        return stances(self.scene, self.objects, self.pieces)

    @cached_property
    def root_bounds(self) -> dict[str, np.ndarray]:
        """Name -> bounds of the root of an upright fixture or static object with drawn joints, as in `bounds`.

        They enclose the root and all bodies that joints never move. Objects without such pieces are left out.
        """
        found, scene, home, weld = {}, self.scene, self.scene.home, self.scene.mjm.body_weldid
        for name, part in scene.config.objects.items():
            bodies = scene.subtree(name)
            own = _solid(self.pieces, bodies)
            fixed = [p for p in own if weld[p.body] == weld[bodies[0]]]
            if fixed and part.is_open_furniture:
                mat = matrix(scene.mjm.body_quat[bodies[0]]) if part.is_placed else home.xmat[bodies[0]].reshape(3, 3)
                quat = of_heading_zero(mat)
                whole, root = (HomeShape(home, bodies[0], pieces).stable_pose(quat) for pieces in (own, fixed))
                found[name] = root.bounds + np.tile((matrix(quat) @ (root.pivot - whole.pivot))[:2], 2)
        return found

    def joined_bounds(self, name: str, relation: Relation) -> dict[str, np.ndarray]:
        """Return the `root_bounds` of those of an object and its anchor that a relation measures by the root."""
        names = self.scene.config.joined_by_root(name, relation)
        return {one: self.root_bounds[one] for one in names if one in self.root_bounds}

    @cached_property
    def solids(self) -> list[tuple[Piece, np.ndarray, np.ndarray]]:
        """All pieces except planes: the piece, and the lower and upper corner of its bounding box in the start pose.

        The corners [m] are in the world frame, shape (3,) each. The box is along the axes of the world.
        """
        found = []
        for p in (p for p in self.pieces if p.type != PieceType.PLANE):
            low, high = p.extents(self.scene.home.xmat[p.body].reshape(3, 3))
            found.append((p, low + self.scene.home.xpos[p.body], high + self.scene.home.xpos[p.body]))
        return found


def placement_order(scene: SceneModel) -> list[str]:
    """Return the names of objects and robots in placement order.

    First come objects and robots that stay at a fixed place and whose joints are drawn. Robots with a drawn base
    follow, then the other objects in the order of the scene file. An object always comes after the objects in its keys,
    such as its support.

    If a start places objects at markers, these objects and markers come before all other placed objects. An object at
    its marker cannot move out of the way, but objects that are placed later can avoid it.
    """
    config = scene.config
    names = (*config.all_robots, *config.objects)
    moving = [n for n in names if n in config.parts and config.parts[n].is_placed]
    at_markers = {name for start in config.start for pair in config.markers(start).items() for name in pair}
    moving.sort(key=lambda name: name not in at_markers)
    order = [n for n in names if n not in moving and scene.joint_configs(n)]
    number = {name: i for i, name in enumerate(moving)}
    sorter = graphlib.TopologicalSorter({n: [other for other in config.needs(n) if other in number] for n in moving})
    sorter.prepare()
    ready: list[int] = []  # a heap, so that objects keep the file's order where references permit
    while sorter.is_active():
        for name in sorter.get_ready():
            heapq.heappush(ready, number[name])
        order.append(moving[heapq.heappop(ready)])
        sorter.done(order[-1])
    return order


def slot_names(config: SceneConfig) -> tuple[str, ...]:
    """Return the name of each slot: all objects in the order of the scene file, then the robots."""
    return (*config.objects, *config.all_robots)


def build_plan(scene: SceneModel) -> Plan:
    """Return the placement program of a scene. The checks in `checks/` come afterwards.

    Raises:
        SceneKeyError: Objects refer to each other in a circle. A heap has no settled poses. A support has no level
            surface, or no area is left after shrinking and cropping to the region. An object has no stable pose.
        MeshError, NotSupportedError: A geom cannot be an obstacle.
    """
    pieces, heaps = obstacles(scene), heap_poses(scene)
    objects = []
    for name in (order := placement_order(scene)):
        objects.append(_placed_object(scene, name, pieces, heaps.get(name)))
        tell("placed objects", len(objects), len(order))
    slots = slot_names(scene.config)
    variants = scene.config.variants
    standing = [_standing(scene, name, pieces) for name in (*slots, *(of[0] for of in variants.values()))]
    pivot_pose, bounds = (np.reshape([stands[i] for stands in standing], (-1, 4)) for i in range(2))
    return Plan(scene, objects, pieces, slots, (*slots, *variants), pivot_pose, bounds)


def _standing(scene: SceneModel, name: str, pieces: list[Piece]) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of `Plan.pivot_pose` and `Plan.bounds` for an object or robot."""
    root, home = scene.bodies[name], scene.home
    shape = HomeShape(home, root, _solid(pieces, scene.subtree(name)))
    mat = home.xmat[root].reshape(3, 3)
    pose, heading = shape.stable_pose(of_heading_zero(mat)), heading_of(mat)
    if name in scene.config.all_robots:
        return np.array([*home.xpos[root], heading]), _around_base(pose).bounds
    return np.array([*home.xpos[root] + mat @ pose.pivot, heading]), pose.bounds


def _solid(pieces: list[Piece], bodies: list[int]) -> list[Piece]:
    """Return the pieces of some bodies. Planes are left out, because they have no bounds."""
    return [p for p in pieces if p.body in bodies and p.type != PieceType.PLANE]


def _around_base(pose: StablePose) -> StablePose:
    """Return a robot's pose with another pivot: the origin of the base, at the height of the robot's lowest point."""
    rotation = matrix(pose.quat)
    at = rotation @ pose.pivot
    return pose._replace(pivot=rotation.T @ np.array([0.0, 0.0, at[2]]), bounds=pose.bounds + np.tile(at[:2], 2))


def _placed_object(scene: SceneModel, name: str, pieces: list[Piece], heap: HeapPoses | None) -> PlacedObject:
    """Return an object or robot as a step of the program. The step draws a pose, joint positions, or both."""
    config, bodies = scene.config.parts.get(name), scene.subtree(name)
    if config is None:  # a robot whose base is not drawn
        config = ObjectConfig(kind="static", clearance=scene.config.all_robots[name].clearance)
    drawn = [joint_range(scene, joint, words) for joint, words in scene.joint_configs(name).items()]
    followers = tuple(driven_by(scene.couplings, scene.joint_configs(name)))
    where = f"{scene.config.where}: {scene.config.key(name)}"
    if len({d.norm[1] for d in drawn if d.norm}) > 1:
        raise SceneKeyError(f"{where}.joints: all joints with 'noise_norm' form one vector. Give all the same value.")
    # random streams: the first robot has 0, then come the objects, then the other robots
    first, *robots = scene.config.all_robots or [None]
    stream = 0 if name == first else 1 + [*scene.config.objects, *robots].index(name)
    step = PlacedObject(name, stream, ObjectKind.STATIC, bodies, config, drawn, followers)
    if not config.is_placed:
        return step
    own, home = _solid(pieces, bodies), scene.home
    shape = HomeShape(home, bodies[0], own)
    poses = [(of_heading_zero(matrix(scene.mjm.body_quat[bodies[0]])), 1.0)]
    step = replace(step, kind=ObjectKind[config.kind.upper()])
    if heap is not None:
        resting = [shape.stable_pose(*pose) for pose in poses]
        return replace(step, stable_poses=resting, support=heap.support, surfaces=[[heap.surface]], heap=heap)
    word, orientation = config.support, config.drawn_orientation.kind
    support = None if word is None else scene.support(word.parent, f"{where}.{word.word}")
    step = replace(step, support=support, tilts=support is not None and may_lean(scene, support))
    if orientation == "stable":
        poses = stable_poses(scene, step, own)
    resting = [shape.stable_pose(*pose) for pose in poses]
    if name in scene.config.all_robots:
        resting = [_around_base(pose) for pose in resting]
    moves = any(d.choice or not d.low == d.high == home.qpos[d.qposadr] for d in drawn)
    varies = config.ratio_on_support > 0.0 and bool(own) and (moves or orientation == "any")
    rigid = HomeShape(home, bodies[0], [p for p in own if p.body == bodies[0]]) if varies else shape
    if orientation == "any":
        edges = [2.0 * rigid.inner_radius()]
    else:
        edges = [rigid.stable_pose(v.quat).short_edge for v in resting]
    return replace(
        step,
        footprint=shape.hull(bodies[0]) if len(own) > 1 and not drawn and config.ratio_on_support == 1.0 else None,
        stable_poses=resting,
        surfaces=surfaces_of(scene, step, pieces, edges),
        erosion=0.5 * config.ratio_on_support if varies else 0.0,
    )


def joint_range(scene: SceneModel, joint: int, words: JointConfig) -> JointRange:
    """Return the range from which a joint position is drawn, from the joint's keys in the scene file."""
    mjm = scene.mjm
    adr = int(mjm.jnt_qposadr[joint])
    if words.choice is not None:
        return JointRange(adr, 0.0, 0.0, tuple(words.choice))
    if words.range is not None:
        return JointRange(adr, *words.range)
    if words.value is not None:
        return JointRange(adr, words.value, words.value)
    if words.most_noise is not None:
        start, most = scene.home_qpos[adr], words.most_noise
        low, high = free_range(mjm, scene.couplings, joint, scene.home_qpos)
        norm = None if words.noise_norm is None else (start, most)
        return JointRange(adr, max(start - most, low), min(start + most, high), norm=norm)
    low, high = mjm.jnt_range[joint]
    return JointRange(adr, *(low + np.array(words.fraction) * (high - low)))
