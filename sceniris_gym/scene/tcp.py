"""The tool centre point of a robot: a site of its model, or a site added by the scene's `tcp`."""

import math

import mujoco
import numpy as np

from sceniris_gym.config.robot import RobotConfig, TcpConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.geometry.rotations import matrix, of_angles, product
from sceniris_gym.reach.arm import chain_up
from sceniris_gym.scene.support import subtree

SITE = "tcp"
"""Default name of the tool centre point's site."""
USUAL = (SITE, "grip_site", "gripperframe", "pinch", "grasp_site", "attachment_site", "ee_site", "link_tcp")
"""Names that models usually give to the site of the tool centre point, best first."""
_ADDED = "robot_tcp"
_MOVING = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
# Fingers that close within this angle of the y axis, or move by less than this [m], do not rotate the frame.
_STRAIGHT, _STILL = math.radians(1.0), 1e-4
# A gripper closes along one axis if its fingers move farther along than across it, by this factor.
_ONE_AXIS = 1.5


def tcp_site(spec: mujoco.MjSpec | None, mjm: mujoco.MjModel, qpos: np.ndarray, config: RobotConfig, where: str) -> str:
    """Return the name of the tool centre point's site, and add the site if the model does not have it yet.

    Without `tcp` in the scene, the first of the robot's sites with a name in `USUAL` is taken. If there is no such
    site, or if it needs a turn about z and the model cannot be edited, the result is 'tcp', which need not exist.

    Args:
        spec: The specification that may get a new site, or None if the model cannot be edited.
        mjm: The model compiled from `spec`.
        qpos: The start pose, shape (nq,). The closing axis of the fingers is measured in this pose.
        config: The robot.
        where: The text at the beginning of error messages.

    Raises:
        UnknownNameError: The robot has no such site or body.
        SceneKeyError: The model needs a new site, but cannot be edited.
    """
    words, prefix, where = config.tcp, config.prefix, f"{where}: {config.section}.tcp"
    root = mjm.body(config.name).id
    if words is None:
        usual = _usual_site(mjm, root, prefix)
        if usual == f"{prefix}{SITE}":
            return usual
        words = TcpConfig(site=usual)
    body, site = _found(mjm, root, words, prefix, where)
    pos, quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    if site is not None:
        pos, quat = mjm.site_pos[site].copy(), mjm.site_quat[site].copy()
    pos = pos + matrix(quat) @ np.array(words.offset)
    quat = product(quat, of_angles(np.radians(words.turns)))
    if words.yaw is None:
        half = 0.5 * _closing_angle(mjm, qpos, root, body, pos, quat)
        quat = product(quat, np.array([math.cos(half), 0.0, 0.0, math.sin(half)]))
    if site is not None and np.allclose(pos, mjm.site_pos[site]) and np.allclose(quat, mjm.site_quat[site]):
        return mjm.site(site).name
    if spec is None and config.tcp is None:
        return f"{prefix}{SITE}"
    if spec is None:
        raise SceneKeyError(
            f"{where}: would add a site to the model, but MuJoCo cannot turn a MjModel back into an editable "
            "MjSpec. Name a site whose +z is the approach axis and whose +y is the axis along which the fingers close, "
            "or give 'model' as a mujoco.MjSpec or as the path of an MJCF file."
        )
    is_taken = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_SITE, f"{prefix}{SITE}") >= 0
    name = f"{prefix}{_ADDED if is_taken else SITE}"
    spec.body(mjm.body(body).name).add_site(name=name, pos=pos, quat=quat, group=5)
    return name


def _usual_site(mjm: mujoco.MjModel, root: int, prefix: str) -> str:
    """Return the name of a robot's site that is best in `USUAL`, also below a further prefix, as in 'hand/pinch'."""
    names = [mjm.site(i).name for i in range(mjm.nsite) if int(mjm.site_bodyid[i]) in subtree(mjm, root)]
    rank = {name: (USUAL.index(last), len(name)) for name in names if (last := name.rpartition("/")[2]) in USUAL}
    return min(rank, key=rank.__getitem__, default=f"{prefix}{SITE}")


def _found(mjm: mujoco.MjModel, root: int, words: TcpConfig, prefix: str, where: str) -> tuple[int, int | None]:
    """Return the body that carries the tool centre point, and its site. The site is None if `tcp` names a body."""
    inside = subtree(mjm, root)
    sites = {mjm.site(i).name: i for i in range(mjm.nsite) if int(mjm.site_bodyid[i]) in inside}
    bodies = {mjm.body(b).name: b for b in inside}
    for name in (f"{prefix}{words.site}", words.site):
        if words.site is not None and name in sites:
            return int(mjm.site_bodyid[sites[name]]), sites[name]
    for name in (f"{prefix}{words.body}", words.body):
        if words.body is not None and name in bodies:
            return bodies[name], None
    known = (*(sites if words.site is not None else ()), *(bodies if words.body is not None else ()))
    kind = "site" if words.body is None else "body" if words.site is None else "site or body"
    valid = [name.removeprefix(prefix) for name in known if name]
    raise UnknownNameError(f"robot {kind}", str(words.site or words.body), where, valid)


def _closing_angle(
    mjm: mujoco.MjModel, qpos: np.ndarray, root: int, body: int, pos: np.ndarray, quat: np.ndarray
) -> float:
    """Return the rotation [rad] of a body's frame about its z axis that aligns its y axis with the closing fingers.

    Finger joints are the joints of the hand outside the chain from root to body. If the fingers do not share an axis,
    such as three fingers around a palm, the finger that moves farthest sets the axis.
    """
    chain = chain_up(mjm, body, root)
    hand = subtree(mjm, next((b for b in chain if mjm.body_jntnum[b]), chain[-1]))
    moves, data = [], mujoco.MjData(mjm)
    for joint in np.flatnonzero(np.isin(mjm.jnt_bodyid, [b for b in hand if b not in chain])):
        geoms = np.flatnonzero(np.isin(mjm.geom_bodyid, subtree(mjm, int(mjm.jnt_bodyid[joint]))))
        if not len(geoms) or not mjm.jnt_limited[joint] or int(mjm.jnt_type[joint]) not in _MOVING:
            continue
        ends = []  # positions of the finger's geoms across the z axis of the frame, at both joint limits
        for value in mjm.jnt_range[joint]:
            data.qpos[:] = qpos
            data.qpos[mjm.jnt_qposadr[joint]] = value
            mujoco.mj_kinematics(mjm, data)
            axes = data.xmat[body].reshape(3, 3) @ matrix(quat)
            origin = data.xpos[body] + data.xmat[body].reshape(3, 3) @ pos
            ends.append(((data.geom_xpos[geoms] - origin) @ axes)[:, :2])
        moves.append((ends[1] - ends[0]).mean(axis=0))
    moves = [move for move in moves if np.linalg.norm(move) > _STILL]
    if not moves:
        return 0.0
    _, sizes, axes = np.linalg.svd(np.array(moves), full_matrices=False)
    axis = axes[0] if len(sizes) < 2 or sizes[0] > _ONE_AXIS * sizes[1] else max(moves, key=np.linalg.norm)
    angle = math.remainder(math.atan2(axis[1], axis[0]) - 0.5 * math.pi, math.pi)
    return angle if abs(angle) > _STRAIGHT else 0.0
