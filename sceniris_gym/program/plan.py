"""The placement program on the host: which objects are placed in which order, where, and in which poses.

The result is plain numpy; `pack.py` flattens it into the fields of `device.Program`.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.objects import JointConfig, ObjectConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import CycleError, NoSupportError, NotSupportedError, SceneKeyError
from sceniris_gym.geometry import supports
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces
from sceniris_gym.geometry.resting_poses import HomeShape, Variant, heading_of, of_heading_zero
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.geometry.supports import SupportSurface
from sceniris_gym.program.checks.constraints import check_constraints
from sceniris_gym.program.checks.tendon_limits import check_tendon_limits
from sceniris_gym.program.couplings import Follower, followers_of
from sceniris_gym.program.device import Cover, ObjectKind
from sceniris_gym.program.heap_poses import HeapPoses, heap_poses
from sceniris_gym.program.resting import stable_poses
from sceniris_gym.scene.couplings import free_range
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import Support, static_supports

_KINDS = {"free": ObjectKind.FREE, "fixture": ObjectKind.FIXTURE, "marker": ObjectKind.MARKER}
_COVER = {"in": Cover.EITHER, "on": Cover.OPEN, "inside": Cover.COVERED}
UPRIGHT = float(np.cos(np.radians(0.1)))
"""Least z component of a support's z axis: 0.1 degree is 0.1 mm under an object of 8 cm, a fifth of the default gap."""


@dataclass(frozen=True)
class JointRange:
    """How one joint position is drawn: uniform in [low, high], or one of `choice` if there are any [m or rad]."""

    qposadr: int
    low: float
    high: float
    choice: tuple[float, ...] = ()

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """The intervals that it is drawn from."""
        return [(value, value) for value in self.choice] or [(self.low, self.high)]


@dataclass(frozen=True)
class PlacedObject:
    """One step of the program.

    Attributes:
        name: The object's name, or the robot's.
        stream: Its random stream, from its place in the scene file.
        kind: How its pose is written; STATIC for what only draws joint positions.
        bodies: Its bodies, the root first, parents before children.
        joint_ranges: How its joints are drawn.
        footprint: What must lie on the support as a whole, with `ratio_on_support` 1: the hull of all pieces as one
            more piece; None for a single piece, or where joints are drawn, whose footprint is that of each piece.
        variants: Poses that its orientation is drawn from; empty for STATIC.
        support: What carries it; None in a box in space or for STATIC.
        tilts: Whether that body may lean in the states it is drawn in.
        surfaces: Surfaces and regions that it may stand on, a list for each variant; in space the points, or for
            relations the box seen from above. Variants with the same regions share one list.
        erosion: How far its pivot keeps from their outlines, in shares of the shorter edge of the drawn bounds, where
            that is not the same in all draws of a variant; else 0, as the regions are eroded already.
        config: Its entry in the scene file; None for a robot whose base is not drawn.
        followers: Joints that follow drawn ones, drivers before what follows them.
        heap: The settled poses that it is drawn from, for a thing of a heap.
    """

    name: str
    stream: int
    kind: ObjectKind
    bodies: list[int]
    joint_ranges: list[JointRange]
    footprint: Piece | None
    variants: list[Variant]
    support: Support | None
    tilts: bool
    surfaces: list[list[SupportSurface]]
    erosion: float
    config: ObjectConfig | None
    followers: tuple[Follower, ...] = ()
    heap: HeapPoses | None = None

    @property
    def ground(self) -> int | None:
        """Body that carries it; None in a box in space or for STATIC."""
        return None if self.support is None else self.support.body

    @property
    def cover(self) -> Cover:
        """What is required above the point that it is placed on.

        What never moves and is no object, such as the world with its walls and ceilings, is open wherever there is
        room.
        """
        if self.support is None or self.support.is_floor:
            return Cover.EITHER
        assert self.config is not None
        assert self.config.support is not None
        cover = _COVER[self.config.support.word]
        return Cover.EITHER if cover == Cover.OPEN and self.support.owner is None else cover


