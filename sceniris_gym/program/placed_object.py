"""`PlacedObject`: one step of the placement program. The module also finds obstacles, and surfaces of supports.

A surface is a level face of a support, cropped to the region of an object.
"""

from dataclasses import dataclass, field

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.member_names import without_support
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry import supports
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces
from sceniris_gym.geometry.resting_poses import StablePose
from sceniris_gym.geometry.supports import COS_MAX_TILT, SupportSurface
from sceniris_gym.program.device import Cover, ObjectKind
from sceniris_gym.reach.arm import chain_up
from sceniris_gym.scene.couplings import Coupling
from sceniris_gym.scene.heaps import HeapPoses
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import Support, static_supports

_COVERS = {"in": Cover.EITHER, "on": Cover.OPEN, "inside": Cover.COVERED}


@dataclass(frozen=True)
class JointRange:
    """The draw of a joint position [m or rad]: uniform in [low, high], or one of `choice` if `choice` is not empty.

    `qposadr` is the joint's address in qpos. `norm` is the joint's home and the norm of the vector by which joints with
    `noise_norm` differ from home, clipped to [low, high].
    """

    qposadr: int
    low: float
    high: float
    choice: tuple[float, ...] = ()
    norm: tuple[float, float] | None = None

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """The intervals that contain all drawn positions. Each value of `choice` is an interval of zero length."""
        return [(value, value) for value in self.choice] or [(self.low, self.high)]


@dataclass(frozen=True)
class PlacedObject:
    """One step of the placement program: an object, or a robot whose base or joints are drawn.

    Attributes:
        name: The object's name, or the robot's.
        stream: Number of its random stream, which depends on its position in the scene file.
        kind: FREE, FIXTURE or MARKER. STATIC if only joint positions are drawn, and not the pose.
        bodies: Its bodies, the root first, parents before children.
        config: Its settings in the scene file. A robot with a fixed base has the settings of a static object.
        joint_ranges: The draws of its joints.
        followers: Couplings of joints that follow drawn joints, drivers before their followers.
        footprint: With `ratio_on_support: 1`, the hull of all its pieces, which must lie wholly on the support. None
            for another ratio, a single piece, or drawn joints. Each piece is then a footprint.
        stable_poses: The poses that its orientation is drawn from, empty for STATIC.
        support: The support that carries it. None if its region is in space, or for STATIC.
        tilts: Whether draws may tilt the support.
        surfaces: For each stable pose, the surfaces that can carry it, with their regions. Without a support, these are
            the points of its 3D region or, if it has relations, the 3D box seen from above. Poses with equal lists
            share one list.
        erosion: Least distance of its pivot from the outlines of surfaces, divided by the shorter edge of its bounds.
            0 if no draw changes that edge in a stable pose. The regions are then already shrunk by this distance.
        heap: Its settled poses in a heap, or None.
    """

    name: str
    stream: int
    kind: ObjectKind
    bodies: list[int]
    config: ObjectConfig
    joint_ranges: list[JointRange] = field(default_factory=list)
    followers: tuple[Coupling, ...] = ()
    footprint: Piece | None = None
    stable_poses: list[StablePose] = field(default_factory=list)
    support: Support | None = None
    tilts: bool = False
    surfaces: list[list[SupportSurface]] = field(default_factory=list)
    erosion: float = 0.0
    heap: HeapPoses | None = None

    @property
    def spans(self) -> dict[int, tuple[float, float]]:
        """The least and greatest position [m or rad] of each drawn joint and follower, by address in qpos."""
        parts = {d.qposadr: d.intervals for d in self.joint_ranges}
        for c in self.followers:
            parts[c.adr] = [c.over(*part) for part in parts[c.driver_adr]]
        return {adr: (float(np.min(ends)), float(np.max(ends))) for adr, ends in parts.items()}

    @property
    def ground(self) -> int | None:
        """The body that carries the object. None for a 3D region, which has no support, or if the kind is STATIC."""
        return None if self.support is None else self.support.body

    @property
    def corners(self) -> np.ndarray:
        """The corners [m] of the rectangles around its regions, in the frame of the body `ground`, shape (n, 3)."""
        boxes = [(s.region.bounds, s.height) for surfaces in self.surfaces for s in surfaces]
        return np.array([[x, y, z] for ends, z in boxes for x in ends[::2] for y in ends[1::2]])

    @property
    def orientation(self) -> str:
        """Kind of its drawn orientation, such as "yaw" or "stable". For a robot with a fixed base, it is "yaw"."""
        return self.config.drawn_orientation.kind

    @property
    def cover(self) -> Cover:
        """The rule for obstacles above its drawn point.

        `on` forbids obstacles above the point only if the support belongs to an object. Above a support of the model,
        such as a room with a ceiling, they are accepted.
        """
        if self.support is None or self.support.is_floor:
            return Cover.EITHER
        assert self.config.support is not None
        cover = _COVERS[self.config.support.word]
        return Cover.EITHER if cover == Cover.OPEN and self.support.owner is None else cover


COS_MAX_TILT_32 = 0.9999985
"""`COS_MAX_TILT` in single precision, for the poses of supports in a world."""


