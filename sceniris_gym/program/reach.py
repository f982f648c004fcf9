"""The reach targets of a scene: `reachable` on the host, and the arrays of `device_reach.Reach`."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import ArmError, MapError, ReachWarning, SceneKeyError, UnknownNameError
from sceniris_gym.geometry.ragged import ranges
from sceniris_gym.grasping.grasps import Graspable, GraspSet
from sceniris_gym.grasping.gripper import Gripper, carried
from sceniris_gym.program.couplings import coupling_arrays
from sceniris_gym.program.device import fill_struct
from sceniris_gym.program.device_reach import BASE, UNASKED, Reach
from sceniris_gym.program.notices import warn
from sceniris_gym.program.plan import PlacedObject, Plan, build_plan
from sceniris_gym.reach.arm import MAX_JOINTS, SerialArm
from sceniris_gym.reach.lookup import MapView
from sceniris_gym.reach.map import ReachMap, build_command, default_tier, why_not_map
from sceniris_gym.reach.solve import arm_view
from sceniris_gym.scene.identity import map_of
from sceniris_gym.scene.model import SceneModel


@dataclass(frozen=True)
class ReachTarget:
    """An object that should be reachable.

    Attributes:
        name: The object.
        number: Its index in placement order.
        arm: Which of `Reaching.arms` is to reach it.
        late: Whether it is placed before the base of that arm.
        tier: How thoroughly that is proven.
        grasp_set: Its grasps.
    """

    name: str
    number: int
    arm: int
    late: bool
    tier: Tier
    grasp_set: GraspSet


@dataclass(frozen=True)
class ReachingArm:
    """An arm that is to reach something.

    Attributes:
        robot: Name of its robot: 'robot' for the only one.
        arm: The arm.
        gripper: Its gripper.
        map: The arm's map, None if there is none.
        view: The same, with the reach targets of all arms, as device code takes it.
    """

    robot: str
    arm: SerialArm
    gripper: Gripper
    map: ReachMap | None
    view: Reach = field(repr=False)


@dataclass(frozen=True)
class Reaching:
    """The arms of a scene that are to reach something, and all reach targets.

    Attributes:
        arms: The arms, in the order of their robots in the scene file.
        targets: The reach targets, in placement order.
    """

    arms: tuple[ReachingArm, ...]
    targets: tuple[ReachTarget, ...]

    def arm_of(self, target: ReachTarget) -> ReachingArm:
        """The arm that is to reach a target."""
        return self.arms[target.arm]

    @property
    def njoint(self) -> int:
        """The most joints of an arm."""
        return max(len(one.arm.joints) for one in self.arms)

    @property
    def staged(self) -> bool:
        """Whether anything about a target is decided after placing: its tier, or its grasp from a base placed later."""
        return not all(target.tier.needs_map and not target.late for target in self.targets)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the targets, in the order of the columns of `Layouts.grasp`."""
        return tuple(target.name for target in self.targets)


def build_reaching(scene: SceneModel, plan: Plan, device: str) -> Reaching | None:
    """Find the arms of a scene, their maps and the grasps of their reach targets; None if there are no targets.

    Raises:
        ArmError: A robot is not a serial arm.
        UnknownNameError: A robot has no site `tcp`.
        MapError: A tier needs the arm's map, but there is none, or only that of another arm.
        GraspError: An object that the gripper cannot grasp.
        UnknownNameError: A chosen grasp that an object does not have.
    """
    config = scene.config
    wanted = [i for i, o in enumerate(plan.objects) if o.config is not None and o.config.reachable]
    by = {i: config.robot_for(plan.objects[i].name) for i in wanted}
    robots = [name for name in config.all_robots if name in by.values()]
    if not wanted:
        return None
    arms, targets = [], []
    for number, name in enumerate(robots):
        arm = robot_arm(scene, name)
        home, _ = scene.home_of(name)
        pieces = plan.pieces if home is scene else build_plan(home).pieces
        gripper = Gripper.from_model(home.mjm, arm, home.home_qpos, pieces)
        reach_map = load_map(arm, config.all_robots[name], config.where)
        own = [i for i in wanted if by[i] == name]
        base = next((i for i, o in enumerate(plan.objects) if o.name == name and o.config is not None), -1)
        tiers = _tiers(scene, config.all_robots[name], [plan.objects[i].name for i in own], arm, reach_map)
        for i, tier in zip(own, tiers, strict=True):
            grasps = _grasp_set(scene, plan, plan.objects[i], gripper)
            targets.append(ReachTarget(plan.objects[i].name, i, number, i < base, tier, grasps))
        arms.append(ReachingArm(name, arm, gripper, reach_map, empty_view(arm, reach_map, device)))
        arms[-1].view.base_obj = base if any(i < base for i in own) else UNASKED
    targets.sort(key=lambda target: target.number)
    shared = _arrays(plan, targets, [one.view.base_obj for one in arms if one.view.base_obj >= 0])
    for number, one in enumerate(arms):
        one.view.number, one.view.last = number, len(arms) - 1
        fill_struct(Reach, one.view, shared | _set_arm(scene, plan, one), device)
    return Reaching(tuple(arms), tuple(targets))


