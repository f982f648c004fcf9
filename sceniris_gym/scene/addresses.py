"""Addresses of objects' poses and joints' positions in qpos and among the mocap bodies, by the names of the scene."""

from __future__ import annotations

from typing import Literal, NamedTuple

import mujoco

from sceniris_gym.errors import NotSupportedError, UnknownNameError
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import is_static

_WIDTHS = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}


class PoseAddress(NamedTuple):
    """The address of an object's pose.

    Attributes:
        kind: "qpos", "mocap", or "body" for an object that never moves.
        number: Address in qpos, mocap id, or body id.
    """

    kind: Literal["qpos", "mocap", "body"]
    number: int


def pose_address(scene: SceneModel, name: str, where: str) -> PoseAddress:
    """Return the address of the pose of an object's root body, or of the robot's.

    Raises:
        UnknownNameError: The scene has no such object.
        NotSupportedError: The body hangs on joints, from which its pose follows.
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
        raise NotSupportedError(f"{where}: '{name}' hangs on joints, and layouts hold their positions, not its pose.")
    return PoseAddress("body", body)


def joint_address(scene: SceneModel, name: str, where: str) -> tuple[int, int]:
    """Return the address of a joint in qpos, and its width there.

    Args:
        scene: The scene.
        name: The joint's name in the model, `object/joint`, or the name inside its object if only one has it.
        where: The beginning of errors.

    Raises:
        UnknownNameError: There is no such joint, or several objects have one of that name.
    """
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
