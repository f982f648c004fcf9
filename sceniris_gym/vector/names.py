"""Look up bodies, joints, sites and actuators in a scene's model by the names that tasks use."""

from collections.abc import Iterable

import mujoco

from sceniris_gym.errors import UnknownNameError, check_type
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree

Joints = str | tuple[int, ...]
"""An object, a robot or one joint by its name, or joints by their ids in the model."""

FREE = int(mujoco.mjtJoint.mjJNT_FREE)
SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
SCALAR = (SLIDE, int(mujoco.mjtJoint.mjJNT_HINGE))


def unknown(scene: SceneModel, kind: str, name: str, where: str, valid: Iterable[str]) -> UnknownNameError:
    """Return the error for a name that a scene does not have. `where` names the caller."""
    return UnknownNameError(kind, name, f"scene '{scene.config.name}': {where}", valid)


def find_body(scene: SceneModel, name: str, where: str, others: Iterable[str] = ()) -> int:
    """Return the id of a body, by the name of an object or a robot in the scene, or by the body's name in the model.

    All lookups of this module take the name of their caller as `where`, for error messages. Messages also list the
    names `others`, which the caller looks up first.

    Raises:
        UnknownNameError: The scene has no such body.
    """
    check_type(name, str, f"{where}: name")
    body = _body(scene, name)
    if body < 0:
        known = {*scene.bodies, *others, *(scene.mjm.body(i).name for i in range(1, scene.mjm.nbody))}
        raise unknown(scene, "body", name, where, known)
    return body


def _body(scene: SceneModel, name: str) -> int:
    if name in scene.bodies:
        return scene.bodies[name]
    return mujoco.mj_name2id(scene.mjm, mujoco.mjtObj.mjOBJ_BODY, name)


def find_element(scene: SceneModel, kind: str, name: str, where: str) -> int:
    """Return the id of an element (kind 'site' or 'actuator') by its name in the model. Raise as `find_body` does."""
    check_type(name, str, f"{where}: name")
    mjm = scene.mjm
    number = mujoco.mj_name2id(mjm, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name)
    if number < 0:
        count = {"site": mjm.nsite, "actuator": len(mjm.actuator_trntype)}[kind]
        raise unknown(scene, kind, name, where, (getattr(mjm, kind)(i).name for i in range(count)))
    return number


def find_free_dof(scene: SceneModel, name: str, where: str) -> int:
    """Return the index in `qvel` of the first of a free object's six velocities. Raise as `find_body` does."""
    mjm, body = scene.mjm, find_body(scene, name, where)
    joint = int(mjm.body_jntadr[body])
    if joint < 0 or mjm.jnt_type[joint] != FREE:
        free = [mjm.body(b).name for j, b in enumerate(mjm.jnt_bodyid) if mjm.jnt_type[j] == FREE]
        raise unknown(scene, "free object", mjm.body(body).name, where, free)
    return int(mjm.jnt_dofadr[joint])


def find_joints(scene: SceneModel, name: Joints, where: str) -> list[int]:
    """Return a list of joint ids: the named joint, or all hinges and slides inside a named object, robot or body.

    Raises:
        UnknownNameError: The scene has no such name, or the named body contains no hinges and slides.
    """
    if not isinstance(name, str):
        return list(name)
    mjm = scene.mjm
    scalar = [j for j in range(mjm.njnt) if mjm.jnt_type[j] in SCALAR]
    found = [j for j in scalar if mjm.joint(j).name == name]
    body = _body(scene, name)
    if not found and body >= 0:
        inside = subtree(mjm, body)
        found = [j for j in scalar if int(mjm.jnt_bodyid[j]) in inside]
    if not found:
        roots = {mjm.body(int(mjm.body_rootid[int(mjm.jnt_bodyid[j])])).name for j in scalar}
        raise unknown(scene, "joint", name, where, roots | {mjm.joint(j).name for j in scalar})
    return found
