"""Bodies of the user's own model as objects of a scene, and checks that they are suitable.

A model from a file is changed where the scene requires it. A model in memory belongs to the user: only `edit_spec`
changes it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.member_names import SUPPORT, variant_of
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.scene import assemble, backdrop
from sceniris_gym.scene.assemble import FREE, compile_spec
from sceniris_gym.scene.field_table import JOINT_TRANSMISSIONS
from sceniris_gym.scene.parking import add_parking_ground, has_parking_ground
from sceniris_gym.scene.support import subtree
from sceniris_gym.scene.tcp import tcp_site

HOME = "home"
"""The keyframe of a model's start pose, unless the scene names another keyframe."""
_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
_MOCAP = ("fixture", "marker")
_JOINTS = {int(kind): kind.name.removeprefix("mjJNT_").lower() for kind in mujoco.mjtJoint.__members__.values()}
EDIT_SPEC = "Call edit_spec(spec, scene) on the MjSpec before you compile it, and simulate the compiled model."


def instead_of_variants(name: str, members: Sequence[str]) -> str:
    """Return the advice for a user who builds the worlds: the model should have a body for each variant of `name`.

    The object `name` may also have several supports, or an object with variants as its support.
    """
    if SUPPORT in members[0]:
        return f"Or name one support for '{name}', an object without variants."
    first, more = [variant_of(member) for member in members[:4]], ["..."] if len(members) > 4 else []
    group = f"groups: {{{name}: {{of: [{', '.join(first + more)}], count: 1}}}}"
    return f"Or make each variant a body of the model, and let a group draw one of them: {group}. {EDIT_SPEC}"


def free_from_slides(spec: mujoco.MjSpec, body: mujoco.MjsBody, where: str) -> bool:
    """Replace three slides and three hinges of a body by a freejoint, and adapt the keyframes. Return whether it is so.

    The joints stay if they have limits, springs or different damping, or if another element refers to one of them.

    Args:
        spec: The specification.
        body: A child of the world.
        where: The text at the beginning of error messages.

    Raises:
        SceneFileError: MuJoCo cannot compile the specification.
    """
    joints = list(body.joints)
    if body.parent.name != "world" or sorted(int(joint.type) for joint in joints) != [_SLIDE] * 3 + [_HINGE] * 3:
        return False
    mjm = compile_spec(spec, where)
    ids, dofs = np.array([joint.id for joint in joints]), mjm.dof_bodyid == body.id
    axes, is_slide = mjm.jnt_axis[ids], mjm.jnt_type[ids] == _SLIDE
    if min(map(np.linalg.matrix_rank, (axes[is_slide], axes[~is_slide]))) < 3 or _named_joints(mjm) & {*ids.tolist()}:
        return False
    same = np.column_stack([mjm.dof_damping, mjm.dof_armature, mjm.dof_frictionloss])[dofs]
    if np.ptp(same, axis=0).any() or mjm.jnt_stiffness[ids].any() or mjm.jnt_limited[ids].any():
        return False
    data, root, adr, kept = mujoco.MjData(mjm), body.id, int(mjm.jnt_qposadr[ids[0]]), joints[0]
    for joint in joints[1:]:
        spec.delete(joint)
    kept.type, kept.name = FREE, f"{body.name}/free"
    for key, stored in zip(spec.keys, mjm.key_qpos, strict=True):
        data.qpos[:] = stored
        mujoco.mj_kinematics(mjm, data)
        key.qpos = [*stored[:adr], *data.xpos[root], *data.xquat[root], *stored[adr + len(ids) :]]
    return True


