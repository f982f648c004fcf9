"""`build_model`: the model of a scene, composed of assets, the user's own model, or both."""

import copy
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR, reading
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.validation import check_variant_has_asset
from sceniris_gym.errors import ArgumentError, MeshError, SceneFileError, SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.geometry.rotations import matrix, quaternion
from sceniris_gym.progress import tell
from sceniris_gym.scene import assemble, backdrop, number_check, parking, tcp
from sceniris_gym.scene.adopt import HOME, adopt_body, check_additions, check_bodies
from sceniris_gym.scene.assemble import Home, Loaded
from sceniris_gym.scene.couplings import follow, joint_couplings, reversed_for
from sceniris_gym.scene.draws import field_draws, simple_bodies
from sceniris_gym.scene.identity import scene_hash
from sceniris_gym.scene.level_bodies import level_bodies
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.model_files import load_model
from sceniris_gym.scene.overview import FOVY, Overview, camera_axes
from sceniris_gym.scene.variants import SharedBodies, check_variants, without_broken

_Home = tuple[np.ndarray, np.ndarray]
"""The start pose, shape (nq,), and its controls, shape (nu,)."""
SceneLike = str | Path | Mapping | SceneConfig | SceneModel
"""A shipped scene's name, a path, a mapping, a SceneConfig, or a SceneModel."""


def build_model(scene: SceneLike, overrides: Mapping[str, Any] | None = None) -> SceneModel:
    """Compose the model of a scene and compile it.

    The root body of an object has the object's name, and all elements inside are `name/...`. The elements of a single
    `robot` have the name of its asset as their prefix, and elements of a robot in `robots` have its key. A free
    object's joint is `name/free`. Fixtures and markers are mocap bodies. If the scene has a `model`, the model keeps
    its names and options, and objects without an asset are bodies of this model. A model in memory is copied, and its
    bodies are not changed. If files of a folder cannot be variants of an object, these files are left out, with a
    ModelWarning that names them.

    Args:
        scene: A shipped scene's name, a path, a mapping, a SceneConfig, or a SceneModel, which is returned.
        overrides: Parts of the scene to replace, by dotted keys: {"objects.apple.clearance": 0.01}.

    Raises:
        ArgumentError: `scene` is a SceneModel, and `overrides` are given.
        SceneFileError: A file is missing, or MuJoCo cannot read or compile it.
        UnknownNameError: An asset, body, joint or keyframe does not exist.
        SceneKeyError: An object cannot be of its kind. Joint values are outside the joint's limits. A joint that
            follows another by an equality is drawn, or follows two joints. Joints follow each other in a cycle. The
            scene would add parts to a MjModel, or change bodies of a model in memory.
    """
    if isinstance(scene, SceneModel):
        if overrides:
            raise ArgumentError("overrides should be None for a SceneModel. Give a SceneConfig to change its keys.")
        return scene
    config = SceneConfig.load(scene, overrides)
    for name in config.owners:
        check_variant_has_asset(config, name, config.where)
    if config.any_supports:
        carriers = build_carriers(config)
        config = config.with_bodies({each: level_bodies(carriers, *each) for each in config.any_supports})
    if isinstance(config.model, mujoco.MjModel):
        return _taken(config)
    try:
        return _with_shared_bodies(config)
    except ScenirisError:
        sound = without_broken(config)
        if sound is config:
            raise
    return _with_shared_bodies(sound)


def build_variants(config: SceneConfig, simulated: SceneConfig) -> SceneModel:
    """Return a scene with variants, for a user who has compiled both of its MjModels.

    Args:
        config: The scene with all variants. They are bodies of its MjModel, by their names.
        simulated: The simulated scene, whose MjModel has one body for all variants of an object.
    """
    scene = _taken(config)
    return replace(scene, shared=replace(build_model(simulated), hash=scene.hash, apart=scene.apart))


