"""A scene as a MuJoCo model: composed of assets, the user's own, or both."""

from __future__ import annotations

import copy
import fnmatch
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR, ROBOT
from sceniris_gym.config.messages import reading
from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.variants import owners_of
from sceniris_gym.errors import (
    MeshError,
    NotSupportedError,
    SceneFileError,
    SceneKeyError,
    ScenirisError,
    UnknownNameError,
    check_type,
)
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.progress import tell
from sceniris_gym.scene import assemble, backdrop
from sceniris_gym.scene.adopt import HOME, adopt_body, check_additions, check_bodies
from sceniris_gym.scene.cameras import add_cameras
from sceniris_gym.scene.couplings import Coupling, driven_by, follow, joint_couplings, turned_round
from sceniris_gym.scene.draws import FieldDraw, field_draws, simple_bodies
from sceniris_gym.scene.identity import scene_hash
from sceniris_gym.scene.loadable import without_broken
from sceniris_gym.scene.model_files import load_model
from sceniris_gym.scene.number_check import check_numbers
from sceniris_gym.scene.overview import FOVY, Overview
from sceniris_gym.scene.parking import add_parking_ground, has_parking_ground
from sceniris_gym.scene.support import Support, static_supports, subtree
from sceniris_gym.scene.tcp import tcp_site
from sceniris_gym.scene.variants import SharedBodies, check_variants


