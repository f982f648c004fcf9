"""What of a scene the arm is to reach: `reachable` on the host, and the arrays of `reach_device.Reach`."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.errors import ArmError, MapError, ReachWarning, UnknownNameError
from sceniris_gym.reach.arm import MAX_JOINTS, TCP, Arm
from sceniris_gym.reach.lookup import MapView, Verdict
from sceniris_gym.reach.map import ReachMap, build_command, map_file, why_not_map
from sceniris_gym.reach.solve import arm_view
from sceniris_gym.scene.compose import asset_name
from sceniris_gym.scene.device import fill_struct
from sceniris_gym.scene.grasps import Graspable, Grasps
from sceniris_gym.scene.gripper import Gripper, carried
from sceniris_gym.scene.lists import ranges
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.program import PlacedObject, Plan
from sceniris_gym.scene.reach_device import Reach, Tier
from sceniris_gym.scene.values import ROBOT

_TIERS = {tier.name.lower(): tier for tier in Tier}
# What placing lets through: the thorough tiers decide later, and need not be asked where the map says no all around.
_LEAST = {
    Tier.MAP: Verdict.MIXED_YES,
    Tier.MAP_STRICT: Verdict.YES,
    Tier.IK: Verdict.MIXED_NO,
    Tier.CLEAR: Verdict.MIXED_NO,
}


@dataclass(frozen=True)
class Column:
    """An object that is to be reachable.

    Attributes:
        name: The object.
        number: Its place in placement order.
        tier: How thoroughly.
        grasps: By which of its grasps.
    """

    name: str
    number: int
    tier: Tier
    grasps: Grasps


@dataclass(frozen=True)
class Reaching:
    """All that a scene's arm is to reach.

    Attributes:
        arm: The arm.
        gripper: Its gripper.
        map: The arm's map, None where there is none.
        columns: The objects, in placement order.
        view: The same as device code takes it.
    """

    arm: Arm
    gripper: Gripper
    map: ReachMap | None
    columns: tuple[Column, ...]
    view: Reach = field(repr=False)

    @property
    def staged(self) -> bool:
        """Whether any tier is decided after placing."""
        return any(column.tier >= Tier.IK for column in self.columns)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects, in the order of the columns of `Layouts.grasp`."""
        return tuple(column.name for column in self.columns)


def build_reaching(scene: SceneModel, plan: Plan, device: str) -> Reaching | None:
    """Find the arm of a scene, its map and the grasps of all that it is to reach; None if that is nothing.

    Raises:
        ArmError: the robot is not a serial arm.
        UnknownNameError: it has no site `tcp`.
        MapError: a tier needs the arm's map, and there is none, or one of another arm.
        GraspError: an object that the gripper cannot take.
    """
    wanted = [i for i, o in enumerate(plan.objects) if o.config is not None and o.config.reachable]
    if not wanted:
        return None
    robot = scene.config.robot
    assert robot is not None
    arm = find_arm(scene)
    gripper = Gripper.from_model(scene.mjm, arm, scene.home_qpos, plan.pieces)
    reach_map = _load_map(arm, robot.asset, scene.config.where)
    columns = []
    for i, tier in zip(wanted, _tiers(scene, [plan.objects[i].name for i in wanted], arm, reach_map), strict=True):
        o = plan.objects[i]
        assert o.config is not None
        shape = Graspable(scene, o.name, plan.pieces, plan.home)
        columns.append(Column(o.name, i, tier, shape.grasps(o.variants, o.config.turn.kind == "any", gripper)))
    view = Reach()
    view.base_body = scene.bodies[ROBOT]
    view.mapped = int(reach_map is not None)
    view.map = MapView() if reach_map is None else reach_map.view(device)
    view.arm = arm_view(arm, device)
    view.gap_closed, view.gap_open = gripper.closed, gripper.opening
    hand = sorted(carried(scene.mjm, arm))
    view.hand_pos, view.hand_quat = _in_tcp(plan.home, arm, hand[0])
    arrays = _arrays(plan, columns, gripper) | {
        "arm_qposadr": arm.qposadr,
        "arm_body": np.array(scene.subtree(ROBOT)[1:], int),
        "hand_body": np.array(hand, int),
    }
    fill_struct(Reach, view, arrays, device)
    return Reaching(arm, gripper, reach_map, tuple(columns), view)


