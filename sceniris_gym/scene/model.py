"""A scene as a MuJoCo model: composed of assets, the user's own model, or both."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NoReturn

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR, ROBOT
from sceniris_gym.config.loader import JOINT_FORMS
from sceniris_gym.config.member_names import split_support, variant_of
from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.device.fixed import RefusesOldNames
from sceniris_gym.errors import NotSupportedError, SceneKeyError, SceneMismatchError, UnknownNameError
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.reach.arm import fixed_base
from sceniris_gym.scene.couplings import Coupling, driven_by
from sceniris_gym.scene.draws import LEAST, MOST, FieldDraw, at_ends
from sceniris_gym.scene.shared_parts import SharedPart, shared_parts
from sceniris_gym.scene.support import Support, static_supports, subtree


@dataclass(frozen=True, eq=False)
class SceneModel(RefusesOldNames):
    """A scene as a MuJoCo model, on the host.

    Attributes:
        config: The scene as written by the user.
        spec: The editable model. `spec.to_zip` writes it for stock MuJoCo. None if the scene uses a MjModel, which
            cannot be edited.
        mjm: The compiled model.
        bodies: Root body id of every object and robot, by name. A single robot is 'robot'.
        keyframe: The keyframe of `mjm` that is the start pose, -1 if the start pose is `qpos0`.
        home_qpos: Start pose, shape (nq,). Free objects have their poses from the model. Joints that follow others have
            the positions given by the equalities.
        home_ctrl: Controls of the start pose, shape (nu,).
        hash: Identifies the scene by 16 hexadecimal digits, equal for equal scenes in every process.
        tcps: Name of the tool centre point's site for each robot. The site need not exist.
        couplings: Joints that follow others, drivers first. A linear coupling is reversed if the scene draws its
            follower by name, but not its driver.
        apart: Robot with `in_scene: false` -> a separate model with only this robot. There its name is 'robot'.
        draws: The physics and appearance that resets draw.
        shared: The scene in which all variants of an object share a body, None if no object has variants.
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
    draws: tuple[FieldDraw, ...] = ()
    shared: SceneModel | None = None

    @property
    def sim(self) -> SceneModel:
        """The scene for the simulation. One body, with the object's name, stands for all variants of an object."""
        return self if self.shared is None else self.shared

    @cached_property
    def sim_bodies(self) -> np.ndarray:
        """For each body of this model, the id of the body of `sim` that simulates it, shape (nbody,)."""
        sim, found = self.sim, np.arange(self.mjm.nbody)
        owner = {
            body: sim.mjm.body(part.name_of(name)).id
            for name in self.config.variants
            for part in self.shared_parts(name)
            for body in part.bodies
            if body >= 0
        }
        others = np.setdiff1d(np.arange(sim.mjm.nbody), list(owner.values()))  # they keep their order
        alone = np.setdiff1d(found, list(owner))
        found[alone] = others[: len(alone)]
        found[list(owner)] = list(owner.values())
        return found

    def sim_joint(self, joint: int) -> int:
        """Return the id of the joint of `sim` that simulates a joint of this model."""
        body = int(self.mjm.jnt_bodyid[joint])
        return joint - int(self.mjm.body_jntadr[body]) + int(self.sim.mjm.body_jntadr[self.sim_bodies[body]])

    def check_hash(self, found: str, what: str, cure: str) -> None:
        """Check that data belong to this scene. An empty hash fits any scene.

        Args:
            found: The hash of the data's scene.
            what: The name of the data. The error message begins with it.
            cure: The last sentence of the message.

        Raises:
            SceneMismatchError: The data belong to another scene.
        """
        if found not in ("", self.hash):
            text = f"belongs to scene {found}, but '{self.config.name}' is now scene {self.hash}. {cure}"
            raise SceneMismatchError(f"{what} {text}")

    def home_of(self, robot: str) -> tuple[SceneModel, str]:
        """Return the model that contains a robot, and the robot's name in that model: this model, or one of `apart`."""
        return (self.apart[robot], ROBOT) if robot in self.apart else (self, robot)

    def support(self, parent: str, where: str) -> Support:
        """Return the support that is called `parent` in a scene file.

        The name is 'floor', an object, 'object/body', or a static geom or body of the user's model.

        Raises:
            UnknownNameError: The scene has no support of that name.
        """
        if parent == FLOOR and self.config.floor is not None:
            return Support(0, is_floor=True)
        name, part = split_support(parent, self.bodies)
        parts = {**self.parts(name), "": self.bodies[name]} if name in self.bodies else {}
        if part in parts:
            return Support(parts[part], name)
        still = static_supports(self.mjm, self.bodies) if self.config.model is not None else {}
        if parent in still:
            return still[parent]
        of_object = [name, *(f"{name}/{p}" for p in parts if p)] if name in self.bodies else self.bodies
        raise UnknownNameError("body" if len(parts) > 1 else "support", parent, where, [*of_object, *still])

    def parts(self, name: str) -> dict[str, int]:
        """Return the ids of the bodies inside an object, except its root, by their names inside the object."""
        found = self._inside(name, np.arange(self.mjm.nbody), self.mjm.body)
        return {local: i for local, i in found.items() if i != self.bodies[name]}

    def subtree(self, name: str) -> list[int]:
        """Return the ids of an object's root body and of all bodies below it, in ascending order."""
        return subtree(self.mjm, self.bodies[name])

    def moving(self, robot: str) -> list[int]:
        """Return the bodies of a robot that its joints may move: all but the base."""
        base = fixed_base(self.mjm, self.bodies[robot])
        return [body for body in self.subtree(robot) if body != base]

    @cached_property
    def owners(self) -> dict[int, str]:
        """The object or robot of each body, by body id. Other bodies are left out."""
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
        """The model with all drawn physics at its minimum."""
        return at_ends(self.mjm, self.draws, **LEAST)

    @cached_property
    def most(self) -> mujoco.MjModel:
        """The model with all drawn physics at its maximum."""
        return at_ends(self.mjm, self.draws, **MOST)

    @cached_property
    def contact_rules(self) -> ContactRules:
        """MuJoCo's contact rules for the model."""
        return ContactRules(self.mjm, "physics")

    def around(self, support: Support) -> list[int]:
        """Return the bodies that may cover a support: all bodies of its owner. If it has no owner, return its body."""
        return [support.body] if support.owner is None else self.subtree(support.owner)

    def joints(self, name: str) -> dict[str, int]:
        """Return the ids of the joints inside an object or a robot, except freejoints, by their names inside it.

        The joint of each of the object's `parts` has the name of the part, too. If several joints match, it is the
        first one. A part hides a joint of the same name.
        """
        every, config = self._inside(name, self.mjm.jnt_bodyid, self.mjm.joint), self.config.objects.get(name)
        joints = {local: i for local, i in every.items() if self.mjm.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE}
        if config is None or not config.parts:
            return joints
        bodies = {
            self.mjm.body(self.mjm.jnt_bodyid[i]).name.removeprefix(self._prefix(name)): i for i in joints.values()
        }
        found = {local: i for local, i in joints.items() if local not in config.parts}
        for part in config.parts:
            word = config.joint_of(part, variant_of(name))
            ids = [of[local] for of in (joints, bodies) for local in of if word and fnmatch.fnmatch(local, word)]
            if ids:
                found[part] = ids[0]
        return found

    def check_parts(self) -> None:
        """Check that each name and pattern in `parts` matches a joint of one of its variants.

        Raises:
            UnknownNameError: A name or a pattern matches no joint.
        """
        users: dict[tuple[str, str, str], list[str]] = {}
        for name, config in self.config.objects.items():
            for part in config.parts:
                if word := config.joint_of(part, variant_of(name)):
                    users.setdefault((self.config.owners.get(name, name), part, word), []).append(name)
        for (owner, part, word), names in users.items():
            known = {joint for name in names for joint in self.joints(name)}
            if part not in known:
                raise UnknownNameError("joint", word, f"{self.config.where}: objects.{owner}.parts.{part}", known)

    def joints_named(self, name: str, joint: str) -> dict[str, int | None]:
        """Return the id of a joint or a part in each variant of an object, by their full names, or only in `name`.

        It is None if a variant lacks the joint.
        """
        return {one: self.joints(one).get(joint) for one in self.config.variants.get(name, (name,))}

    def shared_parts(self, name: str) -> list[SharedPart]:
        """Return the bodies that the variants of an object share in the simulation."""
        members = self.config.variants[name]
        named = {
            int(self.mjm.jnt_bodyid[joint]): part
            for member in members
            for part in self.config.objects[member].parts
            if (joint := self.joints(member).get(part)) is not None
        }
        return shared_parts(self.mjm, [self.bodies[member] for member in members], named)

    def sites(self, name: str) -> dict[str, int]:
        """Return the ids of the sites inside an object or a robot, by their names inside it."""
        return {local: i for local, i in self._inside(name, self.mjm.site_bodyid, self.mjm.site).items() if local}

    def _inside(self, name: str, bodies: np.ndarray, element: Callable[[int], Any]) -> dict[str, int]:
        """Return ids of elements inside an object or robot, by local name. `bodies` has the body of each element."""
        prefix = self._prefix(name)
        ids = np.flatnonzero(np.isin(bodies, self.subtree(name))).tolist()
        return {element(i).name.removeprefix(prefix): i for i in ids}

    def joint_configs(self, name: str) -> dict[int, JointConfig]:
        """Return joint id -> its config, for each drawn joint of an object or a robot, in ascending order of the ids.

        A joint's own name takes precedence over a pattern, and an earlier pattern over a later pattern. Joints without
        a matching name or pattern are left out, and keep their home position. Patterns skip joints that follow others.

        Raises:
            UnknownNameError: A name or a pattern matches no joint, and none of another variant of the same object.
            SceneKeyError: A joint follows another joint or has two keys, or `check_joint` rejects its config.
            NotSupportedError: A joint is a ball joint.
        """
        where = f"{self.config.where}: {self.config.key(name)}.joints"
        return self.resolve_joints(name, self._joint_words(name), where)

    def resolve_joints(self, name: str, words: Mapping[str, JointConfig], where: str) -> dict[int, JointConfig]:
        """Return joint id -> its config, as `joint_configs` does, but with `words` as the names and patterns."""
        joints, following = self.joints(name), {c.follower: c for c in self.couplings}
        found: dict[int, JointConfig] = {}
        for word in sorted(words, key=lambda word: word not in joints):  # names first, then patterns as written
            ids = [joints[joint] for joint in ([word] if word in joints else fnmatch.filter(joints, word))]
            if not ids:
                self._check_known(self.config.owners.get(name, name), word, where)
            if word in joints and ids[0] in found:  # a part and its joint's own name
                raise SceneKeyError(f"{where}: '{word}' and another key are the same joint of '{name}'. Leave out one.")
            if ids and all(i in following for i in ids):
                refuse_follower(self._joint_name, following[ids[0]], f"{where}.{word}")
            for i in ids:
                if i not in following and i not in found:
                    found[i] = words[word]
                    check_joint(self.mjm, self.home_qpos, i, self._joint_name(i), words[word], f"{where}.{word}")
        return dict(sorted(found.items()))

    def _check_known(self, name: str, word: str, where: str) -> None:
        """Check that a joint of an object, or of any of its variants, has a name or matches a pattern."""
        members = self.config.variants.get(name, (name,))
        if not any(fnmatch.filter(self.joints(member), word) for member in members):
            raise UnknownNameError("joint", word, where, {joint for one in members for joint in self.joints(one)})

    def named_joints(self) -> list[int]:
        """Return the joints that the scene draws by name, not by a pattern."""
        inside = [(self.joints(name), self._joint_words(name)) for name in self.bodies]
        return [joints[word] for joints, words in inside for word in words if word in joints]

    def moving_joints(self, name: str) -> set[int]:
        """Return the drawn joints of an object or a robot, and all joints that follow them."""
        drawn = self.joint_configs(name)
        return {*drawn, *(c.follower for c in driven_by(self.couplings, drawn))}

    def _joint_name(self, joint: int) -> str:
        """Return the name of a joint as the scene file has it."""
        return self.config.written(self.mjm.joint(joint).name)

    def _joint_words(self, name: str) -> dict[str, JointConfig]:
        return (self.config.all_robots.get(name) or self.config.objects[name]).joints

    def _prefix(self, name: str) -> str:
        """Return the prefix of names in an object or robot, such as 'can/': its name, or the prefix of its body."""
        if name in self.config.all_robots:
            return self.config.all_robots[name].prefix
        body = self.config.objects[name].body
        return f"{name}/" if body is None else body[: body.rfind("/") + 1]