def driven_joints(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the ids of the joints at which actuators of a model pull, one for each of these actuators."""
    return mjm.actuator_trnid[np.isin(mjm.actuator_trntype, JOINT_TRANSMISSIONS), 0]


def _named_joints(mjm: mujoco.MjModel) -> set[int]:
    """Return the joints to which actuators, tendons, equalities or sensors of a model refer."""
    eq, joint = mjm.eq_type == mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    named = (
        driven_joints(mjm),
        mjm.wrap_objid[mjm.wrap_type == mujoco.mjtWrap.mjWRAP_JOINT],
        *(mjm.eq_obj1id[eq], mjm.eq_obj2id[eq]),
        mjm.sensor_objid[mjm.sensor_objtype == joint],
    )
    return {*np.concatenate(named).tolist()}


def adopt_body(spec: mujoco.MjSpec, name: str, config: ObjectConfig, where: str) -> None:
    """Use a body of a specification as an object. A fixture or a marker becomes a mocap body.

    Three slides and three hinges of a free object become a freejoint.

    Args:
        spec: The specification.
        name: The object, or the robot.
        config: The settings of the object or robot in the scene.
        where: The file and the key of these settings. Error messages begin with it.

    Raises:
        UnknownNameError: The model has no such body.
        SceneKeyError: The body cannot be of the object's kind.
    """
    body = spec.body(config.body or name)
    if body is None or body.name == "world":
        raise _unknown(config.body or name, [b.name for b in spec.bodies], where)
    where = f"{where}.kind"
    if config.kind == "free":
        free_from_slides(spec, body, where)
    _check_kind(body.name, body.parent.name, [int(joint.type) for joint in body.joints], config.kind, where)
    if config.kind in _MOCAP:
        assemble.make_kind(spec, body, body.name, config.kind, where)


def check_bodies(mjm: mujoco.MjModel, config: SceneConfig) -> None:
    """Check that a model in memory fits a scene: bodies with suitable joints, and, for groups, a parking ground.

    Raises:
        UnknownNameError: The model has no such body.
        SceneKeyError: The body cannot be of the object's kind without changes, or the parking ground is missing.
    """
    for name, part in config.parts.items():
        if part.asset is not None:
            continue
        where, name = f"{config.where}: {config.key(name)}", part.body or name
        body = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, name)
        if body <= 0:
            raise _unknown(name, [mjm.body(i).name for i in range(mjm.nbody)], where)
        where, parent = f"{where}.kind", mjm.body(int(mjm.body_parentid[body])).name
        _check_kind(name, parent, mjm.jnt_type[mjm.jnt_bodyid == body].tolist(), part.kind, where)
        is_mocap = mjm.body_mocapid[body] >= 0
        fits = is_mocap and (part.kind != "marker" or not _touches(mjm, body))
        if part.is_placed and part.kind in _MOCAP and not fits:
            wanted = "without collisions" if is_mocap else "a mocap body"
            raise SceneKeyError(
                f"{where}: body '{name}' should be {wanted} to be placed as a '{part.kind}'. A model in memory is "
                f"never changed automatically. {EDIT_SPEC}"
            )
    if config.presence.draws and not has_parking_ground(mjm, len(config.objects), config.where):
        # edit_spec refuses scenes with assets, such as scenes with variants
        attached = any(part.asset is not None for part in config.objects.values())
        cure = "Give the scene a 'floor', or the MjSpec an endless plane at z = 0." if attached else EDIT_SPEC
        raise SceneKeyError(
            f"{config.where}: groups: the model has no ground on which absent members are parked. A model in "
            f"memory is never changed automatically. {cure}"
        )


def check_additions(config: SceneConfig) -> None:
    """Check that a scene does not add parts to a MjModel, which cannot be edited.

    Raises:
        SceneKeyError: The scene has a part that is not in the model. The message names its key.
    """
    names = {config.model.body(i).name for i in range(config.model.nbody)}
    wanted = [f"objects.{name}.asset" for name, part in config.objects.items() if part.asset is not None]
    wanted += [robot.section for robot in config.all_robots.values() if robot.in_model is None]
    if config.floor is not None and mujoco.mj_name2id(config.model, mujoco.mjtObj.mjOBJ_GEOM, FLOOR) < 0:
        wanted.append("floor")
    wanted += [f"cameras.{name}" for name in config.cameras]
    wanted += [
        f"objects.{name}"
        for name, part in config.objects.items()
        if part.kind == "marker" and part.asset is None and part.body is None and name not in names
    ]
    if wanted:
        raise SceneKeyError(
            f"{config.where}: {wanted[0]}: would be added to the model, but MuJoCo cannot turn a MjModel back into "
            "an editable MjSpec. Give 'model' as a mujoco.MjSpec or as the path of an MJCF file."
        )


def edit_spec(spec: mujoco.MjSpec, scene: str | Path | Mapping | SceneConfig) -> None:
    """Change a specification in place, so that a scene can be placed on the model compiled from it.

    Placed bodies without a freejoint become mocap bodies. Mocap bodies take their poses from the start keyframe.
    Markers, the floor, missing sites of `tcp`, and the parking ground of absent group members are added. Everything
    else stays unchanged. Afterwards, compile the scene with the specification, or the MjModel compiled from it, as its
    `model`.

    Args:
        spec: The specification, before it is compiled.
        scene: The scene, as for `compile_scene`. The scene's `model` is not used.

    Raises:
        UnknownNameError: The model has no such body.
        SceneKeyError: A body cannot be of its object's kind, or the scene has assets. `compile_scene` attaches assets.
    """
    config = SceneConfig.load(scene, {"model": spec})
    parts = {**config.all_robots, **config.objects}
    assets = [f"{config.key(name)}.asset" for name, part in parts.items() if part.asset is not None]
    if key := next(iter(assets), None):
        raise SceneKeyError(
            f"{config.where}: {key}: edit_spec changes bodies of the model, but attaches no assets. Let "
            "compile_scene attach assets to the MjSpec, and make Model and Data by make_worlds(compiled, nworld)."
        )
    assemble.stand_at_keyframe(spec, config.home or HOME, "edit_spec: spec")
    if config.floor is not None and spec.geom(FLOOR) is None:
        backdrop.add_floor(spec, config.floor)
    for name, part in config.objects.items():
        if part.kind == "marker" and part.body is None and spec.body(name) is None:
            assemble.attach_object(spec, name, part, config.where)
        else:
            adopt_body(spec, name, part, f"{config.where}: objects.{name}")
    for robot in config.all_robots.values():
        if robot.placing is not None:
            adopt_body(spec, robot.name, robot.placing, f"{config.where}: {robot.section}")
        if robot.tcp is not None:
            mjm = compile_spec(spec, "edit_spec: spec")
            tcp_site(spec, mjm, mjm.qpos0, robot, config.where)
    nslot = len(config.objects)
    if config.presence.draws and not has_parking_ground(compile_spec(spec, "edit_spec: spec"), nslot, config.where):
        add_parking_ground(spec, nslot)


def _touches(mjm: mujoco.MjModel, body: int) -> bool:
    """Return whether any geom of a body's subtree collides."""
    paired = np.isin(np.arange(mjm.ngeom), [mjm.pair_geom1, mjm.pair_geom2])
    touching = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0) | paired
    return bool(touching[np.isin(mjm.geom_bodyid, subtree(mjm, body))].any())


def _unknown(name: str, bodies: list[str], where: str) -> UnknownNameError:
    return UnknownNameError("body of the model", name, where, [b for b in bodies if b and b != "world"])


def _check_kind(name: str, parent: str, joints: list[int], kind: str, where: str) -> None:
    free = int(FREE)
    if parent != "world":
        raise SceneKeyError(
            f"{where}: body '{name}' should be a child of the world, not of '{parent}'. Move it in the model."
        )
    if kind == "free" and joints != [free]:
        has = ", ".join(_JOINTS[joint] for joint in joints) or "no joint"
        instead = f"in place of its {len(joints)} joints ({has})" if joints else "in it"
        raise SceneKeyError(
            f"{where}: body '{name}' should have a freejoint and no other joint to be 'free', but has {has}. Write "
            f"<freejoint name=\"{name}\"/> {instead}, or make it 'static' and draw its joints by 'joints'."
        )
    if kind == "static" and free in joints:
        raise SceneKeyError(f"{where}: body '{name}' has a freejoint, so its kind should be 'free'.")
    if kind in _MOCAP and joints:
        raise SceneKeyError(
            f"{where}: body '{name}' should have no joints at its root to be a '{kind}'. Remove the joints, or move "
            "them to a child body."
        )