def find_arm(scene: SceneModel) -> Arm:
    """The arm of a scene's robot: from its root body to its site `tcp`.

    Raises:
        ArmError: that is no serial arm.
        UnknownNameError: the robot has no site `tcp`.
    """
    robot = scene.config.robot
    assert robot is not None
    name, where = asset_name(robot.asset), f"{scene.config.where}: robot.asset"
    try:
        return Arm.from_model(scene.mjm, name, f"{name}/{TCP}")
    except ArmError as error:
        raise ArmError(f"{where}: {error}") from None
    except UnknownNameError as error:
        raise UnknownNameError(error.kind, error.name, f"{where}: {error.where}", error.valid) from None


def _load_map(arm: Arm, asset: str, where: str) -> ReachMap | None:
    path = map_file(asset)
    if path is None:
        return None
    try:
        return ReachMap.load(path, arm, f"Build it again: {build_command(asset)}.")
    except MapError as error:
        raise MapError(f"{where}: robot.asset: {error}") from None


def _tiers(scene: SceneModel, names: list[str], arm: Arm, reach_map: ReachMap | None) -> list[Tier]:
    """The tiers that decide: what was asked for, or `ik` where the arm's map would not be right."""
    robot, where = scene.config.robot, scene.config.where
    assert robot is not None
    words = {name: scene.config.objects[name].reachable for name in names}
    by_map = [name for name, word in words.items() if word is True or _TIERS[str(word)] < Tier.IK]
    why = why_not_map(arm, reach_map)
    if by_map and why is None and reach_map is None:
        raise MapError(
            f"{where}: objects.{by_map[0]}.reachable: there is no map of the arm '{robot.asset}'. Build it with "
            f"'{build_command(robot.asset)}', or ask for 'ik', which needs none."
        )
    asked = [f"objects.{name}.reachable" for name in by_map if words[name] is not True]
    if why is not None and asked:
        warnings.warn(f"{where}: {', '.join(asked)}: {why}, so 'ik' decides.", ReachWarning, stacklevel=2)
    default = Tier.MAP if why is None else Tier.IK
    return [default if word is True or (name in by_map and why) else _TIERS[str(word)] for name, word in words.items()]


def _in_tcp(home: mujoco.MjData, arm: Arm, body: int) -> tuple[wp.vec3, wp.vec4]:
    """The pose of a body that moves with the TCP, in the TCP's frame."""
    turn, quat = np.zeros(4), np.zeros(4)
    mujoco.mju_mat2Quat(turn, home.site_xmat[arm.tcp_site])
    mujoco.mju_negQuat(turn, turn.copy())
    mujoco.mju_mulQuat(quat, turn, home.xquat[body])
    pos = home.site_xmat[arm.tcp_site].reshape(3, 3).T @ (home.xpos[body] - home.site_xpos[arm.tcp_site])
    return wp.vec3(*pos), wp.vec4(*quat)


def _arrays(plan: Plan, columns: list[Column], gripper: Gripper) -> dict[str, np.ndarray]:
    grasps, adr, num = ranges(c.grasps.grasps for c in columns)
    objects = [plan.objects[c.number] for c in columns]
    numbers = np.full(len(plan.objects), -1)
    numbers[[c.number for c in columns]] = np.arange(len(columns))
    spans = np.concatenate([np.zeros((0, 2), int), *_spans(plan.objects, columns, adr)])
    rows = len(columns)
    return {
        "obj_reach": numbers,
        "variant_graspadr": spans[:, 0],
        "variant_graspnum": spans[:, 1],
        "reach_obj": np.array([c.number for c in columns], int),
        "reach_slot": np.array([plan.slots.index(c.name) for c in columns], int),
        "reach_tier": np.array([c.tier for c in columns], int),
        "reach_least": np.array([_LEAST[c.tier] for c in columns], int),
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
        "bank_grasp": np.zeros((0, rows)),
        "bank_grasp_qpos": np.zeros((0, rows, MAX_JOINTS)),
        "bank_pregrasp_qpos": np.zeros((0, rows, MAX_JOINTS)),
    }


def _spans(objects: list[PlacedObject], columns: list[Column], adr: np.ndarray) -> list[np.ndarray]:
    """(address, number) of the grasps of every variant of every object; none for what need not be reachable."""
    wanted = {c.number: (c.grasps.spans, int(first)) for c, first in zip(columns, adr, strict=True)}
    none = np.zeros(2, int)
    return [
        np.array(wanted[i][0]) + [wanted[i][1], 0] if i in wanted else np.tile(none, (len(o.variants), 1))
        for i, o in enumerate(objects)
    ]