def build_carriers(config: SceneConfig) -> SceneModel:
    """Build a scene of only those objects whose level bodies are the supports `{any: NAME}` of another scene."""
    return _built(config.carriers(), {})


def _with_shared_bodies(config: SceneConfig) -> SceneModel:
    """Build a scene from files or a MjSpec. If objects have variants, also build the scene for the simulation."""
    scene = _built(config, loaded := {})
    if not config.variants:
        return scene
    assert scene.spec is not None
    check_variants(scene.spec, scene.mjm, config.variants, config.where)
    return replace(scene, shared=_built(config, loaded, scene))


def _built(config: SceneConfig, loaded: Loaded, full: SceneModel | None = None) -> SceneModel:
    """Build a scene from files or a MjSpec, with a body for each variant. `loaded` collects assets.

    With `full`, the result of an earlier call, build the scene for the simulation instead: variants share one body.
    """
    shared = None if full is None else SharedBodies(full)
    spec, homes = _assemble(config, loaded, shared)
    if full is not None:
        config = config.with_shared_objects()
    try:
        mjm = assemble.compile_spec(spec, config.where)
    except (MeshError, SceneFileError):
        assemble.check_assets(config)  # names the asset if an asset fails
        raise
    number_check.check_numbers(mjm, config.where)
    if config.has_model_in_memory:
        check_bodies(mjm, config)
    qpos, ctrl = _home(mjm, homes, config)
    given_qpos = qpos.copy()
    follow(joint_couplings(mjm, config.where), qpos)
    if spec.camera(backdrop.OVERVIEW) is None:
        eye = None if full is None else full.mjm.camera(backdrop.OVERVIEW)
        pose = Overview(config, mjm, qpos).camera() if eye is None else (eye.pos, matrix(eye.quat))
        backdrop.add_camera(spec, *pose, FOVY)
    nslot = len(config.objects if full is None else full.config.objects)
    parks = config.presence.draws if full is None else full.config.presence.parks
    if parks and not parking.has_parking_ground(mjm, nslot, config.where):
        spec.stat.center, spec.stat.extent = mjm.stat.center, mjm.stat.extent  # the values without the parking ground
        parking.add_parking_ground(spec, nslot)
    for name in simple_bodies(config, mjm):
        spec.body(name).simple = False
    keyframe = config.home or HOME
    if spec.key(keyframe) is None:
        spec.add_key(name=keyframe, qpos=qpos, ctrl=ctrl)
    elif not np.array_equal(qpos, given_qpos):
        spec.key(keyframe).qpos = qpos
    tcps = _tcps(spec, mjm, qpos, config)
    mjm = assemble.compile_spec(spec, config.where) if shared is None else shared.compile(spec, mjm)
    return _scene(config, spec, mjm, (qpos, ctrl), tcps, full)


def _taken(config: SceneConfig) -> SceneModel:
    """Return the scene of a MjModel. The scene uses a copy, so the user's model stays unchanged."""
    check_additions(config)
    check_bodies(config.model, config)
    number_check.check_numbers(config.model, config.where)
    mjm = copy.copy(config.model)
    qpos, ctrl = _home(mjm, [], config)
    key = _keyframe(mjm, config)
    if key >= 0:  # mocap bodies take their poses from the keyframe, as in a model from a file
        mocap = np.flatnonzero(mjm.body_mocapid >= 0)
        mjm.body_pos[mocap] = mjm.key_mpos[key].reshape(-1, 3)[mjm.body_mocapid[mocap]]
        mjm.body_quat[mocap] = mjm.key_mquat[key].reshape(-1, 4)[mjm.body_mocapid[mocap]]
    follow(joint_couplings(mjm, config.where), qpos)
    return _scene(config, None, mjm, (qpos, ctrl), _tcps(None, mjm, qpos, config))