@dataclass(frozen=True)
class Plan:
    """The placement program on the host.

    Attributes:
        objects: In placement order.
        pieces: All obstacles, sorted by body, planes before solid pieces.
        slots: Names as relations and groups find them: all objects in the order of the scene file, then the robots.
        place: Where each of them is at home: pivot [m] (for a robot its base) and heading [rad], shape (nslot, 4).
        bounds: Their bounds around the pivot [m] in that heading: low x, low y, high x, high y, shape (nslot, 4).
        home: MjData at the start pose.
    """

    objects: list[PlacedObject]
    pieces: list[Piece]
    slots: tuple[str, ...]
    place: np.ndarray
    bounds: np.ndarray
    home: mujoco.MjData

    def extents(self, piece: Piece) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and the greatest extent [m] of a piece at home along the world's axes, shape (3,) each."""
        low, high = piece.extents(self.home.xmat[piece.body].reshape(3, 3))
        return low + self.home.xpos[piece.body], high + self.home.xpos[piece.body]


def placement_order(scene: SceneModel) -> list[str]:
    """Names in the order of placement: what only draws joints, robots, then objects as in the file; references first.

    Raises:
        CycleError: Objects that refer to each other.
    """
    config = scene.config
    moving = [n for n in (*config.all_robots, *config.objects) if n in config.parts and config.parts[n].is_placed]
    still = [n for n in (*config.all_robots, *config.objects) if n not in moving]
    order = [n for n in still if scene.joint_configs(n)]
    number = {name: i for i, name in enumerate(moving)}
    waits = {n: {other for other in config.needs(n) if other in number} for n in moving}
    followers: dict[str, list[str]] = {}
    for name, others in waits.items():
        for other in others:
            followers.setdefault(other, []).append(name)
    ready = [number[n] for n in moving if not waits[n]]  # in ascending order, so a heap
    pending = dict.fromkeys(moving)
    while ready:
        name = moving[heapq.heappop(ready)]
        order.append(name)
        del pending[name]
        for other in followers.get(name, ()):
            waits[other].remove(name)
            if not waits[other]:
                heapq.heappush(ready, number[other])
    if pending:
        raise CycleError(config.where, list(pending), "objects refer to each other")
    return order


def slot_names(config: SceneConfig) -> tuple[str, ...]:
    """Names as relations and groups find them: all objects in the order of the scene file, then the robots."""
    return (*config.objects, *config.all_robots)


def build_plan(scene: SceneModel) -> Plan:
    """Work out the placement program of a scene.

    Raises:
        NoSupportError: A support without any level surface.
        ErodedSupportError: Nothing is left of a support after its erosion and region.
        MeshError, NotSupportedError: A geom that cannot be an obstacle, a support that leans, or a constraint that
            layouts would break.
        SceneKeyError: Drawn joints that take one which follows them, or a fixed tendon, beyond its limits.
    """
    check_constraints(scene)
    home = mujoco.MjData(scene.mjm)
    home.qpos[:] = scene.home_qpos
    mujoco.mj_kinematics(scene.mjm, home)
    mujoco.mj_comPos(scene.mjm, home)
    pieces = sorted(_pieces(scene), key=lambda p: (p.body, p.type != PieceType.PLANE, p.contact_class, p.geom))
    heaps = heap_poses(scene)
    objects = [_placed_object(scene, name, pieces, home, heaps.get(name)) for name in placement_order(scene)]
    check_tendon_limits(scene, {d.qposadr: d.intervals for o in objects for d in o.joint_ranges})
    slots = slot_names(scene.config)
    standing = [_standing(scene, name, pieces, home) for name in slots]
    place = np.reshape([s[0] for s in standing], (-1, 4))
    bounds = np.reshape([s[1] for s in standing], (-1, 4))
    return Plan(objects, pieces, slots, place, bounds, home)


def _pieces(scene: SceneModel) -> list[Piece]:
    """All pieces; errors name the key of the asset that they come from."""
    where = dict.fromkeys(range(scene.mjm.nbody), scene.config.where)
    for name in scene.bodies:
        if name in scene.config.all_robots:
            key = scene.config.all_robots[name].key
        else:
            key = f"objects.{name}{'' if scene.config.objects[name].asset is None else '.asset'}"
        where |= dict.fromkeys(scene.subtree(name), f"{where[0]}: {key}")
    return extract_pieces(scene.mjm, scene.config.geometry, where=where)