def refuse_follower(name_of: Callable[[int], str], coupling: Coupling, where: str) -> NoReturn:
    """Raise an error, because the scene draws a joint that follows another joint or is held.

    Raises:
        SceneKeyError: Always. The message names the equality.
    """
    name = name_of(coupling.follower)
    if coupling.driver is None:
        raise SceneKeyError(
            f"{where}: {coupling.label} holds joint '{name}' at {coupling.offset:g} (m or rad), so it cannot be "
            "drawn. Draw other joints, or remove the equality."
        )
    driver = name_of(coupling.driver)
    raise SceneKeyError(
        f"{where}: {coupling.label} makes '{name}' follow '{driver}', so it cannot be drawn. Draw '{driver}' instead, "
        "or remove the equality."
    )


def check_joint(
    mjm: mujoco.MjModel, home_qpos: np.ndarray, joint: int, name: str, config: JointConfig, where: str
) -> None:
    """Check that a joint can be drawn as `config` requires.

    Raises:
        NotSupportedError: The joint is a ball joint.
        SceneKeyError: `config` gives a `fraction` for a joint without limits, or values outside the joint's limits. Or
            it gives `noise` or `noise_norm`, although the start pose is outside the limits.
    """
    if mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
        raise NotSupportedError(f"{where}: '{name}' is a ball joint, which cannot be drawn yet. Leave out this key.")
    if not mjm.jnt_limited[joint]:
        if config.fraction is not None:
            raise SceneKeyError(f"{where}.fraction: '{name}' has no limits. Give a 'range' in m or rad.")
        return
    low, high = mjm.jnt_range[joint]
    start = home_qpos[mjm.jnt_qposadr[joint]]
    if config.most_noise is not None and not low - 1e-6 <= start <= high + 1e-6:
        raise SceneKeyError(
            f"{where}.{config.given(JOINT_FORMS)[0]}: '{name}' starts at {start:g}, which should be inside its limits "
            f"[{low:g}, {high:g}]. Correct the start pose, or give a 'range'."
        )
    for word in ("range", "choice", "value"):
        values = getattr(config, word)
        if values is not None and (np.less(values, low - 1e-6) | np.greater(values, high + 1e-6)).any():
            raise SceneKeyError(
                f"{where}.{word}: {values} should be inside the limits of '{name}', [{low:g}, {high:g}]."
            )