def keys_of_bodies(scene: SceneModel) -> dict[int, str]:
    """Return id of a body -> the scene file and the key of the body's asset, object or robot, for error messages."""
    config = scene.config
    where = dict.fromkeys(range(scene.mjm.nbody), config.where)
    for body, name in scene.owners.items():
        robot = config.all_robots.get(name)
        asset = ".asset" if robot is None and config.objects[name].asset is not None else ""
        where[body] = f"{config.where}: {config.key(name) if robot is None else robot.key}{asset}"
    return where


def obstacles(scene: SceneModel) -> list[Piece]:
    """Return all pieces of a scene, sorted by body, planes before solid pieces.

    Raises:
        MeshError: A geom cannot be an obstacle. The error names the key of the geom's asset.
    """
    pieces = extract_pieces(scene.mjm, scene.config.geometry, where=keys_of_bodies(scene))
    return sorted(pieces, key=lambda p: (p.body, p.type != PieceType.PLANE, p.contact_class, p.geom))


def surfaces_of(
    scene: SceneModel, o: PlacedObject, pieces: list[Piece], edges: list[float]
) -> list[list[SupportSurface]]:
    """Return the possible supporting surfaces of an object, a list for each of its stable poses.

    Args:
        scene: The scene.
        o: The object, or a robot whose base is drawn, without its surfaces.
        pieces: All obstacles.
        edges: For each stable pose, the least length [m] of the shorter edge of the object's bounds. Regions are shrunk
            by `ratio_on_support` times half of this length.

    Raises:
        SceneKeyError: The support has no level surface, or no area is left after shrinking and cropping to the region.
    """
    config, support = o.config, o.support
    if config.support is None or support is None:
        assert config.region is not None
        if config.region.points is not None:
            return [supports.points_in_space(config.region.points)] * len(edges)
        assert config.region.box is not None
        return [[supports.rectangle(*config.region.box)] if config.relations else []] * len(edges)
    word, parent = config.support.word, config.support.parent
    where = f"{scene.config.where}: {scene.config.key(o.name)}.{word}"
    if support.is_floor:
        assert scene.config.floor is not None
        half = 0.5 * np.array(scene.config.floor.size)
        found = [supports.rectangle(-half, half)]
    else:
        found = _level_surfaces(support, pieces, open_above=word == "on")
    if not found:
        raise SceneKeyError(
            f"{where}: '{parent}' has no level surface of 2 cm or more in width"
            f"{' with nothing above it' if word == 'on' else ''}. Valid: {_others(scene, o.name, pieces, word)}."
        )
    half = 0.5 * config.ratio_on_support
    return supports.crop(found, config.region, [half * edge for edge in edges], f"{where}: '{parent}'")


def may_lean(scene: SceneModel, support: Support) -> bool:
    """Return whether draws may tilt a support that belongs to an object or robot.

    Draws may tilt it if its owner has the orientation `stable` or `any`, or if a drawn hinge between the owner's root
    and the support has an axis that is not vertical.
    """
    if support.owner is None:
        return False
    owner = scene.config.parts.get(support.owner)
    if owner is not None and owner.drawn_orientation.kind in ("stable", "any"):
        return True
    mjm, chain = scene.mjm, chain_up(scene.mjm, support.body, scene.bodies[support.owner])
    joints = list(scene.moving_joints(support.owner))
    tilts = np.isin(mjm.jnt_bodyid[joints], chain) & (mjm.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE)
    return bool((tilts & (np.abs(mjm.jnt_axis[joints, 2]) < COS_MAX_TILT)).any())


def _level_surfaces(support: Support, pieces: list[Piece], *, open_above: bool) -> list[SupportSurface]:
    """Return the level surfaces of a support. If an object owns it, `open_above` leaves out covered areas."""
    own = [p for p in pieces if p.body == support.body]
    covered = open_above and support.owner is not None
    return supports.level_surfaces(support.body, own, open_above=covered, geom=support.geom)


def _others(scene: SceneModel, own: str, pieces: list[Piece], word: str) -> str:
    """Return, for a message, the name of each support with a level surface, except the parts of object `own`."""
    known = {name: Support(scene.bodies[name], name) for name in scene.config.objects}
    for name in scene.config.objects:
        known |= {f"{name}/{part}": Support(body, name) for part, body in scene.parts(name).items()}
    if scene.config.model is not None:
        known = {**known, **static_supports(scene.mjm, scene.bodies), **known}
    if scene.config.floor is not None:
        known.pop(FLOOR, None)  # a geom of the same name
    found: dict[frozenset[int], str] = {}  # by their geoms. Names of objects come before names of the model.
    for name, s in known.items():
        level = s.owner != own and scene.home.xmat[s.body][8] >= COS_MAX_TILT
        if level and _level_surfaces(s, pieces, open_above=word == "on"):
            geoms = frozenset(p.geom for p in pieces if p.body == s.body and s.geom in (None, p.geom))
            found.setdefault(geoms, name)
    floor = [] if scene.config.floor is None or word == "inside" else [FLOOR]
    names = sorted({*map(without_support, found.values())})
    return ", ".join([*floor, *names]) or "none, as no other part of this scene has one"