@dataclass(frozen=True, eq=False)
class SceneModel:
    """A scene as a MuJoCo model, on the host.

    Attributes:
        config: The scene as written by the user.
        spec: The editable model; `spec.to_zip` writes it so that stock MuJoCo opens it. None if the scene is made from
            a MjModel, which cannot be edited.
        mjm: The compiled model.
        bodies: Root body id of every object by its name, and of every robot: the only one is 'robot'.
        keyframe: The keyframe of `mjm` that is the start pose; -1 if it has none and `qpos0` is.
        home_qpos: Start pose, shape (nq,): free objects have their poses of the model, and joints that follow others
            the positions that equalities give them.
        home_ctrl: Controls of the start pose, shape (nu,).
        hash: Identifies the scene: equal for equal scenes, in every process; 16 hexadecimal digits.
        tcps: Name of the site that is each robot's tool centre point, which need not exist.
        couplings: Joints that follow others, drivers first; a joint that is drawn by its name drives the one that it
            would follow, where that one is not drawn and the coupling is a straight line.
        apart: The robots that are not in the scene, each as a model of its own in which it is 'robot'.
        former_hash: Its hash in version 0.1.0, None where that is the same.
        draws: The physics and looks that resets draw.
        shared: The scene in which the variants of each object are one body, None if no object has variants.
    """

    config: SceneConfig
    spec: mujoco.MjSpec | None
    mjm: mujoco.MjModel
    bodies: dict[str, int]
    keyframe: int
    home_qpos: np.ndarray
    home_ctrl: np.ndarray
    hash: str
    tcps: Mapping[str, str] = field(default_factory=dict)
    couplings: tuple[Coupling, ...] = ()
    apart: Mapping[str, SceneModel] = field(default_factory=dict)
    former_hash: str | None = None
    draws: tuple[FieldDraw, ...] = ()
    shared: SceneModel | None = None

    @property
    def sim(self) -> SceneModel:
        """The scene as it is simulated: one body for all variants of an object, by the object's name."""
        return self if self.shared is None else self.shared

    @cached_property
    def sim_bodies(self) -> np.ndarray:
        """The body of `sim` that each body is simulated as, shape (nbody,)."""
        found = np.arange(self.mjm.nbody)
        if self.shared is None:
            return found
        objects = self.config.variants.items()
        owner = {self.bodies[member]: self.shared.bodies[name] for name, members in objects for member in members}
        others = np.setdiff1d(np.arange(self.shared.mjm.nbody), list(owner.values()))  # they keep their order
        alone = np.setdiff1d(found, list(owner))
        found[alone] = others[: len(alone)]
        found[list(owner)] = list(owner.values())
        return found

    def mismatch(self, found: str, cure: str) -> str:
        """Return the words of an error for something of another scene, or of this one before its layouts changed.

        Args:
            found: The hash of the scene that it is of.
            cure: The last sentence of the error if that is another scene.
        """
        if found == self.former_hash:
            return (
                "was made by version 0.1.0 or before, whose layouts of this scene differ. Its hash was "
                f"{found}, and is {self.hash}. Use that version, or make it anew."
            )
        return f"is of scene {found}, and this one is {self.hash}. {cure}"

    def home_of(self, robot: str) -> tuple[SceneModel, str]:
        """Return the model that a robot stands in, and its name there: this one, or one of its own."""
        return (self.apart[robot], ROBOT) if robot in self.apart else (self, robot)

    def support(self, parent: str, where: str) -> Support:
        """Return the support named 'floor', 'object' or 'object/body', or after a static geom or body of the model.

        Raises:
            UnknownNameError: There is nothing of that name.
        """
        if parent == FLOOR and self.config.floor is not None:
            return Support(0, is_floor=True)
        name, _, part = parent.partition("/")
        if name in self.bodies and not part:
            return Support(self.bodies[name], name)
        parts = self.parts(name) if name in self.bodies else {}
        if part in parts:
            return Support(parts[part], name)
        still = static_supports(self.mjm, self.bodies) if self.config.model is not None else {}
        if parent in still:
            return still[parent]
        of_object = [name, *(f"{name}/{p}" for p in parts)] if name in self.bodies else self.bodies
        raise UnknownNameError("body" if parts else "support", parent, where, [*of_object, *still])

    def parts(self, name: str) -> dict[str, int]:
        """Return the bodies inside an object, without its root: id by the name inside the object."""
        found = self._inside(name, np.arange(self.mjm.nbody), self.mjm.body)
        return {local: i for local, i in found.items() if i != self.bodies[name]}

    def subtree(self, name: str) -> list[int]:
        """Return the ids of an object's root body and of all bodies below it, in ascending order."""
        return subtree(self.mjm, self.bodies[name])

    @cached_property
    def owners(self) -> dict[int, str]:
        """The object or robot that each body belongs to, by body id; bodies of neither are left out."""
        return {body: name for name in self.bodies for body in self.subtree(name)}

    @cached_property
    def contact_rules(self) -> ContactRules:
        """MuJoCo's contact rules of the model."""
        return ContactRules(self.mjm, "physics")

    def around(self, support: Support) -> list[int]:
        """Return the bodies that may cover a support: those of the object that it is part of, or its own body."""
        return [support.body] if support.owner is None else self.subtree(support.owner)

    def joints(self, name: str) -> dict[str, int]:
        """Return the joints inside an object or the robot, except a root's freejoint: id by the name inside it."""
        found = self._inside(name, self.mjm.jnt_bodyid, self.mjm.joint)
        return {local: i for local, i in found.items() if self.mjm.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE}

    def sites(self, name: str) -> dict[str, int]:
        """Return the sites inside an object or the robot: id by the name inside it."""
        found = self._inside(name, self.mjm.site_bodyid, self.mjm.site)
        return {local: i for local, i in found.items() if local}

    def _inside(self, name: str, bodies: np.ndarray, element: Callable[[int], Any]) -> dict[str, int]:
        """Return the elements on bodies of an object or the robot, given the body of each: id by the name inside it."""
        prefix = f"{self._prefix(name)}/"
        ids = np.flatnonzero(np.isin(bodies, self.subtree(name))).tolist()
        return {element(i).name.removeprefix(prefix): i for i in ids}

    def joint_configs(self, name: str) -> dict[int, JointConfig]:
        """Return the joints of an object, or of the robot, that are drawn, with their words: by id, in ascending order.

        A joint's own name takes precedence over a pattern, and an earlier pattern over a later one. Joints that nothing
        names are left out, and keep their home position. Patterns skip joints that follow others.

        Raises:
            UnknownNameError: A name or a pattern that no joint matches.
            SceneKeyError: A fraction of a joint without limits, values or a start pose with noise outside its limits,
                or a joint that follows another one.
            NotSupportedError: A ball joint.
        """
        return self.resolve_joints(
            name, self._joint_words(name), f"{self.config.where}: {self.config.key(name)}.joints"
        )

    def resolve_joints(self, name: str, words: Mapping[str, JointConfig], where: str) -> dict[int, JointConfig]:
        """Return the joints of an object, or of the robot, that names and patterns choose; see `joint_configs`."""
        joints = self.joints(name)
        found: dict[int, JointConfig] = {}
        for word in sorted(words, key=lambda word: word not in joints):  # a stable sort: names first
            matching = [word] if word in joints else fnmatch.filter(joints, word)
            if not matching:
                raise UnknownNameError("joint", word, where, joints)
            following = {c.follower: c for c in self.couplings}
            if all(joints[joint] in following for joint in matching):
                self._refuse_follower(following[joints[matching[0]]], f"{where}.{word}")
            for joint in (joint for joint in matching if joints[joint] not in following):
                if joints[joint] not in found:
                    found[joints[joint]] = words[word]
                    self._check_joint(joints[joint], words[word], f"{where}.{word}")
        return dict(sorted(found.items()))

    def named_joints(self) -> list[int]:
        """Return the joints that the scene draws by their names, not by a pattern."""
        inside = [(self.joints(name), self._joint_words(name)) for name in self.bodies]
        return [joints[word] for joints, words in inside for word in words if word in joints]

    def moving_joints(self, name: str) -> set[int]:
        """Return the joints that differ between layouts because those of an object, or of the robot, are drawn.

        These are the drawn ones and all that follow them.
        """
        drawn = self.joint_configs(name)
        return {*drawn, *(c.follower for c in driven_by(self.couplings, drawn))}

    def _joint_words(self, name: str) -> dict[str, JointConfig]:
        robot = self.config.all_robots.get(name)
        return self.config.objects[name].joints if robot is None else robot.joints

    def _prefix(self, name: str) -> str:
        """Return the prefix of names inside an object: its own name, or that of the model that its body came with."""
        robot = self.config.all_robots.get(name)
        if robot is not None:
            return assemble.prefix_of(robot).removesuffix("/")
        body = self.config.objects[name].body
        return name if body is None else body.rpartition("/")[0]

    def _refuse_follower(self, coupling: Coupling, where: str) -> None:
        name = self.mjm.joint(coupling.follower).name
        if coupling.driver is None:
            raise SceneKeyError(
                f"{where}: {coupling.label} holds '{name}' at {coupling.offset:g}, so it cannot be drawn. Leave it "
                "out, or take the equality out."
            )
        raise SceneKeyError(
            f"{where}: {coupling.label} makes '{name}' follow '{self.mjm.joint(coupling.driver).name}', so it cannot "
            "be drawn itself. Draw that joint instead, or take the equality out."
        )

    def _check_joint(self, joint: int, config: JointConfig, where: str) -> None:
        name = self.mjm.joint(joint).name
        if self.mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
            raise NotSupportedError(f"{where}: '{name}' is a ball joint, which is not supported yet. Leave it out.")
        if not self.mjm.jnt_limited[joint]:
            if config.fraction is not None:
                raise SceneKeyError(f"{where}.fraction: '{name}' has no limits. Give a 'range' in m or rad.")
            return
        low, high = self.mjm.jnt_range[joint]
        start = self.home_qpos[self.mjm.jnt_qposadr[joint]]
        if config.noise is not None and not low - 1e-6 <= start <= high + 1e-6:
            raise SceneKeyError(
                f"{where}.noise: '{name}' starts at {start:g}, which should be inside its limits [{low:g}, {high:g}]. "
                "Correct the start pose, or give a 'range'."
            )
        for word in ("range", "choice", "value"):
            values = getattr(config, word)
            if values is not None and (np.less(values, low - 1e-6) | np.greater(values, high + 1e-6)).any():
                raise SceneKeyError(
                    f"{where}.{word}: {values} should be inside the limits of '{name}', [{low:g}, {high:g}]."
                )


