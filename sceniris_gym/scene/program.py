"""A scene becomes a placement program: who is placed when, where, and what it must keep clear of.

The result is plain numpy, one entry per field of `device.Program`; `world.py` takes it to the device.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from sceniris_gym.errors import NoSupportError, NotSupportedError, SceneKeyError
from sceniris_gym.scene import supports
from sceniris_gym.scene.config import JointConfig, ObjectConfig, SceneConfig
from sceniris_gym.scene.device import ObjectKind, PieceType, Roof
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.pieces import Piece, extract_pieces
from sceniris_gym.scene.supports import Surface
from sceniris_gym.scene.values import FLOOR, ROBOT

_KINDS = {"free": ObjectKind.FREE, "fixture": ObjectKind.FIXTURE, "marker": ObjectKind.MARKER}
_ROOFS = {"in": Roof.EITHER, "on": Roof.OPEN, "inside": Roof.COVERED}
# A support may lean by 0.1 degree: that is 0.1 mm under an object of 8 cm, a fifth of the default gap.
_UPRIGHT = np.cos(np.radians(0.1))


@dataclass(frozen=True)
class Draw:
    """How one joint position is drawn: uniform in [low, high], or one of `choice` if there are any [m or rad]."""

    qposadr: int
    low: float
    high: float
    choice: tuple[float, ...] = ()


@dataclass(frozen=True)
class PlacedObject:
    """One step of the program.

    Attributes:
        name: The object's name ("robot" for the robot).
        stream: Its random stream, from its place in the scene file.
        kind: How its pose is written; STATIC for what only draws joint positions.
        bodies: Its bodies, the root first, parents before children.
        draws: What is drawn for its joints.
        quat: Orientation of its root at yaw 0, wxyz.
        pivot: Bottom centre of its bounds at home, in its root's frame [m].
        surfaces: Surfaces and regions that it may stand on; empty for a box in space or STATIC.
        config: Its words in the scene file; None for the robot.
    """

    name: str
    stream: int
    kind: ObjectKind
    bodies: list[int]
    draws: list[Draw]
    quat: np.ndarray
    pivot: np.ndarray
    surfaces: list[Surface]
    config: ObjectConfig | None


@dataclass(frozen=True)
class Plan:
    """The placement program on the host.

    Attributes:
        objects: In placement order.
        pieces: All obstacles, sorted by body, planes before what is solid.
        home: MjData at the start pose.
    """

    objects: list[PlacedObject]
    pieces: list[Piece]
    home: mujoco.MjData


def placement_order(scene: SceneModel) -> list[str]:
    """Names in the order of placement: what only draws joints, then parents before children, else as in the file."""
    config = scene.config
    moving = [n for n, part in config.objects.items() if _is_placed(part)]
    still = [ROBOT] if config.robot is not None else []
    still += [n for n in config.objects if n not in moving]
    order = [n for n in still if scene.joint_configs(n)]
    pending = list(moving)
    while pending:
        for name in pending:
            support = config.objects[name].support
            owner = support.parent.split("/")[0] if support is not None else FLOOR
            if owner not in pending:
                order.append(name)
                pending.remove(name)
                break
    return order


def build_plan(scene: SceneModel) -> Plan:
    """Work out the whole program.

    Raises:
        NoSupportError: a parent without any level surface.
        ErodedSupportError: nothing is left of a support after its erosion and region.
        MeshError, NotSupportedError: a geom that cannot be an obstacle, or a support that leans.
    """
    _check_words(scene.config)
    home = mujoco.MjData(scene.mjm)
    home.qpos[:] = scene.home_qpos
    mujoco.mj_kinematics(scene.mjm, home)
    pieces = sorted(
        extract_pieces(scene.mjm, scene.config.geometry), key=lambda p: (p.body, p.type != PieceType.PLANE, p.geom)
    )
    objects = [_placed_object(scene, name, pieces, home) for name in placement_order(scene)]
    return Plan(objects, pieces, home)


def collider_pairs(scene: SceneModel, plan: Plan, colliders: list[int]) -> list[list[tuple[int, int, float]]]:
    """For each object of the plan, which colliders to keep apart when it is placed, and the least gap [m].

    Args:
        scene: The scene.
        plan: Its plan.
        colliders: Body of each collider.

    Returns:
        Per object a list of (own collider, other collider, clearance).
    """
    mjm = scene.mjm
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in mjm.exclude_signature}
    ordered = {body for o in plan.objects for body in o.bodies}
    standing = {body: 0.0 for body in range(mjm.nbody) if body not in ordered}
    for name, part in scene.config.objects.items():
        for body in scene.subtree(name):
            if part.kind == "marker":
                standing.pop(body, None)
            elif body in standing:
                standing[body] = part.clearance
    touching = _touching_at_home(scene, plan)

    def may_meet(a: int, b: int) -> bool:
        fixed = mjm.body_weldid[a] == 0 and mjm.body_weldid[b] == 0 and not _is_mocap(mjm, a) and not _is_mocap(mjm, b)
        return not fixed and (min(a, b), max(a, b)) not in excluded

    result = []
    for o in plan.objects:
        clearance = o.config.clearance if o.config is not None else 0.0
        own = [c for c, body in enumerate(colliders) if body in o.bodies]
        others = [c for c, body in enumerate(colliders) if body in standing]
        pairs = []
        if o.config is None or o.config.kind != "marker":
            pairs = [
                (a, b, max(clearance, standing[colliders[b]]) if o.kind != ObjectKind.STATIC else 0.0)
                for a, b in product(own, others)
                if may_meet(colliders[a], colliders[b])
            ]
            if o.draws:
                pairs += [
                    (a, b, 0.0)
                    for a, b in product(own, own)
                    if a < b
                    and may_meet(colliders[a], colliders[b])
                    and not _are_neighbours(mjm, colliders[a], colliders[b])
                    and frozenset((colliders[a], colliders[b])) not in touching
                ]
            standing.update(dict.fromkeys(o.bodies, clearance))
        result.append(pairs)
    return result


def _check_words(config: SceneConfig) -> None:
    """Refuse the words that a program cannot say yet."""
    found = [f"objects.{name}.relations" for name, part in config.objects.items() if part.relations]
    found += [f"objects.{name}.orientation" for name, part in config.objects.items() if part.turn.kind != "yaw"]
    found += [f"groups.{name}" for name in config.groups]
    if found:
        raise NotSupportedError(
            "\n".join(f"{config.where}: {path}: is not supported yet. Leave it out." for path in found)
        )


def _is_placed(part: ObjectConfig) -> bool:
    return part.kind != "static" and (part.support is not None or part.region is not None)


def _is_mocap(mjm: mujoco.MjModel, body: int) -> bool:
    return mjm.body_mocapid[mjm.body_rootid[body]] >= 0


def _are_neighbours(mjm: mujoco.MjModel, a: int, b: int) -> bool:
    """Whether MuJoCo filters the pair as parent and child, or as parts of one rigid body."""
    wa, wb = mjm.body_weldid[a], mjm.body_weldid[b]
    pa, pb = mjm.body_weldid[mjm.body_parentid[wa]], mjm.body_weldid[mjm.body_parentid[wb]]
    return wa == wb or (wa != 0 and wa == pb) or (wb != 0 and wb == pa)


def _touching_at_home(scene: SceneModel, plan: Plan) -> set[frozenset[int]]:
    """Pairs of bodies that the model itself starts in contact: those cannot be asked to keep apart."""
    data = mujoco.MjData(scene.mjm)
    data.qpos[:] = plan.home.qpos
    mujoco.mj_kinematics(scene.mjm, data)
    mujoco.mj_collision(scene.mjm, data)
    return {frozenset(int(b) for b in scene.mjm.geom_bodyid[c.geom]) for c in data.contact}


def _placed_object(scene: SceneModel, name: str, pieces: list[Piece], home: mujoco.MjData) -> PlacedObject:
    config = None if name == ROBOT else scene.config.objects[name]
    bodies = scene.subtree(name)
    stream = 0 if config is None else 1 + list(scene.config.objects).index(name)
    draws = [_draw(scene, joint, words) for joint, words in scene.joint_configs(name).items()]
    if config is None or not _is_placed(config):
        return PlacedObject(name, stream, ObjectKind.STATIC, bodies, draws, np.zeros(4), np.zeros(3), [], config)
    own = [p for p in pieces if p.body in bodies]
    if any(p.type == PieceType.PLANE for p in own):
        raise NotSupportedError(
            f"{scene.config.where}: objects.{name}: a plane is endless and cannot be part of what is placed. Use a box."
        )
    quat = scene.mjm.body_quat[bodies[0]].copy()
    pivot, footprint = _pivot(home, bodies, quat, own)
    surfaces = _surfaces(scene, name, config, pieces, home, 0.5 * float(footprint.min()))
    return PlacedObject(name, stream, _KINDS[config.kind], bodies, draws, quat, pivot, surfaces, config)


def _draw(scene: SceneModel, joint: int, words: JointConfig) -> Draw:
    mjm = scene.mjm
    adr = int(mjm.jnt_qposadr[joint])
    low, high = mjm.jnt_range[joint] if mjm.jnt_limited[joint] else (-np.inf, np.inf)
    if words.choice is not None:
        return Draw(adr, 0.0, 0.0, tuple(words.choice))
    if words.fraction is not None:
        a, b = words.fraction
        return Draw(adr, low + a * (high - low), low + b * (high - low))
    if words.range is not None:
        return Draw(adr, *words.range)
    if words.value is not None:
        return Draw(adr, words.value, words.value)
    assert words.noise is not None
    start = scene.home_qpos[adr]
    return Draw(adr, max(start - words.noise, low), min(start + words.noise, high))


def _pivot(
    home: mujoco.MjData, bodies: list[int], quat: np.ndarray, pieces: list[Piece]
) -> tuple[np.ndarray, np.ndarray]:
    """The bottom centre of an object's bounds in its root's frame, and the bounds' size in xy [m]; axes at yaw 0."""
    upright = np.empty(9)
    mujoco.mju_quat2Mat(upright, quat)
    upright = upright.reshape(3, 3)
    if not pieces:
        return np.zeros(3), np.zeros(2)
    root_pos, root_mat = home.xpos[bodies[0]], home.xmat[bodies[0]].reshape(3, 3)
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for p in pieces:
        mat = upright @ root_mat.T @ home.xmat[p.body].reshape(3, 3)
        pos = upright @ root_mat.T @ (home.xpos[p.body] - root_pos)
        low, high = p.extents(mat)
        lower, upper = np.minimum(lower, low + pos), np.maximum(upper, high + pos)
    bottom = np.array([*0.5 * (lower + upper)[:2], lower[2]])
    return upright.T @ bottom, (upper - lower)[:2]


