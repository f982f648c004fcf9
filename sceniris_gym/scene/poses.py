"""Finds the pose of an object in the arrays of a layout, and computes the poses of a body in many layouts."""

from typing import Literal, NamedTuple

import mujoco
import numpy as np

from sceniris_gym.errors import NotSupportedError, UnknownNameError, check_type
from sceniris_gym.reach.arm import chain_up
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import is_static

_WIDTHS = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}


class PoseAddress(NamedTuple):
    """The place of an object's pose in the arrays of a layout.

    Attributes:
        kind: "qpos", "mocap", or "body" for an object that never moves.
        number: Address in qpos, mocap id, or body id.
    """

    kind: Literal["qpos", "mocap", "body"]
    number: int


def pose_address(scene: SceneModel, name: str, where: str) -> PoseAddress:
    """Return the address of the pose of an object's or a robot's root body.

    Raises:
        UnknownNameError: The scene has no such object.
        NotSupportedError: The pose of the body depends on joints other than a freejoint.
    """
    if name not in scene.bodies:
        raise UnknownNameError("object", name, where, [*scene.bodies, *scene.config.variants])
    mjm, body = scene.mjm, scene.bodies[name]
    joint = int(mjm.body_jntadr[body])
    if joint >= 0 and mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
        return PoseAddress("qpos", int(mjm.jnt_qposadr[joint]))
    if mjm.body_mocapid[body] >= 0:
        return PoseAddress("mocap", int(mjm.body_mocapid[body]))
    if not is_static(mjm)[body]:
        raise NotSupportedError(
            f"{where}: '{name}' hangs on joints, so layouts store joint positions and not its pose. Read its joints."
        )
    return PoseAddress("body", body)


def joint_address(scene: SceneModel, name: str, where: str) -> tuple[int, int]:
    """Return the address of a joint in qpos, and its number of values in qpos.

    Args:
        scene: The scene.
        name: The joint's name in the model, `object/joint`, or the name inside its object if it is unique.
        where: The text at the beginning of error messages.

    Raises:
        UnknownNameError: The joint does not exist, or several objects have a joint of that name.
    """
    check_type(name, str, f"{where}: name")  # mj_name2id would crash
    mjm = scene.mjm
    joint = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_JOINT, name)
    if joint < 0:
        inside = {f"{owner}/{local}": j for owner in scene.bodies for local, j in scene.joints(owner).items()}
        found = [j for full, j in inside.items() if name in (full, full.partition("/")[2])]
        if len(found) != 1:
            named = filter(None, (mjm.joint(j).name for j in range(mjm.njnt)))
            raise UnknownNameError("joint", name, where, [*inside, *named])
        joint = found[0]
    return int(mjm.jnt_qposadr[joint]), _WIDTHS.get(mujoco.mjtJoint(int(mjm.jnt_type[joint])), 1)


def body_poses(
    mjm: mujoco.MjModel, body: int, qpos: np.ndarray, mocap_pos: np.ndarray, mocap_quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions [m] and orientations (wxyz) of a body in the world frame, shapes (nrow, 3) and (nrow, 4).

    Args:
        mjm: The model.
        body: Id of the body.
        qpos: Joint positions, shape (nrow, nq).
        mocap_pos: Positions of mocap bodies, shape (nrow, nmocap, 3).
        mocap_quat: Orientations of mocap bodies, shape (nrow, nmocap, 4).
    """
    pos, quat = np.zeros((len(qpos), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(qpos), 1))
    for link in reversed(chain_up(mjm, body)[:-1]):
        mocap = mjm.body_mocapid[link]
        if mocap >= 0:
            pos, quat = mocap_pos[:, mocap].astype(float), _unit(mocap_quat[:, mocap])
            continue
        pos, quat = pos + rotated(mjm.body_pos[link], quat), product(quat, mjm.body_quat[link])
        for joint in range(mjm.body_jntadr[link], mjm.body_jntadr[link] + mjm.body_jntnum[link]):
            adr, kind, axis = mjm.jnt_qposadr[joint], mjm.jnt_type[joint], mjm.jnt_axis[joint]
            if kind == mujoco.mjtJoint.mjJNT_FREE:
                pos, quat = qpos[:, adr : adr + 3].astype(float), _unit(qpos[:, adr + 3 : adr + 7])
            elif kind == mujoco.mjtJoint.mjJNT_SLIDE:
                pos = pos + rotated(axis, quat) * (qpos[:, adr] - mjm.qpos0[adr])[:, None]
            else:
                half = 0.5 * (qpos[:, adr].astype(float) - mjm.qpos0[adr])[:, None]
                rotation = np.hstack([np.cos(half), np.sin(half) * axis])
                if kind == mujoco.mjtJoint.mjJNT_BALL:
                    rotation = _unit(qpos[:, adr : adr + 4])
                anchor = pos + rotated(mjm.jnt_pos[joint], quat)
                quat = product(quat, rotation)
                pos = anchor - rotated(mjm.jnt_pos[joint], quat)
    return pos, quat


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of quaternions (wxyz), shape (nrow, 4)."""
    a, b = np.broadcast_arrays(a, b)
    w, v = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(axis=1, keepdims=True), np.cross(a[:, 1:], b[:, 1:])
    return np.hstack([w, v + a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:]])


def rotated(vector: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Rotate one vector, or one vector per row, by quaternions (wxyz) of shape (nrow, 4). Return shape (nrow, 3)."""
    axis = quat[:, 1:]
    twice = 2.0 * np.cross(axis, np.broadcast_to(vector, axis.shape))
    return vector + quat[:, :1] * twice + np.cross(axis, twice)


def _unit(quat: np.ndarray) -> np.ndarray:
    exact = quat.astype(float)
    return exact / np.linalg.norm(exact, axis=1, keepdims=True)
