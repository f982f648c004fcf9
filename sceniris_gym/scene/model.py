"""A scene as a MuJoCo model: composed of assets, the user's own, or both."""

from __future__ import annotations

import fnmatch
import hashlib
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR, ROBOT
from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import MeshError, NotSupportedError, SceneFileError, SceneKeyError, UnknownNameError
from sceniris_gym.reach.map import map_file
from sceniris_gym.scene import assemble, backdrop
from sceniris_gym.scene.couplings import Coupling, driven_by, follow, joint_couplings, turned_round
from sceniris_gym.scene.number_check import check_numbers
from sceniris_gym.scene.parking import add_parking_ground, has_parking_ground

HOME = "home"


@dataclass(frozen=True, eq=False)
class SceneModel:
    """A scene as a MuJoCo model, on the host.

    Attributes:
        config: The scene as written by the user.
        spec: The editable model; `spec.to_zip` writes it so that stock MuJoCo opens it.
        mjm: The compiled model; its keyframe 'home' is the start pose.
        bodies: Root body id of every object by its name, and of the robot as 'robot'.
        home_qpos: Start pose, shape (nq,), with free objects where the model has them, and joints that an equality ties
            to others where it has them.
        home_ctrl: Controls of the start pose, shape (nu,).
        hash: Identifies the scene: equal for equal scenes, in every process; 16 hexadecimal digits.
        couplings: Joints that follow others, drivers before what follows them; a joint that is drawn by its name drives
            the one that it would follow, where that one is not drawn and the coupling is a straight line.
    """

    config: SceneConfig
    spec: mujoco.MjSpec
    mjm: mujoco.MjModel
    bodies: dict[str, int]
    home_qpos: np.ndarray
    home_ctrl: np.ndarray
    hash: str
    couplings: tuple[Coupling, ...] = ()

    def support_body(self, parent: str, where: str) -> int:
        """Return the body id of a support: 0 for 'floor', else of 'object' or 'object/body'.

        Raises:
            UnknownNameError: The object has no such body.
        """
        if parent == FLOOR:
            return 0
        name, _, part = parent.partition("/")
        if not part:
            return self.bodies[name]
        parts = self.parts(name)
        if part not in parts:
            raise UnknownNameError("body", parent, where, [name, *(f"{name}/{p}" for p in parts)])
        return parts[part]

    def parts(self, name: str) -> dict[str, int]:
        """Return the bodies inside an object, without its root: id by the name inside the object."""
        return {_local(self.mjm.body(i).name, name): i for i in self.subtree(name) if i != self.bodies[name]}

    def subtree(self, name: str) -> list[int]:
        """Return the ids of an object's root body and of all bodies below it, in ascending order."""
        return subtree(self.mjm, self.bodies[name])

    def joints(self, name: str) -> dict[str, int]:
        """Return the joints inside an object or the robot, except a root's freejoint: id by the name inside it."""
        prefix = self._prefix(name)
        joints = np.flatnonzero(np.isin(self.mjm.jnt_bodyid, self.subtree(name))).tolist()
        return {
            _local(self.mjm.joint(i).name, prefix): i
            for i in joints
            if self.mjm.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE
        }

    def joint_configs(self, name: str) -> dict[int, JointConfig]:
        """Return how the joints of an object, or of the robot, are drawn: by joint id, in ascending order.

        A joint's own name takes precedence over a pattern, and an earlier pattern over a later one. Joints that nothing
        names are left out; they keep their home position. So are joints that follow others, which patterns pass over.

        Raises:
            UnknownNameError: A name or a pattern that no joint matches.
            SceneKeyError: A fraction of a joint without limits, values or a start pose with noise outside its limits,
                or a joint that follows another one.
            NotSupportedError: A ball joint.
        """
        part = self.config.robot if name == ROBOT else self.config.objects[name]
        where = f"{self.config.where}: {ROBOT if name == ROBOT else f'objects.{name}'}.joints"
        joints = self.joints(name)
        found: dict[int, JointConfig] = {}
        words = part.joints if part is not None else {}
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
        found = []
        for name in self.bodies:
            part = self.config.robot if name == ROBOT else self.config.objects[name]
            joints = self.joints(name)
            found += [joints[word] for word in (part.joints if part is not None else {}) if word in joints]
        return found

    def moving_joints(self, name: str) -> set[int]:
        """Return the joints that differ between layouts because those of an object, or of the robot, are drawn.

        These are the drawn ones and all that follow them.
        """
        drawn = self.joint_configs(name)
        return {*drawn, *(c.follower for c in driven_by(self.couplings, drawn))}

    def _prefix(self, name: str) -> str:
        robot = self.config.robot
        return assemble.asset_name(robot.asset) if name == ROBOT and robot is not None else name

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
            values = np.atleast_1d([]) if getattr(config, word) is None else np.atleast_1d(getattr(config, word))
            if np.any(values < low - 1e-6) or np.any(values > high + 1e-6):
                raise SceneKeyError(
                    f"{where}.{word}: {getattr(config, word)} should be inside the limits of '{name}', "
                    f"[{low:g}, {high:g}]."
                )


def subtree(mjm: mujoco.MjModel, root: int) -> list[int]:
    """Return the ids of a body and of all bodies below it, in ascending order."""
    end = root + 1  # bodies are numbered depth first: what is below one follows it
    while end < mjm.nbody and mjm.body_parentid[end] >= root:
        end += 1
    return list(range(root, end))


