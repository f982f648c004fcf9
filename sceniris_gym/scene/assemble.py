"""Assembly of assets into one MuJoCo specification. An object's root body is `name`, its elements are `name/...`."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from sceniris_gym.config.loader import SHIPPED_NAME, shipped
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import MeshError, ModelWarning, NotSupportedError, SceneFileError, SceneKeyError, check_names
from sceniris_gym.geometry.rotations import of_angles
from sceniris_gym.scene.model_files import load_model, renamed
from sceniris_gym.scene.number_check import check_numbers
from sceniris_gym.scene.scaling import scale_asset

FREE = mujoco.mjtJoint.mjJNT_FREE
_BODIES = (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_XBODY)

MARK_GROUP = 4
"""Group of the geoms that show a marker. They appear in pictures, but are not part of the placed object."""

_OF_JOINTS = ("actuators", "tendons", "equalities")
"""Elements that refer to joints. If a variant loses its joints, it also loses these elements."""

_SIZES = ("memory", "nconmax", "nemax", "njmax", "nstack")
"""Sizes of buffers. Like options, the scene determines them."""

_NESTS = not mujoco.__version__.startswith("3.")  # 3.11 writes wrong poses of what is in a frame inside a frame
_AT_ONCE = 24
"""Number of variants per intermediate model: about the square root of the largest number of variants."""


Loaded = dict[str, mujoco.MjSpec]
"""Assets by the words that name them, so that each file is read once."""


class Home(NamedTuple):
    """A start pose: joint positions by joint name and controls by actuator name."""

    qpos: dict[str, list[float]]
    ctrl: dict[str, float]


def attach_object(
    spec: mujoco.MjSpec, name: str, config: ObjectConfig, where: str, owner: str = "", loaded: Loaded | None = None
) -> Home:
    """Attach the asset of an object as a body of the object's kind, and return its start pose.

    If the object is a variant of `owner`, bodies without joints below it become parts of it. Names of its body and
    elements lack the prefix `owner/`, which `attach_variants` adds. `loaded` collects assets, which are then read once.

    Raises:
        NotSupportedError: A variant is soft.
    """
    if config.asset is None:
        marker = spec.worldbody.add_body(name=name, mocap=True)
        marker.add_site(name=f"{name}/site", size=[0.02, 0.0, 0.0], rgba=[0.1, 0.8, 0.2, 0.6])
        marker.add_geom(  # pictures are ray-cast, and do not show sites
            name=f"{name}/mark",
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[0.04, 0.001, 0.0],
            rgba=[0.1, 0.8, 0.2, 1.0],
            contype=0,
            conaffinity=0,
            group=MARK_GROUP,
            mass=0.0,
        )
        return Home({}, {})
    where, name = f"{where}: objects.{name}", name.removeprefix(f"{owner}/")
    loaded = {} if loaded is None else loaded
    if config.asset not in loaded:
        loaded[config.asset] = _load_asset(config.asset, f"{where}.asset")
    child = loaded[config.asset].copy()
    if owner and child.flexes:
        raise NotSupportedError(f"{where}: is soft, but a variant should be a rigid body. Leave it out.")
    if config.scale != 1.0:
        scale_asset(child, config.scale, f"{where}.scale")
    home = _take_home(child, name, keyframe=None, where=f"{where}.asset")
    root = attach(spec, child, name, spec.worldbody.add_frame(), f"{where}.asset")
    below = root.find_all("body") if owner else []
    # a frame would lose masses that geoms do not give
    apart = any(body.joints or body.explicitinertial or (body.bodies and not _NESTS) for body in below)
    if not apart and not root.explicitinertial:
        for body in below:
            body.to_frame()
    make_kind(spec, root, name, config.kind, f"{where}.kind")
    return home


def attach_variants(
    spec: mujoco.MjSpec, owner: str, members: Mapping[str, ObjectConfig], where: str, loaded: Loaded, *, bodies: bool
) -> list[Home]:
    """Attach the variants of an object, as in `attach_object`, and return their start poses.

    Without `bodies`, attach only the elements that the bodies refer to, such as meshes. MuJoCo traverses a whole model
    each time it attaches another model or deletes a body. So groups of variants are first collected in small models.

    Raises:
        NotSupportedError: Actuators, tendons or equalities refer to joints at the roots of variants, which lose them.
    """
    homes, names = [], list(members)
    for first in range(0, len(names), _AT_ONCE):
        some = mujoco.MjSpec()
        some.default.name, some.option, some.visual = str(first), spec.option, spec.visual
        for name in names[first : first + _AT_ONCE]:
            home = attach_object(some, name, members[name], where, owner, loaded)
            homes.append(home._replace(qpos={f"{owner}/{joint}": values for joint, values in home.qpos.items()}))
            if not bodies:
                some.delete(some.body(name.removeprefix(f"{owner}/")))
        _keep_files_apart(spec, some, f"{owner}/{first}")
        wanted = {kind: len(getattr(spec, kind)) + len(getattr(some, kind)) for kind in _OF_JOINTS}
        spec.attach(some, prefix=f"{owner}/", frame=spec.worldbody.add_frame())
        # MuJoCo silently leaves out elements that name a missing joint
        if lost := [kind for kind, count in wanted.items() if bodies and len(getattr(spec, kind)) < count]:
            raise NotSupportedError(
                f"{where}: objects.{owner}: {' and '.join(lost)} refer to root joints of variants, but variants lose "
                "these joints: 'kind' decides how their roots move. Remove these elements from the assets."
            )
    return homes


def attach_robot(spec: mujoco.MjSpec, config: RobotConfig, where: str) -> Home:
    """Attach a robot at its base, as a mocap body if its base is drawn. Return the start pose of its keyframe."""
    assert config.asset is not None
    where = f"{where}: {config.key}"
    named = "keyframe" in config.model_fields_set
    child = _load_asset(config.asset, where)
    home = _take_home(child, config.name, config.keyframe if named else None, where)
    frame = spec.worldbody.add_frame(pos=config.base, quat=_rotation(config))
    if config.placing is None:
        attach(spec, child, config.name, frame, where)
        return home
    tops = child.worldbody.bodies
    moves = [joint for body in tops if body.parent.name == "world" for joint in body.joints if joint.type != FREE]
    root = attach(spec, child, config.name, frame, where, around=bool(moves))  # a mocap body cannot have joints
    make_kind(spec, root, config.name, "fixture", where)
    return home


def check_assets(config: SceneConfig) -> None:
    """Compile the assets of a scene one by one.

    Raises:
        MeshError, SceneFileError: The first asset that cannot be compiled. The message names its key.
    """
    for name, part in {**config.all_robots, **config.objects}.items():
        if part.asset is None:
            continue
        alone = mujoco.MjSpec()
        if isinstance(part, RobotConfig):
            attach_robot(alone, part, config.where)
        else:
            attach_object(alone, name, part, config.where)
        compile_spec(alone, f"{config.where}: {config.key(name)}.asset")


def _load_asset(asset: str, where: str) -> mujoco.MjSpec:
    if not SHIPPED_NAME.fullmatch(asset):
        if Path(asset).is_dir():
            raise SceneFileError(
                f"{where}: '{asset}' is a folder and should be an MJCF or URDF file. To use each file of the folder as "
                f"a variant, write '{asset}/*'."
            )
        whole = load_model(Path(asset), where)
        spec = whole.copy()  # without elements that name a missing one. MuJoCo leaves them out silently
        if any(len(getattr(spec, kind)) < len(getattr(whole, kind)) for kind in _OF_JOINTS):
            try:
                compile_spec(whole, where)
            except SceneFileError as error:  # also in parts of a larger model
                warnings.warn(ModelWarning(f"{error}. The scene leaves out such elements."), stacklevel=2)
        return spec
    assets = shipped("assets", ".xml")
    check_names("asset", [asset], where, assets)
    return load_model(assets[asset], where)


def stand_at_keyframe(spec: mujoco.MjSpec, keyframe: str, where: str) -> None:
    """Move the poses of mocap bodies from a keyframe into the bodies.

    A keyframe stores the poses in the order of the mocap bodies. This order changes whenever a body becomes a mocap
    body. A pose in the body is independent of the order, and is the start pose as well.

    Raises:
        SceneKeyError: The keyframe has a nan, which MuJoCo would silently replace when another model is attached.
    """
    bodies = [body for body in spec.bodies if body.mocap]
    wanted = next((key for key in spec.keys if key.name == keyframe), None)
    if wanted is None:
        return
    if any(np.isnan(getattr(wanted, name)).any() for name in ("qpos", "qvel", "act", "ctrl", "mpos", "mquat")):
        check_numbers(compile_spec(spec, where), where.removesuffix(": model"))
    if not bodies:
        return
    model = compile_spec(spec, where)
    key = model.key(keyframe)
    for body in bodies:
        i = int(model.body_mocapid[body.id])
        pos, quat = np.reshape(key.mpos, (-1, 3))[i], np.reshape(key.mquat, (-1, 4))[i]
        if np.allclose(pos, model.body_pos[body.id]) and np.allclose(quat, model.body_quat[body.id]):
            continue
        body.pos, body.quat, body.alt.type = pos.copy(), quat.copy(), mujoco.mjtOrientation.mjORIENTATION_QUAT
        if body.frame is not None:
            body.set_frame(spec.worldbody.add_frame())
    wanted.mpos, wanted.mquat = [], []


def _take_home(child: mujoco.MjSpec, name: str, keyframe: str | None, where: str) -> Home:
    """Return the start pose of an asset from the named keyframe, or from 'home' if it exists.

    All keyframes of the asset are deleted, because they would become keyframes of the scene.
    """
    for kind, elements in (("joint", child.joints), ("actuator", child.actuators)):
        for i, element in enumerate(elements):
            element.name = element.name or f"{kind}{i}"
    keys = {key.name: key for key in child.keys}
    if keyframe is not None:
        check_names("keyframe", [keyframe], where, keys)
    home = Home({}, {})
    if (wanted := keyframe or "home") in keys:
        stand_at_keyframe(child, wanted, where)
        model = compile_spec(child, where)
        key = model.key(wanted)
        for joint in (model.joint(i) for i in range(model.njnt)):
            if joint.type[0] != FREE:
                adr = model.jnt_qposadr[joint.id]
                home.qpos[f"{name}/{joint.name}"] = key.qpos[adr : adr + len(joint.qpos0)].tolist()
        for i in range(model.nu):
            home.ctrl[f"{name}/{model.actuator(i).name}"] = float(key.ctrl[i])
    for key in keys.values():
        child.delete(key)
    return home


def attach_frame(spec: mujoco.MjSpec, config: RobotConfig) -> None:
    """Add an empty body in place of the base of a robot whose `in_scene` is false."""
    mocap = config.placing is not None
    spec.worldbody.add_body(name=config.name, pos=config.base, quat=_rotation(config), mocap=mocap)


def _rotation(config: RobotConfig) -> np.ndarray:
    return of_angles(np.radians([config.roll, config.pitch, config.yaw]))


def attach(
    spec: mujoco.MjSpec, child: mujoco.MjSpec, name: str, frame: mujoco.MjsFrame, where: str, *, around: bool = False
) -> mujoco.MjsBody:
    """Attach an asset as one body called `name`: the asset's only body, or if it has several, a body around them.

    Args:
        spec: The scene.
        child: The asset.
        name: The body's name, and the prefix of all names inside.
        frame: The frame of the scene to attach the asset to.
        where: The text at the beginning of error messages.
        around: Make a new body, even around a single body.
    """
    world = child.worldbody
    tops = [body for body in world.bodies if body.parent.name == "world"]
    planes = [geom for geom in world.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
    if not tops and len(planes) == len(world.geoms):
        raise SceneKeyError(
            f"{where}: an asset should have a body below its worldbody, found none. 'sceniris-gym import' makes "
            "assets from meshes and USD files."
        )
    loose = [body.name for body in tops if body.mocap or any(joint.type == FREE for joint in body.joints)]
    if len(tops) > 1 and loose:
        jointed = {body.name: sum(joint.type != FREE for joint in body.find_all("joint")) for body in tops}
        robot = max(jointed, key=jointed.__getitem__)
        things = ", ".join(f"{body}: {{on: floor}}" for body in loose if body != robot)
        use = f"robot: {{in_model: {robot}}}, objects: {{{things}}}"
        raise SceneKeyError(
            f"{where}: an asset should have one body below its worldbody, or several without freejoints and mocap. "
            f"This asset has {[body.name for body in tops]}, of which {loose} move freely. Use the file as the scene's "
            f"'model', and its bodies by name: {use if jointed[robot] else f'objects.{name}: {{body: {loose[0]}}}'}."
        )
    for element in (*(world.geoms if tops else planes), *world.sites, *world.cameras, *world.lights):
        child.delete(element)  # the asset's floor and lights for viewing
    child.option, child.visual = spec.option, spec.visual  # the scene's options apply, and MuJoCo would warn of others
    for size in _SIZES:
        setattr(child, size, getattr(spec, size))
    _keep_files_apart(spec, child, name)
    if len(tops) == 1 and not around:
        tops[0].name = tops[0].name or "/"  # differs from all names of the asset, unlike `name`
        old = tops[0].name
        spec.attach(child, prefix=f"{name}/", frame=frame)
        root = spec.body(f"{name}/{old}")
        _rename(spec, root, name)
        return root
    root = spec.worldbody.add_body(name=name, pos=frame.pos, quat=frame.quat)
    spec.attach(child, prefix=f"{name}/", frame=root.add_frame())
    return root


def _keep_files_apart(spec: mujoco.MjSpec, child: mujoco.MjSpec, name: str) -> None:
    """Rename each file of an asset if the scene has a file of the same name, in any folder, with other contents."""
    present = {file.rpartition("/")[2]: content for file, content in spec.assets.items()}
    taken = {f for f, content in child.assets.items() if present.get(f.rpartition("/")[2], content) != content}
    for element in (*child.meshes, *child.hfields, *child.skins, *child.textures) if taken else ():
        if element.file in taken:
            file = renamed(element.file, f"{name}_")
            child.assets[file] = child.assets[element.file]
            element.file = file
    for file in taken:
        del child.assets[file]


def _rename(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str) -> None:
    """Rename a body and all references to it, because MuJoCo stores references as names."""
    old, body.name = body.name, name
    references = [
        *((exclude, field) for exclude in spec.excludes for field in ("bodyname1", "bodyname2")),
        *((eq, field) for eq in spec.equalities if eq.objtype in _BODIES for field in ("name1", "name2")),
        *((sensor, "objname") for sensor in spec.sensors if sensor.objtype in _BODIES),
        *((sensor, "refname") for sensor in spec.sensors if sensor.reftype in _BODIES),
        *((eye, "targetbody") for eye in (*spec.cameras, *spec.lights)),
        *((act, "target") for act in spec.actuators if act.trntype == mujoco.mjtTrn.mjTRN_BODY),
    ]
    for element, field in references:
        if getattr(element, field) == old:
            setattr(element, field, name)


def make_kind(spec: mujoco.MjSpec, root: mujoco.MjsBody, name: str, kind: str, where: str) -> None:
    """Turn a body below the world into the root of an object of the kind `kind`.

    For the kind 'free', the body gets a freejoint. For 'fixture' and 'marker', it becomes a mocap body. For 'static',
    it keeps its joints except a freejoint.

    Raises:
        SceneKeyError: The body has joints that an object of this kind cannot have.
    """
    joints = list(root.joints)
    if kind == "free":
        others = [joint.name for joint in joints if joint.type != FREE]
        if others:
            raise SceneKeyError(
                f"{where}: a 'free' object should have a freejoint or no joint at its root, but '{name}' has {others}. "
                "Make it a 'fixture' or 'static', or move the joint to a child body."
            )
        (joints[0] if joints else root.add_freejoint()).name = f"{name}/free"
        return
    for joint in joints:
        if kind != "static" or joint.type == FREE:
            spec.delete(joint)
    if kind in ("fixture", "marker"):
        root.mocap = True  # mocap_pos moves it per world, but moving body_pos would leave static geoms behind
    if kind == "marker":  # no contacts, by bits or by explicit pairs
        geoms = root.find_all("geom")
        for geom in geoms:
            geom.contype = geom.conaffinity = 0
        own = {geom.name for geom in geoms if geom.name}
        for pair in [pair for pair in spec.pairs if own & {pair.geomname1, pair.geomname2}]:
            spec.delete(pair)


def compile_spec(spec: mujoco.MjSpec, where: str) -> mujoco.MjModel:
    """Compile a specification.

    Raises:
        MeshError: A mesh is too small or too flat to have volume.
        SceneFileError: MuJoCo rejects the specification for another reason.
    """
    try:
        return spec.compile()
    except ValueError as error:
        text = " ".join(str(error).removeprefix("Error: ").split())
        if "vertices" in text:
            raise MeshError(
                f"{where}: MuJoCo cannot use a mesh: {text}. It should be a closed surface.", "refused"
            ) from None
        raise SceneFileError(f"{where}: MuJoCo cannot compile the model: {text}") from None