def build_model(config: SceneConfig) -> SceneModel:
    """Compose the model of a scene and compile it.

    The root body of an object has the object's name, and everything inside it is `name/...`; inside `robot` the prefix
    is the name of the robot's asset, inside one of `robots` its name there. A free object's joint is `name/free`.
    Fixtures and markers are mocap bodies. The user's own `model` keeps its names and options; objects without an asset
    are bodies of it. A model in memory is copied, and its bodies are not changed. Files of a folder that cannot be
    variants of an object are left out, with a ModelWarning that names them.

    Raises:
        ArgumentTypeError: `config` is no SceneConfig, which `SceneConfig.load` makes.
        SceneFileError: A file is missing, or MuJoCo cannot read or compile it.
        UnknownNameError: An asset, body, joint or keyframe that does not exist.
        SceneKeyError: An object that cannot be of its kind; joint values outside the joint's limits; a joint that an
            equality ties to another one, and that is drawn itself or tied twice; anything that would have to be added
            to a MjModel, or changed in a model in memory.
        CycleError: Joints that equalities tie to each other in a cycle.
    """
    check_type(config, SceneConfig, "build_model: config")
    if isinstance(config.model, mujoco.MjModel):
        return _taken(config, config.model)
    try:
        return _with_shared_bodies(config)
    except ScenirisError:
        sound = without_broken(config)
        if sound is config:
            raise
    return _with_shared_bodies(sound)


