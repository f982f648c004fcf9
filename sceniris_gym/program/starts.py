"""The kinds of starts of a scene on the host: their grasps, grips, joints and markers by the numbers of the plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.start import StartConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError, UnknownNameError
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.grasping.grasps import PREFIX, matches
from sceniris_gym.grasping.grip import Fingers, Grip
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.device_starts import StartPose
from sceniris_gym.program.placed_object import JointRange, PlacedObject
from sceniris_gym.program.plan import Plan, joint_range
from sceniris_gym.program.reach import ReachTarget

_CARRIED = np.zeros((1, 3))
_ALL_WAYS = np.concatenate([np.eye(3), -np.eye(3)])
_FITS = {
    StartPose.STANDING: ("fits", "from both sides"),
    StartPose.LIFTED: ("lifts", "upright in the air"),
    StartPose.HELD: ("holds", "whichever way is down"),
}
"""The attribute of a Grip that a pose of the arm asks for, in words."""


@dataclass(frozen=True)
class StartKind:
    """One kind of start.

    Attributes:
        config: Its words.
        pose: The pose of the arm.
        arm: Index in `Reaching.arms` of the arm, -1 for none.
        columns: The reach targets that it may hold, of which one is present.
        grasps: Which grasps of all targets, one target after the other, count; shape (ngrasp,), bool.
        arm_joints: Draws of the arm's joints, by their index in the arm.
        draws: Draws of objects' joints, by their addresses in qpos.
        markers: The marker that each object is placed at, both by their numbers in placement order.
    """

    config: StartConfig
    pose: StartPose
    arm: int
    columns: tuple[int, ...]
    grasps: np.ndarray
    arm_joints: Mapping[int, JointRange]
    draws: Mapping[int, JointRange]
    markers: Mapping[int, int]


def plan_grips(plan: Plan) -> tuple[Grip, ...]:
    """Return the grip of each grasp of all reach targets; the grasps of those that no start holds have none that fit.

    Raises:
        NotSupportedError: An arm has no fingers that close.
    """
    if plan.reaching is None:
        return ()
    config = plan.scene.config
    kinds = [(kind, kind.targets(config.groups)) for kind in config.start if kind.robot == "grasp"]
    found: list[Grip] = []
    for target in plan.reaching.targets:
        grasps, one = target.grasp_set.grasps, plan.reaching.arm_of(target)
        poses = {_pose(kind) for kind, names in kinds if target.name in names}
        if not poses:
            found += [Grip(0.0, grasp.pos) for grasp in grasps]
            continue
        if not len(one.gripper.qposadr):
            raise NotSupportedError(
                f"{config.where}: start: the tool of '{one.robot}' has no fingers that close on '{target.name}'. Start "
                "from 'home' or 'pregrasp'."
            )
        fingers, bodies = Fingers(plan.scene.mjm, one.arm, one.gripper, plan.home), plan.scene.subtree(target.name)
        is_free = plan.objects[target.number].kind == ObjectKind.FREE
        for i, (grasp, grip) in enumerate(zip(grasps, fingers.grips(bodies, grasps), strict=True)):
            ways = {"fits": _CARRIED, "lifts": _downs(plan.objects[target.number], target, i), "holds": _ALL_WAYS}
            asked = {"fits", *(_FITS[pose][0] for pose in poses)} if grip.fits and is_free else ()
            found.append(replace(grip, **{fit: fingers.hold(bodies, grasp, grip, ways[fit]) for fit in asked}))
    return tuple(found)


def _downs(placed: PlacedObject, target: ReachTarget, grasp: int) -> np.ndarray:
    """Return where down is in the frame of an object, for each pose in which a grasp of it is tried, shape (n, 3)."""
    if placed.orientation == "any":
        return _ALL_WAYS
    spans = zip(placed.variants, target.grasp_set.spans, strict=True)
    return np.array([-matrix(v.quat)[2] for v, (first, num) in spans if first <= grasp < first + num])


def plan_starts(plan: Plan, grips: tuple[Grip, ...]) -> tuple[StartKind, ...]:
    """Resolve the kinds of starts of a scene.

    Raises:
        UnknownNameError: A grasp or a joint that does not exist.
        SceneKeyError: A joint whose object does not draw it, or an object that no grasp holds.
    """
    return tuple(_kind(plan, grips, i, config) for i, config in enumerate(plan.scene.config.start))


def _kind(plan: Plan, grips: tuple[Grip, ...], number: int, config: StartConfig) -> StartKind:
    """Resolve one kind."""
    where = f"{plan.scene.config.where}: start.{number}"
    names = config.targets(plan.scene.config.groups)
    targets = () if plan.reaching is None else plan.reaching.targets
    columns = tuple(i for i, target in enumerate(targets) if target.name in names)
    counts = [_counting(config, target, f"{where}.grasp") & (target.name in names) for target in targets]
    grasps = np.concatenate([np.zeros(0, bool), *counts])
    if config.robot == "grasp":
        fit, how = _FITS[_pose(config)]
        grasps &= np.array([getattr(grip, fit) for grip in grips], bool)
        ends = np.cumsum([0, *(len(count) for count in counts)])
        for i in columns:
            if not grasps[ends[i] : ends[i + 1]].any():
                raise SceneKeyError(
                    f"{where}: the gripper should be able to hold '{targets[i].name}' {how}, and none of its grasps "
                    "that count is that firm. Choose other grasps, a stronger gripper, or a lighter object."
                )
    arm = targets[columns[0]].arm if columns else -1
    if plan.reaching is not None and columns and plan.reaching.arms[arm].robot in plan.scene.apart:
        raise SceneKeyError(f"{where}: should have a robot that is in the scene, but its 'in_scene' is false.")
    order = {o.name: i for i, o in enumerate(plan.objects)}
    return StartKind(
        config,
        _pose(config),
        arm,
        columns,
        grasps,
        _arm_joints(plan, arm, config.robot_joints, f"{where}.robot_joints"),
        _draws(plan, config.joints, f"{where}.joints"),
        {order[name]: order[marker] for name, marker in config.place.items()},
    )


def _pose(config: StartConfig) -> StartPose:
    if config.robot != "grasp":
        return StartPose[config.robot.upper()]
    return (
        StartPose.LIFTED if config.lift is not None else StartPose.HELD if config.robot_joints else StartPose.STANDING
    )


def _counting(config: StartConfig, target: ReachTarget, where: str) -> np.ndarray:
    """Return which grasps of a target match the glob of a start, shape (ngrasp,), bool."""
    names = [grasp.name for grasp in target.grasp_set.grasps]
    found = [config.grasp is None or matches(name, config.grasp) for name in names]
    if target.name == config.of and not any(found):
        raise UnknownNameError("grasp", str(config.grasp), where, {name.removeprefix(PREFIX) for name in names})
    return np.array(found, bool)


def _arm_joints(plan: Plan, arm: int, words: Mapping[str, JointConfig], where: str) -> dict[int, JointRange]:
    """Return the draws of an arm's joints by their index in the arm; patterns skip joints outside of it."""
    if not words or plan.reaching is None:
        return {}
    one = plan.reaching.arms[arm]
    drawn = plan.scene.resolve_joints(one.robot, words, where)
    ranges = [joint_range(plan.scene, joint, config) for joint, config in drawn.items()]
    index = {int(adr): i for i, adr in enumerate(one.arm.qposadr)}
    return {index[r.qposadr]: r for r in ranges if r.qposadr in index}


def _draws(plan: Plan, words: Mapping[str, JointConfig], where: str) -> dict[int, JointRange]:
    """Return the draws of objects' joints by their addresses in qpos."""
    found = {}
    usual = {r.qposadr for o in plan.objects for r in o.joint_ranges}
    for key, config in words.items():
        name, _, joint = key.rpartition("/")
        for number in plan.scene.resolve_joints(name, {joint: config}, where):
            drawn = joint_range(plan.scene, number, config)
            if drawn.qposadr not in usual:
                raise SceneKeyError(f"{where}: '{key}' should be among the joints that objects.{name}.joints draws.")
            found[drawn.qposadr] = drawn
    return found