def _scene(
    config: SceneConfig,
    spec: mujoco.MjSpec | None,
    mjm: mujoco.MjModel,
    home: _Home,
    tcps: dict[str, str],
    full: SceneModel | None = None,
) -> SceneModel:
    """Check all names that a scene refers to in its compiled model, and return the scene. `full` is as in `_built`."""
    bodies = {name: mjm.body(part.body or name).id for name, part in config.objects.items()}
    bodies |= {name: mjm.body(robot.name).id for name, robot in config.all_robots.items()}
    if full is None:
        identity = scene_hash(config, mjm, home[0])
        apart = {name: _apart(robot, config) for name, robot in config.all_robots.items() if not robot.in_scene}
    else:
        identity, apart = full.hash, full.apart
    key, draws = _keyframe(mjm, config), field_draws(config, mjm, bodies)
    couplings = joint_couplings(mjm, config.where)
    scene = SceneModel(config, spec, mjm, bodies, key, *home, identity, tcps, couplings, apart, draws)
    scene = replace(scene, couplings=reversed_for(mjm, couplings, scene.named_joints()))
    for name, part in config.parts.items():
        if part.support is not None:
            scene.support(part.support.parent, f"{config.where}: {config.key(name)}.{part.support.word}")
    scene.check_parts()
    for name in bodies:
        scene.joint_configs(name)
    return scene


def _apart(robot: RobotConfig, config: SceneConfig) -> SceneModel:
    """Return the model of a robot that is not in the scene."""
    words = [word for word in ("asset", "tcp", "map", "keyframe") if word in robot.model_fields_set]
    with reading(f"{config.where}: {robot.section}"):
        return build_model(SceneConfig(robot=RobotConfig(**{word: getattr(robot, word) for word in words})))


def _tcps(spec: mujoco.MjSpec | None, mjm: mujoco.MjModel, qpos: np.ndarray, config: SceneConfig) -> dict[str, str]:
    """Check that the robots' bodies exist, and return the name of each robot's tool centre point."""
    bodies, found = [mjm.body(i).name for i in range(1, mjm.nbody)], {}
    for name, robot in config.all_robots.items():
        if not robot.in_scene:
            continue
        if robot.name not in bodies:
            where = f"{config.where}: {robot.key}"
            raise UnknownNameError("body of the model", robot.name, where, filter(None, bodies))
        editable = None if robot.tcp is None and config.has_model_in_memory else spec
        found[name] = tcp.tcp_site(editable, mjm, qpos, robot, config.where)
    return found


def _assemble(config: SceneConfig, loaded: Loaded, shared: SharedBodies | None) -> tuple[mujoco.MjSpec, list[Home]]:
    if config.model is None:
        spec = mujoco.MjSpec()
        backdrop.set_options(spec)
    else:
        where = f"{config.where}: model"
        spec = config.model.copy() if config.has_model_in_memory else load_model(config.model, where)
        assemble.stand_at_keyframe(spec, config.home or HOME, where)
    spec.modelname = "scene"
    homes, owners = [], config.owners
    if config.floor is not None and spec.geom(FLOOR) is None:
        backdrop.add_floor(spec, config.floor)
    if not spec.lights:
        backdrop.add_light(spec)
    for robot in config.all_robots.values():
        if robot.name in config.objects:
            raise SceneKeyError(
                f"{config.where}: objects.{robot.name}: the asset of the scene's robot has the same name. "
                "Give the object another name."
            )
        if not robot.in_scene:
            assemble.attach_frame(spec, robot)
        elif robot.in_model is None:
            homes.append(assemble.attach_robot(spec, robot, config.where))
        elif robot.placing is not None and not config.has_model_in_memory:
            adopt_body(spec, robot.name, robot.placing, f"{config.where}: {robot.section}")
    for i, (name, part) in enumerate(config.objects.items()):
        tell("objects", i + 1, len(config.objects))
        if part.asset is None and (part.kind != "marker" or part.body is not None or spec.body(name) is not None):
            if not config.has_model_in_memory:  # `check_bodies` checks a model in memory after compilation
                adopt_body(spec, name, part, f"{config.where}: objects.{name}")
        elif spec.body(name) is not None:
            raise SceneKeyError(
                f"{config.where}: objects.{name}: the model has a body of this name already. Leave out the 'asset' to "
                "use that body, or give the object another name."
            )
        elif name not in owners:
            homes.append(assemble.attach_object(spec, name, part, config.where, loaded=loaded))
        elif name == (members := config.variants[owner := owners[name]])[-1]:
            if shared is not None:
                shared.add(spec, owner)
            parts = {member: config.objects[member] for member in members}
            homes += assemble.attach_variants(spec, owner, parts, config.where, loaded, bodies=shared is None)
    if shared is not None:
        shared.name_meshes(spec)
    add_cameras(spec, config)
    return spec, homes