def _surfaces(
    scene: SceneModel, name: str, config: ObjectConfig, pieces: list[Piece], home: mujoco.MjData, half_edge: float
) -> list[Surface]:
    support = config.support
    if support is None:
        return []
    where = f"{scene.config.where}: objects.{name}.{support.word}"
    if support.parent == FLOOR:
        assert scene.config.floor is not None
        if support.word == "inside":
            raise SceneKeyError(f"{where}: the floor has no roof. Write 'on: floor'.")
        found = [supports.floor_surface(scene.config.floor.size)]
    else:
        body = scene.support_body(support.parent, where)
        _check_upright(scene, support.parent, body, home, where)
        own = [p for p in pieces if p.body == body]
        found = supports.level_surfaces(body, own, open_above=support.word == "on")
    if not found:
        raise NoSupportError(
            f"{where}: '{support.parent}' has no level surface of 2 cm or more in width"
            f"{' that is open above' if support.word == 'on' else ''}. Valid: a body with a flat top or floor."
        )
    return supports.crop(found, config.region, config.ratio_on_support * half_edge, where)


def _check_upright(scene: SceneModel, parent: str, body: int, home: mujoco.MjData, where: str) -> None:
    """Surfaces are level in their body's frame, so that frame must stand upright in every state it is drawn in.

    It is looked at with all joints of the parent at their lowest, middle and highest position, and at all choices.
    """
    owner = parent.split("/")[0]
    draws = [_draw(scene, joint, words) for joint, words in scene.joint_configs(owner).items()]
    states = max([3, *(len(d.choice) for d in draws)])
    data = mujoco.MjData(scene.mjm)
    data.qpos[:] = home.qpos
    for k in range(states):
        for d in draws:
            part = k / (states - 1)
            data.qpos[d.qposadr] = d.choice[k % len(d.choice)] if d.choice else d.low + part * (d.high - d.low)
        mujoco.mj_kinematics(scene.mjm, data)
        if (up := data.xmat[body][8]) < _UPRIGHT:
            lean = np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))
            raise NotSupportedError(
                f"{where}: the z axis of '{parent}' leans by {lean:.3g} degrees, and things are placed on level "
                "surfaces only. Give the support a body whose z axis points up, and draw no joint that tilts it."
            )


def roof_rule(config: ObjectConfig | None) -> Roof:
    """What must be above the point that an object is placed on."""
    if config is None or config.support is None or config.support.parent == FLOOR:
        return Roof.EITHER
    return _ROOFS[config.support.word]