def _grasp_set(scene: SceneModel, plan: Plan, o: PlacedObject, gripper: Gripper) -> GraspSet:
    assert o.config is not None
    shape = Graspable(scene, o.name, plan.pieces, plan.home)
    return shape.grasp_set(o.variants, o.config.drawn_orientation.kind == "any", gripper, o.config.grasp)


def _set_arm(scene: SceneModel, plan: Plan, one: ReachingArm) -> dict[str, np.ndarray]:
    """Set the plain fields of an arm's view, and return those of its arrays that differ between arms."""
    view, gripper, present = one.view, one.gripper, one.robot not in scene.apart
    hand = sorted(carried(scene.mjm, one.arm)) if present else []
    view.base_body = scene.bodies[one.robot]
    view.mapped = one.map is not None
    view.gap_closed, view.gap_open = gripper.closed, gripper.opening
    if present:
        view.hand_pos, view.hand_quat = _in_tcp(plan.home, one.arm, hand[0])
    driver, follower, coef = coupling_arrays(gripper.couplings)
    return {
        "arm_qposadr": one.arm.qposadr if present else np.zeros(0, int),
        "arm_body": np.array(scene.subtree(one.robot)[1:], int),
        "hand_body": np.array(hand, int),
        "grip_qposadr": gripper.qposadr,
        "grip_closed": gripper.closed_qpos,
        "grip_open": gripper.open_qpos,
        "follow_driveradr": driver,
        "follow_qposadr": follower,
        "follow_coef": coef,
    }


def empty_view(arm: SerialArm, reach_map: ReachMap | None, device: str) -> Reach:
    """What device code sees of an arm and its map; the other fields are not set."""
    view = Reach()
    view.map = MapView() if reach_map is None else reach_map.view(device)
    view.arm = arm_view(arm, device)
    return view


def robot_arm(scene: SceneModel, name: str = ROBOT) -> SerialArm:
    """The arm of a robot of a scene: from its root body to its tool centre point.

    Raises:
        ArmError: It is not a serial arm.
        UnknownNameError: The robot has no site `tcp`, and the scene names no other.
    """
    robot = scene.config.all_robots[name]
    where = f"{scene.config.where}: {robot.key}"
    home, name = scene.home_of(name)
    try:
        return SerialArm.from_model(home.mjm, home.config.all_robots[name].name, home.tcps[name])
    except ArmError as error:
        raise ArmError(f"{where}: {error}") from None
    except UnknownNameError as error:
        if robot.tcp is not None:
            raise UnknownNameError(error.kind, error.name, f"{where}: {error.where}", error.valid) from None
        where += ": 'tcp' should name the tool centre point, a site or a body"
        prefix, inside = f"{robot.name}/", [home.mjm.body(body).name for body in home.subtree(name)]
        own = [site for site in error.valid if site.startswith(prefix)] + inside
        valid = list(dict.fromkeys(word.removeprefix(prefix) for word in own))
        raise UnknownNameError(error.kind, error.name.removeprefix(prefix), where, valid) from None


def load_map(arm: SerialArm, robot: RobotConfig, where: str) -> ReachMap | None:
    """The map of an arm: the one that the scene names, or that of a shipped asset; None if there is none.

    Raises:
        MapError: It is not a map of this arm, or a damaged one; begins with `where`.
    """
    path = map_of(robot)
    if path is None:
        return None
    try:
        return ReachMap.load(path, arm, f"Build it: {build_command(robot.file or robot.name, _said(robot), path)}.")
    except MapError as error:
        raise MapError(f"{where}: {robot.key if robot.map is None else f'{robot.section}.map'}: {error}") from None