def _standing(scene: SceneModel, name: str, pieces: list[Piece], home: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Where an object stands at home, as relations see it: (pivot, heading) and bounds."""
    root = scene.bodies[name]
    bodies = set(scene.subtree(name))
    shape = HomeShape(home, root, [p for p in pieces if p.body in bodies and p.type != PieceType.PLANE])
    mat = home.xmat[root].reshape(3, 3)
    variant, heading = shape.variant(of_heading_zero(mat)), heading_of(mat)
    if name in scene.config.all_robots:
        return np.array([*home.xpos[root], heading]), _around_base(variant).bounds
    return np.array([*home.xpos[root] + mat @ variant.pivot, heading]), variant.bounds


def _around_base(variant: Variant) -> Variant:
    """A pose of a robot, which is where its base is, wherever its arm reaches; it stands on its lowest point."""
    turn = matrix(variant.quat)
    at = turn @ variant.pivot
    return replace(variant, pivot=turn.T @ np.array([0.0, 0.0, at[2]]), bounds=variant.bounds + np.tile(at[:2], 2))


def _stream(config: SceneConfig, name: str) -> int:
    """The random stream of an object or a robot: 0 for the first robot, then the objects, then other robots."""
    robots = list(config.all_robots)
    return 0 if robots[:1] == [name] else 1 + [*config.objects, *robots[1:]].index(name)


def _placed_object(
    scene: SceneModel, name: str, pieces: list[Piece], home: mujoco.MjData, heap: HeapPoses | None
) -> PlacedObject:
    config = scene.config.parts.get(name)
    bodies = scene.subtree(name)
    quat = of_heading_zero(matrix(scene.mjm.body_quat[bodies[0]]))
    stream = _stream(scene.config, name)
    drawn = _joint_ranges(scene, name)
    intervals = {d.qposadr: d.intervals for d in drawn}
    followers = followers_of(scene, name, intervals)
    if config is None or not config.is_placed:
        return PlacedObject(
            name, stream, ObjectKind.STATIC, bodies, drawn, None, [], None, False, [], 0.0, config, followers
        )
    own = [p for p in pieces if p.body in bodies]
    if any(p.type == PieceType.PLANE for p in own):
        raise NotSupportedError(
            f"{scene.config.where}: {scene.config.key(name)}: a plane is endless and cannot be part of what is placed. "
            "Use a box."
        )
    shape = HomeShape(home, bodies[0], own)
    if heap is not None:
        placed, surfaces = (name, stream, ObjectKind.FREE, bodies, [], None), [[heap.surface]]
        return PlacedObject(*placed, [shape.variant(quat)], heap.support, False, surfaces, 0.0, config, heap=heap)
    poses = [(quat, 1.0)]
    if config.drawn_orientation.kind == "stable":
        poses = stable_poses(scene, name, own, home, intervals, followers)
    variants = [shape.variant(*pose) for pose in poses]
    if name in scene.config.all_robots:
        variants = [_around_base(variant) for variant in variants]
    moves = any(d.choice or not d.low == d.high == home.qpos[d.qposadr] for d in drawn)
    varies = config.ratio_on_support > 0.0 and bool(own) and (moves or config.drawn_orientation.kind == "any")
    rigid = HomeShape(home, bodies[0], [p for p in own if p.body == bodies[0]]) if varies else shape
    if config.drawn_orientation.kind == "any":
        edges = [2.0 * rigid.inner_radius()]
    else:
        edges = [rigid.variant(v.quat).short_edge for v in variants]
    support, surfaces = _surfaces(scene, name, config, pieces, home, edges)
    return PlacedObject(
        name=name,
        stream=stream,
        kind=_KINDS[config.kind],
        bodies=bodies,
        joint_ranges=drawn,
        footprint=shape.hull(bodies[0]) if len(own) > 1 and not drawn and config.ratio_on_support == 1.0 else None,
        variants=variants,
        support=support,
        tilts=support is not None and _tilts(scene, support),
        surfaces=surfaces,
        erosion=0.5 * config.ratio_on_support if varies else 0.0,
        config=config,
        followers=followers,
    )


def _joint_ranges(scene: SceneModel, name: str) -> list[JointRange]:
    return [_joint_range(scene, joint, words) for joint, words in scene.joint_configs(name).items()]


def _joint_range(scene: SceneModel, joint: int, words: JointConfig) -> JointRange:
    mjm = scene.mjm
    adr = int(mjm.jnt_qposadr[joint])
    low, high = mjm.jnt_range[joint] if mjm.jnt_limited[joint] else (-np.inf, np.inf)
    if words.choice is not None:
        return JointRange(adr, 0.0, 0.0, tuple(words.choice))
    if words.fraction is not None:
        a, b = words.fraction
        return JointRange(adr, low + a * (high - low), low + b * (high - low))
    if words.range is not None:
        return JointRange(adr, *words.range)
    if words.value is not None:
        return JointRange(adr, words.value, words.value)
    assert words.noise is not None
    start = scene.home_qpos[adr]
    low, high = free_range(mjm, scene.couplings, joint, scene.home_qpos)
    return JointRange(adr, max(start - words.noise, low), min(start + words.noise, high))


def _surfaces(
    scene: SceneModel, name: str, config: ObjectConfig, pieces: list[Piece], home: mujoco.MjData, edges: list[float]
) -> tuple[Support | None, list[list[SupportSurface]]]:
    """What carries an object, and for each variant the surfaces on it; `edges`: their least shorter edges."""
    if config.support is None:
        assert config.region is not None
        if config.region.points is not None:
            return None, [supports.points_in_space(config.region)] * len(edges)
        return None, [[supports.shadow_of_box(config.region)] if config.relations else []] * len(edges)
    word, parent = config.support.word, config.support.parent
    where = f"{scene.config.where}: {scene.config.key(name)}.{word}"
    support = scene.support(parent, where)
    if support.is_floor:
        assert scene.config.floor is not None
        if word == "inside":
            raise SceneKeyError(f"{where}: the floor has no roof. Write 'on: floor'.")
        found = [supports.floor_surface(scene.config.floor.size)]
    else:
        _check_upright(parent, home.xmat[support.body][8], where)
        found = _found(support, pieces, open_above=word == "on")
    if not found:
        raise NoSupportError(
            f"{where}: '{parent}' has no level surface of 2 cm or more in width"
            f"{' that is open above' if word == 'on' else ''}. Valid: {_with_surfaces(scene, pieces, home, word)}."
        )
    if any(s.is_endless for s in found) and (config.region is None or config.region.fraction is not None):
        raise SceneKeyError(
            f"{where}: the plane '{parent}' is endless. Say where on it objects are placed, as in "
            f"{scene.config.key(name)}.region: {{box: [[-0.3, -0.3], [0.3, 0.3]]}}."
        )
    half = 0.5 * config.ratio_on_support
    return support, supports.crop(found, config.region, [half * edge for edge in edges], where)


def _found(support: Support, pieces: list[Piece], *, open_above: bool) -> list[SupportSurface]:
    """The level surfaces of a support. What stands over what never moves is no roof of it: it is in the way or not."""
    own = [p for p in pieces if p.body == support.body]
    covered = open_above and support.owner is not None
    return supports.level_surfaces(support.body, own, open_above=covered, geom=support.geom)


def _with_surfaces(scene: SceneModel, pieces: list[Piece], home: mujoco.MjData, word: str) -> str:
    """The names of all that has a level surface, for messages."""
    names = {scene.bodies[name]: name for name in scene.config.objects}
    for name in scene.config.objects:
        names |= {body: f"{name}/{part}" for part, body in scene.parts(name).items()}
    known = {name: Support(body, name) for body, name in names.items()}
    if scene.config.model is not None:
        known = {**static_supports(scene.mjm, scene.bodies), **known}
    level = {n: s for n, s in known.items() if home.xmat[s.body][8] >= UPRIGHT}
    found = sorted(name for name, s in level.items() if _found(s, pieces, open_above=word == "on"))
    floor = [] if scene.config.floor is None or word == "inside" else [FLOOR]
    return ", ".join([*floor, *found]) or "none, as nothing in this scene has one"


def _check_upright(parent: str, up: float, where: str) -> None:
    """Surfaces are level in their body's frame, so that frame must stand upright at home."""
    if up < UPRIGHT:
        lean = np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))
        raise NotSupportedError(
            f"{where}: the z axis of '{parent}' leans by {lean:.3g} degrees at home, and things are placed on level "
            "surfaces only. Give the support a body whose z axis points up."
        )


def _tilts(scene: SceneModel, support: Support) -> bool:
    """Whether a support may lean: a joint above it turns about an axis that is not vertical, or its object may lie."""
    if support.owner is None:
        return False
    owner = scene.config.parts.get(support.owner)
    if owner is not None and owner.drawn_orientation.kind in ("stable", "any"):
        return True
    mjm, chain = scene.mjm, [support.body]
    while chain[-1] not in (0, scene.bodies[support.owner]):
        chain.append(int(mjm.body_parentid[chain[-1]]))
    drawn = scene.moving_joints(support.owner)
    return any(
        mjm.jnt_bodyid[j] in chain
        and mjm.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
        and abs(mjm.jnt_axis[j][2]) < UPRIGHT
        for j in drawn
    )