def _keyframe(mjm: mujoco.MjModel, config: SceneConfig) -> int:
    """Return the id of the start pose's keyframe, -1 if the model has none."""
    return mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_KEY, config.home or HOME)


def _home(mjm: mujoco.MjModel, homes: list[Home], config: SceneConfig) -> _Home:
    """Return the start pose, shape (nq,), and its controls, shape (nu,)."""
    keyframe = _keyframe(mjm, config)
    if keyframe < 0 and config.home is not None:
        names = [mjm.key(i).name for i in range(mjm.nkey)]
        raise UnknownNameError("keyframe of the model", config.home, f"{config.where}: home", filter(None, names))
    qpos = mjm.key_qpos[keyframe].copy() if keyframe >= 0 else mjm.qpos0.copy()
    ctrl = mjm.key_ctrl[keyframe].copy() if keyframe >= 0 else np.zeros(mjm.nu)
    for home in homes:
        for joint, values in home.qpos.items():
            i = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_JOINT, joint)
            if i >= 0:  # a fixture loses the joints of its root
                adr = mjm.jnt_qposadr[i]
                qpos[adr : adr + len(values)] = values
        for actuator, value in home.ctrl.items():
            ctrl[mjm.actuator(actuator).id] = value
    # Quaternions of unit length up to rounding keep their bits.
    exact = qpos.copy()
    mujoco.mj_normalizeQuat(mjm, exact)
    return qpos if np.abs(exact - qpos).max(initial=0.0) < 1e-6 else exact, ctrl


def add_cameras(spec: mujoco.MjSpec, config: SceneConfig) -> None:
    """Add the cameras of a scene to a specification that has all its bodies.

    Raises:
        SceneKeyError: The model already has a camera with the name of a camera in `config`.
        UnknownNameError: The body that should carry a camera does not exist.
    """
    for name, camera in config.cameras.items():
        where = f"{config.where}: cameras.{name}"
        if spec.camera(name) is not None:
            raise SceneKeyError(f"{where}: the model has a camera of this name already. Give this camera another name.")
        carrier = spec.worldbody if camera.body is None else spec.body(_name_in_model(config, camera.body))
        if carrier is None and camera.body in config.variants:  # the shared body is made later
            carrier = spec.body(config.variants[camera.body][0])
        if carrier is None:
            bodies = [config.written(body.name) for body in spec.bodies if body.name not in ("", "world")]
            raise UnknownNameError("body", str(camera.body), f"{where}.body", bodies)
        quat = quaternion(camera_axes(camera.backward, camera.upward))
        carrier.add_camera(name=name, pos=camera.pos, quat=quat, fovy=camera.fovy)


def _name_in_model(config: SceneConfig, name: str) -> str:
    """Return the body's name in the model for a name in the scene: an object, a robot, or 'object/body'."""
    owner, _, part = name.partition("/")
    if owner in config.all_robots:
        robot = config.all_robots[owner]
        return f"{robot.prefix}{part}" if part else robot.name
    return config.objects[name].body or name if name in config.objects else name
