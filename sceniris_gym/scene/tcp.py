"""The tool centre point of a robot: a site of its model, or one that is added where the scene says."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from sceniris_gym.config.robot import RobotConfig, TcpConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.scene.assemble import turn_of

SITE = "tcp"
"""Name of the site that is the tool centre point where a scene names none."""
_ADDED = "robot_tcp"
_MOVING = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
# Fingers that move along y within this angle need no turn, nor do those that move by less [m].
_STRAIGHT, _STILL = math.radians(1.0), 1e-4
# A gripper closes along one axis if its fingers move this many times as far along it as across.
_ONE_AXIS = 1.5


def tcp_site(
    spec: mujoco.MjSpec | None, mjm: mujoco.MjModel, qpos: np.ndarray, config: RobotConfig, prefix: str, where: str
) -> str:
    """Return the name of the site that is the tool centre point; one that is not in the model yet is added to it.

    Without `tcp` in the scene it is the robot's site 'tcp', whether there is one or not.

    Args:
        spec: The specification, to which a site may be added; None for a model that cannot be edited.
        mjm: The model compiled from it.
        qpos: Its start pose, shape (nq,), in which the closing axis of the fingers is measured.
        config: The robot.
        prefix: What the names inside the robot begin with: '' or 'name/'.
        where: Begins errors.

    Raises:
        UnknownNameError: The robot has no such site or body.
        SceneKeyError: A site would have to be added, and the model cannot be edited.
    """
    words, where = config.tcp, f"{where}: {config.section}.tcp"
    if words is None:
        return f"{prefix}{SITE}"
    root = mjm.body(config.name).id
    body, site = _found(mjm, root, words, prefix, where)
    pos, quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    if site is not None:
        pos, quat = mjm.site_pos[site].copy(), mjm.site_quat[site].copy()
    pos = pos + matrix(quat) @ np.array(words.offset)
    quat = _product(quat, turn_of(*words.turns))
    if words.yaw is None:
        half = 0.5 * _closing_turn(mjm, qpos, root, body, pos, quat)
        quat = _product(quat, np.array([math.cos(half), 0.0, 0.0, math.sin(half)]))
    if site is not None and np.allclose(pos, mjm.site_pos[site]) and np.allclose(quat, mjm.site_quat[site]):
        return mjm.site(site).name
    if spec is None:
        raise SceneKeyError(
            f"{where}: would add a site to the model, and MuJoCo cannot turn a MjModel back into something that can be "
            "edited. Name a site whose +z is the approach axis and whose +y is the axis along which the fingers close, "
            "or give 'model' as a mujoco.MjSpec or as the path of an MJCF file."
        )
    taken = {mjm.site(i).name for i in range(mjm.nsite)}
    name = f"{prefix}{SITE}" if f"{prefix}{SITE}" not in taken else f"{prefix}{_ADDED}"
    spec.body(mjm.body(body).name).add_site(name=name, pos=pos, quat=quat, group=5)
    return name


def _found(mjm: mujoco.MjModel, root: int, words: TcpConfig, prefix: str, where: str) -> tuple[int, int | None]:
    """The body, and the site on it if one is named."""
    inside = {b for b in range(mjm.nbody) if _is_below(mjm, b, root)}
    sites = {mjm.site(i).name: i for i in range(mjm.nsite) if int(mjm.site_bodyid[i]) in inside}
    bodies = {mjm.body(b).name: b for b in inside}
    for name in (f"{prefix}{words.site}", words.site) if words.site is not None else ():
        if name in sites:
            return int(mjm.site_bodyid[sites[name]]), sites[name]
    for name in (f"{prefix}{words.body}", words.body) if words.body is not None else ():
        if name in bodies:
            return bodies[name], None
    known = (*(sites if words.site is not None else ()), *(bodies if words.body is not None else ()))
    kind = "site" if words.body is None else "body" if words.site is None else "site or body"
    valid = [name.removeprefix(prefix) for name in known if name]
    raise UnknownNameError(f"{kind} of the robot", str(words.site or words.body), where, valid)


def _is_below(mjm: mujoco.MjModel, body: int, root: int) -> bool:
    while body > root:  # parents come before their children
        body = int(mjm.body_parentid[body])
    return body == root


def _closing_turn(
    mjm: mujoco.MjModel, qpos: np.ndarray, root: int, body: int, pos: np.ndarray, quat: np.ndarray
) -> float:
    """By how much [rad] a frame on a body is to be turned about its z axis for the fingers to close along its y axis.

    Fingers are what other joints than those between root and body move on the hand. Where they do not share one axis,
    as with three fingers around a palm, the axis of the one that moves farthest counts.
    """
    hand = body
    while hand not in (0, root) and not mjm.body_jntnum[hand]:
        hand = int(mjm.body_parentid[hand])
    chain = [body]
    while chain[-1] not in (0, root):
        chain.append(int(mjm.body_parentid[chain[-1]]))
    moves = []
    for joint in range(mjm.njnt):
        at = int(mjm.jnt_bodyid[joint])
        finger = at not in chain and _is_below(mjm, at, hand)
        if finger and mjm.jnt_limited[joint] and int(mjm.jnt_type[joint]) in _MOVING:
            moves += _finger_moves(mjm, qpos, joint, body, pos, quat)
    moves = [move for move in moves if np.linalg.norm(move) > _STILL]
    if not moves:
        return 0.0
    _, sizes, axes = np.linalg.svd(np.array(moves), full_matrices=False)
    axis = axes[0] if len(sizes) < 2 or sizes[0] > _ONE_AXIS * sizes[1] else max(moves, key=np.linalg.norm)
    turn = math.remainder(math.atan2(axis[1], axis[0]) - 0.5 * math.pi, math.pi)
    return turn if abs(turn) > _STRAIGHT else 0.0


def _finger_moves(
    mjm: mujoco.MjModel, qpos: np.ndarray, joint: int, body: int, pos: np.ndarray, quat: np.ndarray
) -> list[np.ndarray]:
    """How far [m] the geoms below a joint move across the z axis of a frame, from one of its limits to the other."""
    data, ends = mujoco.MjData(mjm), []
    geoms = [g for g in range(mjm.ngeom) if _is_below(mjm, int(mjm.geom_bodyid[g]), int(mjm.jnt_bodyid[joint]))]
    for value in mjm.jnt_range[joint]:
        data.qpos[:] = qpos
        data.qpos[mjm.jnt_qposadr[joint]] = value
        mujoco.mj_kinematics(mjm, data)
        axes = data.xmat[body].reshape(3, 3) @ matrix(quat)
        origin = data.xpos[body] + data.xmat[body].reshape(3, 3) @ pos
        ends.append((data.geom_xpos[geoms] - origin) @ axes)
    moved = np.reshape(ends[1] - ends[0], (-1, 3))[:, :2]
    return [moved.mean(axis=0)] if len(moved) else []


def _product(first: np.ndarray, then: np.ndarray) -> np.ndarray:
    both = np.zeros(4)
    mujoco.mju_mulQuat(both, first, then)
    return both