def _tiers(
    scene: SceneModel, robot: RobotConfig, names: list[str], arm: SerialArm, reach_map: ReachMap | None
) -> list[Tier]:
    """The tiers that decide for the targets of an arm: those asked for, or `ik` where its map would not be right."""
    where = scene.config.where
    words = {name: scene.config.objects[name].reachable for name in names}
    by_map = [name for name, word in words.items() if word is True or Tier.of(str(word)).needs_map]
    file, said = robot.file or robot.name, _said(robot)
    why = why_not_map(arm, reach_map, file, said)
    asked = [f"objects.{name}.reachable" for name in by_map if words[name] is not True]
    if asked and reach_map is None and arm.no_map is None:
        raise MapError(
            f"{where}: {asked[0]}: there is no map of the arm '{file}'. Build it with "
            f"'{build_command(file, said)}' and name "
            "it as the robot's 'map', or ask for 'ik', which needs none."
        )
    if why is not None and asked:
        warn(ReachWarning(f"{where}: {', '.join(asked)}: {why}, so 'ik' decides."), stacklevel=2)
    default = default_tier(arm, reach_map)
    tiers = [
        default if word is True or (name in by_map and why) else Tier.of(str(word)) for name, word in words.items()
    ]
    solved = [name for name, tier in zip(names, tiers, strict=True) if not tier.needs_map]
    if solved and not robot.in_scene:
        instead = "Build that" if reach_map is not None and reach_map.coarse else "Ask for 'map'"
        raise SceneKeyError(
            f"{where}: objects.{solved[0]}.reachable: 'ik' and 'clear' pose the arm, which has 'in_scene: false'"
            f"{'' if why is None else f', and {why}'}. {instead}, or put the robot into the scene."
        )
    return tiers


def _said(robot: RobotConfig) -> str:
    """What `sceniris-gym reach` is to be told of an arm beside its file."""
    words = robot.model_dump(mode="json", exclude_unset=True).get("tcp")
    if words is None:
        return ""
    return f"--set 'robot.tcp={words['site'] if words.get('site') == words.get('body') else json.dumps(words)}'"


def _in_tcp(home: mujoco.MjData, arm: SerialArm, body: int) -> tuple[wp.vec3, wp.vec4]:
    """The pose of a body that moves with the TCP, in the TCP's frame."""
    turn, quat = np.zeros(4), np.zeros(4)
    mujoco.mju_mat2Quat(turn, home.site_xmat[arm.tcp_site])
    mujoco.mju_negQuat(turn, turn.copy())
    mujoco.mju_mulQuat(quat, turn, home.xquat[body])
    pos = home.site_xmat[arm.tcp_site].reshape(3, 3).T @ (home.xpos[body] - home.site_xpos[arm.tcp_site])
    return wp.vec3(*pos), wp.vec4(*quat)


def _arrays(plan: Plan, targets: list[ReachTarget], bases: list[int]) -> dict[str, np.ndarray]:
    grasps, adr, num = ranges(t.grasp_set.grasps for t in targets)
    objects = [plan.objects[t.number] for t in targets]
    numbers = np.full(len(plan.objects), UNASKED)
    numbers[[t.number for t in targets]] = np.arange(len(targets))
    numbers[bases] = BASE
    spans = np.concatenate([np.zeros((0, 2), int), *_spans(plan.objects, targets, adr)])
    rows = len(targets)
    return {
        "obj_reach": numbers,
        "variant_graspadr": spans[:, 0],
        "variant_graspnum": spans[:, 1],
        "reach_obj": np.array([t.number for t in targets], int),
        "reach_slot": np.array([plan.slots.index(t.name) for t in targets], int),
        "reach_arm": np.array([t.arm for t in targets], int),
        "reach_late": np.array([t.late for t in targets], int),
        "reach_tier": np.array([t.tier for t in targets], int),
        "reach_least": np.array([t.tier.least_verdict for t in targets], int),
        "reach_below": np.array([o.ground is not None for o in objects], int),
        "reach_graspadr": adr,
        "reach_graspnum": num,
        "grasp_body": np.array([g.body for g in grasps], int),
        "grasp_pos": np.reshape([g.pos for g in grasps], (-1, 3)),
        "grasp_quat": np.reshape([g.quat for g in grasps], (-1, 4)),
        "grasp_opening": np.array([g.opening for g in grasps], float),
        "bank_grasp": np.zeros((0, rows)),
        "bank_grasp_qpos": np.zeros((0, rows, MAX_JOINTS)),
        "bank_pregrasp_qpos": np.zeros((0, rows, MAX_JOINTS)),
    }


def _spans(objects: list[PlacedObject], targets: list[ReachTarget], adr: np.ndarray) -> list[np.ndarray]:
    """(address, number) of the grasps of every variant of every object; none for other objects than reach targets."""
    wanted = {t.number: (t.grasp_set.spans, int(first)) for t, first in zip(targets, adr, strict=True)}
    none = np.zeros(2, int)
    return [
        np.array(wanted[i][0]) + [wanted[i][1], 0] if i in wanted else np.tile(none, (len(o.variants), 1))
        for i, o in enumerate(objects)
    ]
