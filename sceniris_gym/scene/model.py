"""A scene as a MuJoCo model: composed of assets, the user's own, or both."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NoReturn

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR, ROBOT
from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError, SceneMismatchError, UnknownNameError
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.scene.couplings import Coupling, driven_by
from sceniris_gym.scene.draws import LEAST, MOST, FieldDraw, at_ends
from sceniris_gym.scene.support import Support, static_supports, subtree


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
        owner = {self.bodies[member]: self.shared.bodies[name] for member, name in self.config.owners.items()}
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

    def check_hash(self, found: str, what: str, cure: str) -> None:
        """Check that something is of this scene; an empty hash is of any.

        Args:
            found: The hash of its scene.
            what: Its name, with which the error begins.
            cure: See `mismatch`.

        Raises:
            SceneMismatchError: It is of another scene.
        """
        if found not in ("", self.hash):
            raise SceneMismatchError(f"{what} {self.mismatch(found, cure)}")

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
    def home(self) -> mujoco.MjData:
        """The model at the start pose, with its kinematics and centres of mass."""
        data = mujoco.MjData(self.mjm)
        data.qpos[:] = self.home_qpos
        mujoco.mj_kinematics(self.mjm, data)
        mujoco.mj_comPos(self.mjm, data)
        return data

    @cached_property
    def least(self) -> mujoco.MjModel:
        """The model with all physics that resets draw at its least."""
        return at_ends(self.mjm, self.draws, **LEAST)

    @cached_property
    def most(self) -> mujoco.MjModel:
        """The model with all physics that resets draw at its most."""
        return at_ends(self.mjm, self.draws, **MOST)

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
        where = f"{self.config.where}: {self.config.key(name)}.joints"
        return self.resolve_joints(name, self._joint_words(name), where)

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
                refuse_follower(self.mjm, following[joints[matching[0]]], f"{where}.{word}")
            for joint in (joint for joint in matching if joints[joint] not in following):
                if joints[joint] not in found:
                    found[joints[joint]] = words[word]
                    check_joint(self.mjm, self.home_qpos, joints[joint], words[word], f"{where}.{word}")
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
            return robot.prefix.removesuffix("/")
        body = self.config.objects[name].body
        return name if body is None else body.rpartition("/")[0]


def refuse_follower(mjm: mujoco.MjModel, coupling: Coupling, where: str) -> NoReturn:
    """Refuse to draw a joint that follows another one.

    Raises:
        SceneKeyError: Always; it names the equality.
    """
    name = mjm.joint(coupling.follower).name
    if coupling.driver is None:
        raise SceneKeyError(
            f"{where}: {coupling.label} holds '{name}' at {coupling.offset:g}, so it cannot be drawn. Leave it out, or "
            "take the equality out."
        )
    raise SceneKeyError(
        f"{where}: {coupling.label} makes '{name}' follow '{mjm.joint(coupling.driver).name}', so it cannot be drawn "
        "itself. Draw that joint instead, or take the equality out."
    )


def check_joint(mjm: mujoco.MjModel, home_qpos: np.ndarray, joint: int, config: JointConfig, where: str) -> None:
    """Check that a joint can be drawn as a scene file says.

    Raises:
        NotSupportedError: A ball joint.
        SceneKeyError: A fraction of a joint without limits, or values or a start pose with noise outside its limits.
    """
    name = mjm.joint(joint).name
    if mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
        raise NotSupportedError(f"{where}: '{name}' is a ball joint, which is not supported yet. Leave it out.")
    if not mjm.jnt_limited[joint]:
        if config.fraction is not None:
            raise SceneKeyError(f"{where}.fraction: '{name}' has no limits. Give a 'range' in m or rad.")
        return
    low, high = mjm.jnt_range[joint]
    start = home_qpos[mjm.jnt_qposadr[joint]]
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