def _with_shared_bodies(config: SceneConfig) -> SceneModel:
    """Return a scene from files or a MjSpec, with the scene as it is simulated if objects have variants."""
    scene = _built(config)
    if not config.variants:
        return scene
    assert scene.spec is not None
    check_variants(scene.spec, scene.mjm, config.variants, config.where)
    return replace(scene, shared=replace(_built(config, scene), hash=scene.hash, apart=scene.apart))


def _built(config: SceneConfig, full: SceneModel | None = None) -> SceneModel:
    """Return a scene from files or a MjSpec; if it is given as it is with all variants, as it is simulated."""
    shared = None if full is None else SharedBodies(full.mjm, config.variants, config.where)
    spec, homes = _assemble(config, shared)
    if full is not None:
        config = config.with_shared_objects()
    try:
        mjm = assemble.compile_spec(spec, config.where)
    except (MeshError, SceneFileError):
        assemble.check_assets(config)  # names the asset, if it is one
        raise
    check_numbers(mjm, config.where)
    if config.has_model_in_memory:
        check_bodies(mjm, config)
    qpos, ctrl = _home(mjm, homes, config)
    couplings = joint_couplings(mjm, config.where)
    given_qpos = qpos.copy()
    follow(couplings, qpos)
    if spec.camera(backdrop.OVERVIEW) is None:
        seen = Overview(config, mjm, qpos) if full is None else Overview(full.config, full.mjm, full.home_qpos)
        backdrop.add_camera(spec, *seen.camera(), FOVY)
    if config.groups and not has_parking_ground(mjm, len(config.objects), config.where):
        spec.stat.center, spec.stat.extent = mjm.stat.center, mjm.stat.extent  # those without the parking ground
        add_parking_ground(spec, len(config.objects))
    for name in simple_bodies(config, mjm):
        spec.body(name).simple = False
    keyframe = config.home or HOME
    if spec.key(keyframe) is None:
        spec.add_key(name=keyframe, qpos=qpos, ctrl=ctrl)
    elif not np.array_equal(qpos, given_qpos):
        spec.key(keyframe).qpos = qpos
    tcps = _tcps(spec, mjm, qpos, config)
    mjm = assemble.compile_spec(spec, config.where) if shared is None else shared.compile(spec, mjm)
    return _scene(config, spec, mjm, qpos, ctrl, couplings, tcps)


def _taken(config: SceneConfig, model: mujoco.MjModel) -> SceneModel:
    """Return the scene of a copy of a MjModel, which is not changed."""
    check_additions(config)
    check_bodies(model, config)
    check_numbers(model, config.where)
    mjm = copy.copy(model)
    qpos, ctrl = _home(mjm, [], config)
    key = _keyframe(mjm, config)
    if key >= 0:  # as in a model from a file, mocap bodies stand where the keyframe has them
        mocap = np.flatnonzero(mjm.body_mocapid >= 0)
        mjm.body_pos[mocap] = mjm.key_mpos[key].reshape(-1, 3)[mjm.body_mocapid[mocap]]
        mjm.body_quat[mocap] = mjm.key_mquat[key].reshape(-1, 4)[mjm.body_mocapid[mocap]]
    couplings = joint_couplings(mjm, config.where)
    follow(couplings, qpos)
    return _scene(config, None, mjm, qpos, ctrl, couplings, _tcps(None, mjm, qpos, config))