def build_model(config: SceneConfig) -> SceneModel:
    """Compose the model of a scene and compile it.

    The root body of an object has the object's name, everything inside it is `name/...`; inside the robot the
    prefix is the name of the robot's asset. A free object's joint is `name/free`. Fixtures and markers are mocap
    bodies. The user's own `model` keeps its names and options; objects without an asset are bodies of it.

    Raises:
        SceneFileError: A file is missing, or MuJoCo cannot read or compile it.
        UnknownNameError: An asset, body, joint or keyframe that does not exist.
        SceneKeyError: An object that cannot be of its kind; joint values outside the joint's limits; a joint that an
            equality ties to another one, and that is drawn itself or tied twice.
        CycleError: Joints that equalities tie to each other in a cycle.
    """
    spec, homes = _assemble(config)
    try:
        mjm = assemble.compile_spec(spec, config.where)
    except (MeshError, SceneFileError):
        assemble.check_assets(config)  # names the asset, if it is one
        raise
    home_qpos, home_ctrl = _home(mjm, homes)
    couplings = joint_couplings(mjm, config.where)
    given_qpos = home_qpos.copy()
    follow(couplings, home_qpos)
    if config.floor is not None:
        center, extent = np.array([0.0, 0.0, 0.25]), max(config.floor.size)
    else:
        center, extent = mjm.stat.center.copy(), float(mjm.stat.extent)
    if spec.camera(backdrop.OVERVIEW) is None:
        facing = None if config.robot is None else float(np.radians(config.robot.yaw))
        backdrop.add_camera(spec, center, extent, facing)
    if config.groups and not has_parking_ground(mjm, len(config.objects), config.where):
        spec.stat.center, spec.stat.extent = mjm.stat.center, mjm.stat.extent  # of the scene without its parking ground
        add_parking_ground(spec, len(config.objects))
    if spec.key(HOME) is None:
        spec.add_key(name=HOME, qpos=home_qpos, ctrl=home_ctrl)
    elif not np.array_equal(home_qpos, given_qpos):
        spec.key(HOME).qpos = home_qpos
    mjm = assemble.compile_spec(spec, config.where)
    check_numbers(mjm, config.where)

    bodies = {name: mjm.body(name).id for name in config.objects}
    if config.robot is not None:
        bodies[ROBOT] = mjm.body(assemble.asset_name(config.robot.asset)).id
    scene = SceneModel(config, spec, mjm, bodies, home_qpos, home_ctrl, _hash(config, spec), couplings)
    scene = replace(scene, couplings=turned_round(mjm, couplings, scene.named_joints()))
    for name, part in config.objects.items():
        if part.support is not None:
            scene.support_body(part.support.parent, f"{config.where}: objects.{name}.{part.support.word}")
    for name in bodies:
        scene.joint_configs(name)
    return scene


def _assemble(config: SceneConfig) -> tuple[mujoco.MjSpec, list[assemble.Home]]:
    if config.model is not None:
        spec = assemble.load_mjcf(config.model, f"{config.where}: model")
        assemble.stand_at_keyframe(spec, HOME, f"{config.where}: model")
    else:
        spec = mujoco.MjSpec()
        backdrop.set_options(spec)
    spec.modelname = "scene"
    homes = []
    if config.floor is not None and spec.geom(FLOOR) is None:
        backdrop.add_floor(spec, config.floor)
    if not spec.lights:
        backdrop.add_light(spec)
    if config.robot is not None:
        if assemble.asset_name(config.robot.asset) in config.objects:
            raise SceneKeyError(
                f"{config.where}: objects.{assemble.asset_name(config.robot.asset)}: the name of the robot's asset is "
                "taken by the robot. Give the object another name."
            )
        homes.append(assemble.attach_robot(spec, config.robot, config.where))
    for name, part in config.objects.items():
        if part.asset is None and (part.kind != "marker" or spec.body(name) is not None):
            assemble.adopt_body(spec, name, part, config.where)
        elif spec.body(name) is not None:
            raise SceneKeyError(f"{config.where}: objects.{name}: the model has a body of this name already.")
        else:
            homes.append(assemble.attach_object(spec, name, part, config.where))
    return spec, homes


def _home(mjm: mujoco.MjModel, homes: list[assemble.Home]) -> tuple[np.ndarray, np.ndarray]:
    has_home = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_KEY, HOME) >= 0
    qpos = mjm.key(HOME).qpos.copy() if has_home else mjm.qpos0.copy()
    ctrl = mjm.key(HOME).ctrl.copy() if has_home else np.zeros(mjm.nu)
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
    return (qpos if np.abs(exact - qpos).max(initial=0.0) < 1e-6 else exact), ctrl


def _hash(config: SceneConfig, spec: mujoco.MjSpec) -> str:
    digest = hashlib.sha256(config.canonical().encode())
    digest.update(spec.to_xml().encode())
    for file in sorted(spec.assets):
        digest.update(file.encode())
        digest.update(spec.assets[file])
    if config.robot is not None and any(part.reachable for part in config.objects.values()):
        path = map_file(config.robot.asset)  # what the arm reaches shapes the layouts, too
        digest.update(path.read_bytes() if path is not None else b"")
    return digest.hexdigest()[:16]


def _local(name: str, prefix: str) -> str:
    return name.removeprefix(f"{prefix}/")
