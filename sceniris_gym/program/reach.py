"""The reach targets of a scene: `reachable` on the host, and the arrays of `device_reach.Reach`."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.errors import ArmError, MapError, ReachWarning, UnknownNameError
from sceniris_gym.geometry.ragged import ranges
from sceniris_gym.grasping.grasps import Graspable, GraspSet
from sceniris_gym.grasping.gripper import Gripper, carried
from sceniris_gym.program.couplings import coupling_arrays
from sceniris_gym.program.device import fill_struct
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.notices import warn
from sceniris_gym.program.plan import PlacedObject, Plan
from sceniris_gym.reach.arm import MAX_JOINTS, SerialArm
from sceniris_gym.reach.lookup import MapView
from sceniris_gym.reach.map import ReachMap, build_command, default_tier, why_not_map
from sceniris_gym.reach.solve import arm_view
from sceniris_gym.reach.tier import Tier
from sceniris_gym.scene.identity import map_of
from sceniris_gym.scene.model import SceneModel


@dataclass(frozen=True)
class ReachTarget:
    """An object that should be reachable.

    Attributes:
        name: The object.
        number: Its index in placement order.
        tier: How thoroughly that is proven.
        grasp_set: Its grasps.
    """

    name: str
    number: int
    tier: Tier
    grasp_set: GraspSet


@dataclass(frozen=True)
class Reaching:
    """The arm of a scene and all its reach targets.

    Attributes:
        arm: The arm.
        gripper: Its gripper.
        map: The arm's map, None if there is none.
        targets: The reach targets, in placement order.
        view: The same as device code takes it.
    """

    arm: SerialArm
    gripper: Gripper
    map: ReachMap | None
    targets: tuple[ReachTarget, ...]
    view: Reach = field(repr=False)

    @property
    def staged(self) -> bool:
        """Whether the tier of any target is decided after placing."""
        return not all(target.tier.needs_map for target in self.targets)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the targets, in the order of the columns of `Layouts.grasp`."""
        return tuple(target.name for target in self.targets)


def build_reaching(scene: SceneModel, plan: Plan, device: str) -> Reaching | None:
    """Find the arm of a scene, its map and the grasps of its reach targets; None if there are no targets.

    Raises:
        ArmError: The robot is not a serial arm.
        UnknownNameError: The robot has no site `tcp`.
        MapError: A tier needs the arm's map, but there is none, or only that of another arm.
        GraspError: An object that the gripper cannot grasp.
    """
    wanted = [i for i, o in enumerate(plan.objects) if o.config is not None and o.config.reachable]
    if not wanted:
        return None
    robot = scene.config.robot
    assert robot is not None
    arm = robot_arm(scene)
    gripper = Gripper.from_model(scene.mjm, arm, scene.home_qpos, plan.pieces)
    reach_map = load_map(arm, robot, scene.config.where)
    targets = []
    for i, tier in zip(wanted, _tiers(scene, [plan.objects[i].name for i in wanted], arm, reach_map), strict=True):
        o = plan.objects[i]
        assert o.config is not None
        shape = Graspable(scene, o.name, plan.pieces, plan.home)
        targets.append(
            ReachTarget(o.name, i, tier, shape.grasp_set(o.variants, o.config.drawn_orientation.kind == "any", gripper))
        )
    view = empty_view(arm, reach_map, device)
    view.base_body = scene.bodies[ROBOT]
    view.mapped = int(reach_map is not None)
    view.gap_closed, view.gap_open = gripper.closed, gripper.opening
    hand = sorted(carried(scene.mjm, arm))
    view.hand_pos, view.hand_quat = _in_tcp(plan.home, arm, hand[0])
    arrays = _arrays(plan, targets, gripper) | {
        "arm_qposadr": arm.qposadr,
        "arm_body": np.array(scene.subtree(ROBOT)[1:], int),
        "hand_body": np.array(hand, int),
    }
    fill_struct(Reach, view, arrays, device)
    return Reaching(arm, gripper, reach_map, tuple(targets), view)


def empty_view(arm: SerialArm, reach_map: ReachMap | None, device: str) -> Reach:
    """What device code sees of an arm and its map; the other fields are not set."""
    view = Reach()
    view.map = MapView() if reach_map is None else reach_map.view(device)
    view.arm = arm_view(arm, device)
    return view


def robot_arm(scene: SceneModel) -> SerialArm:
    """The arm of a scene's robot: from its root body to its tool centre point.

    Raises:
        ArmError: It is not a serial arm.
        UnknownNameError: The robot has no site `tcp`, and the scene names no other.
    """
    robot = scene.config.robot
    assert robot is not None
    where = f"{scene.config.where}: {robot.key}"
    try:
        return SerialArm.from_model(scene.mjm, robot.name, scene.tcp)
    except ArmError as error:
        raise ArmError(f"{where}: {error}") from None
    except UnknownNameError as error:
        raise UnknownNameError(error.kind, error.name, f"{where}: {error.where}", error.valid) from None


def load_map(arm: SerialArm, robot: RobotConfig, where: str) -> ReachMap | None:
    """The map of an arm: the one that the scene names, or that of a shipped asset; None if there is none.

    Raises:
        MapError: It is not a map of this arm, or a damaged one; begins with `where`.
    """
    path = map_of(robot)
    if path is None:
        return None
    try:
        return ReachMap.load(path, arm, f"Build it again: {build_command(robot.file or robot.name, _said(robot))}.")
    except MapError as error:
        raise MapError(f"{where}: {robot.key if robot.map is None else 'robot.map'}: {error}") from None


def _tiers(scene: SceneModel, names: list[str], arm: SerialArm, reach_map: ReachMap | None) -> list[Tier]:
    """The tiers that decide: those asked for, or `ik` where the arm's map would not be right."""
    robot, where = scene.config.robot, scene.config.where
    assert robot is not None
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
    return [default if word is True or (name in by_map and why) else Tier.of(str(word)) for name, word in words.items()]


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


def _arrays(plan: Plan, targets: list[ReachTarget], gripper: Gripper) -> dict[str, np.ndarray]:
    grasps, adr, num = ranges(t.grasp_set.grasps for t in targets)
    objects = [plan.objects[t.number] for t in targets]
    numbers = np.full(len(plan.objects), -1)
    numbers[[t.number for t in targets]] = np.arange(len(targets))
    spans = np.concatenate([np.zeros((0, 2), int), *_spans(plan.objects, targets, adr)])
    rows = len(targets)
    driver, follower, coef = coupling_arrays(gripper.couplings)
    return {
        "obj_reach": numbers,
        "variant_graspadr": spans[:, 0],
        "variant_graspnum": spans[:, 1],
        "reach_obj": np.array([t.number for t in targets], int),
        "reach_slot": np.array([plan.slots.index(t.name) for t in targets], int),
        "reach_tier": np.array([t.tier for t in targets], int),
        "reach_least": np.array([t.tier.least_verdict for t in targets], int),
        "reach_below": np.array([o.ground is not None for o in objects], int),
        "reach_graspadr": adr,
        "reach_graspnum": num,
        "grasp_body": np.array([g.body for g in grasps], int),
        "grasp_pos": np.reshape([g.pos for g in grasps], (-1, 3)),
        "grasp_quat": np.reshape([g.quat for g in grasps], (-1, 4)),
        "grasp_opening": np.array([g.opening for g in grasps], float),
        "grip_qposadr": gripper.qposadr,
        "grip_closed": gripper.closed_qpos,
        "grip_open": gripper.open_qpos,
        "grip_driveradr": driver,
        "grip_followadr": follower,
        "grip_coef": coef,
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