def _scene(
    config: SceneConfig,
    spec: mujoco.MjSpec | None,
    mjm: mujoco.MjModel,
    qpos: np.ndarray,
    ctrl: np.ndarray,
    couplings: tuple[Coupling, ...],
    tcps: Mapping[str, str],
) -> SceneModel:
    """Return the scene of a compiled model, after a look-up of all names that the scene refers to."""
    bodies = {name: mjm.body(part.body or name).id for name, part in config.objects.items()}
    bodies |= {name: mjm.body(robot.name).id for name, robot in config.all_robots.items()}
    identity, former = scene_hash(config, mjm, qpos)
    apart = {name: _apart(robot, config) for name, robot in config.all_robots.items() if not robot.in_scene}
    key, draws = _keyframe(mjm, config), field_draws(config, mjm, bodies)
    scene = SceneModel(config, spec, mjm, bodies, key, qpos, ctrl, identity, tcps, couplings, apart, former, draws)
    scene = replace(scene, couplings=turned_round(mjm, couplings, scene.named_joints()))
    for name, part in config.parts.items():
        if part.support is not None:
            scene.support(part.support.parent, f"{config.where}: {config.key(name)}.{part.support.word}")
    for name in bodies:
        scene.joint_configs(name)
    return scene


def _apart(robot: RobotConfig, config: SceneConfig) -> SceneModel:
    """Return the model of a robot that is not in the scene."""
    words = {word: getattr(robot, word) for word in ("asset", "model", "tcp", "map", "keyframe")}
    given = {word: value for word, value in words.items() if word in robot.model_fields_set}
    with reading(f"{config.where}: {robot.section}"):
        return build_model(SceneConfig(robot=RobotConfig(**given)))


def _tcps(spec: mujoco.MjSpec | None, mjm: mujoco.MjModel, qpos: np.ndarray, config: SceneConfig) -> dict[str, str]:
    """Return the names of the robots' tool centre points, after a check that robots of the model exist."""
    bodies, found = [mjm.body(i).name for i in range(1, mjm.nbody)], {}
    for name, robot in config.all_robots.items():
        if not robot.in_scene:
            continue
        if robot.name not in bodies:
            where = f"{config.where}: {robot.key}"
            raise UnknownNameError("body of the model", robot.name, where, filter(None, bodies))
        found[name] = tcp_site(spec, mjm, qpos, robot, assemble.prefix_of(robot), config.where)
    return found


def _assemble(config: SceneConfig, shared: SharedBodies | None = None) -> tuple[mujoco.MjSpec, list[assemble.Home]]:
    if config.model is None:
        spec = mujoco.MjSpec()
        backdrop.set_options(spec)
    else:
        where = f"{config.where}: model"
        in_memory = config.has_model_in_memory
        spec = config.model.copy() if in_memory else load_model(config.model, where)
        assemble.stand_at_keyframe(spec, config.home or HOME, where)
    spec.modelname = "scene"
    homes, variants = [], config.variants
    owners = owners_of(variants)
    if config.floor is not None and spec.geom(FLOOR) is None:
        backdrop.add_floor(spec, config.floor)
    if not spec.lights:
        backdrop.add_light(spec)
    for robot in config.all_robots.values():
        if robot.name in config.objects:
            raise SceneKeyError(
                f"{config.where}: objects.{robot.name}: the name of the robot's asset is taken by the robot. "
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
            if not config.has_model_in_memory:  # bodies of that one are checked once it is compiled
                adopt_body(spec, name, part, f"{config.where}: objects.{name}")
        elif spec.body(name) is not None:
            raise SceneKeyError(f"{config.where}: objects.{name}: the model has a body of this name already.")
        elif name not in owners:
            homes.append(assemble.attach_object(spec, name, part, config.where))
        elif name == (members := variants[owner := owners[name]])[-1]:
            if shared is not None:
                shared.add(spec, owner)
            parts = {member: config.objects[member] for member in members}
            homes += assemble.attach_variants(spec, owner, parts, config.where, bodies=shared is None)
    if shared is not None:
        shared.finish(spec)
    add_cameras(spec, config)
    return spec, homes


def _keyframe(mjm: mujoco.MjModel, config: SceneConfig) -> int:
    """Return the keyframe that is the start pose, -1 for none."""
    return mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_KEY, config.home or HOME)


def _home(mjm: mujoco.MjModel, homes: list[assemble.Home], config: SceneConfig) -> tuple[np.ndarray, np.ndarray]:
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
            if i >= 0:  # a fixture has lost the joints of its root
                adr = mjm.jnt_qposadr[i]
                qpos[adr : adr + len(values)] = values
        for actuator, value in home.ctrl.items():
            ctrl[mjm.actuator(actuator).id] = value
    exact = qpos.copy()
    mujoco.mj_normalizeQuat(mjm, exact)
    return qpos if np.abs(exact - qpos).max(initial=0.0) < 1e-6 else exact, ctrl
