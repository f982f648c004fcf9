"""The kinds of starts of a scene (entries of `start`), as arrays: the targets, grasps and joints of each kind."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike

from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.robot import StartConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.grasping.grasps import PREFIX, selected
from sceniris_gym.grasping.grip import Grip
from sceniris_gym.program.device_reach import StartPose
from sceniris_gym.program.grips import firmest, tested_grips
from sceniris_gym.program.placed_object import JointRange
from sceniris_gym.program.plan import Plan, joint_range
from sceniris_gym.program.reach import ReachingArm, ReachTarget
from sceniris_gym.reach.arm import MAX_JOINTS

_ANY = 6
"""An arm with fewer joints than this cannot move its hand in every direction without turning it."""
_UNDRAWN = (1.0, -1.0)
"""The interval of a joint that a kind does not draw."""
_FITS = {StartPose.STANDING: "fits", StartPose.LIFTED: "lifts", StartPose.HELD: "holds"}
"""For each pose of the arm, the attribute of a Grip that has to be positive."""


def plan_grips(plan: Plan) -> tuple[Grip, ...]:
    """Return a grip (the closed fingers) for each grasp of all reach targets.

    If no kind of start holds a target, the grips of the target are not computed. Their `fits` is 0.

    Raises:
        SceneKeyError, NotSupportedError: A start holds a target, but its robot is not in the scene or has no fingers.
    """
    config = plan.scene.config
    kinds = [(kind, kind.targets(config.variants)) for kind in config.start if kind.robot == "grasp"]
    found: list[Grip] = []
    for target in plan.reaching.targets:
        one = plan.reaching.arm_of(target)
        poses = {_pose(kind) for kind, names in kinds if target.name in names}
        if not poses:
            found += [Grip(0.0, grasp.pos) for grasp in target.grasp_set.grasps]
            continue
        placed, asked = plan.objects[target.number], {"fits", *(_FITS[pose] for pose in poses)}
        where = f"{config.where}: start"
        found += tested_grips(plan.scene, one.arm, one.gripper, placed, target.grasp_set, asked, where)
    return tuple(found)


def plan_starts(plan: Plan, grips: tuple[Grip, ...]) -> dict[str, np.ndarray]:
    """Return the fields of `Starts` by name. `grip_*` have a row for each grasp, most others for each kind of start.

    A kind of start uses the grasps of a target that hold it with the firmest grip.

    Raises:
        UnknownNameError: A start names a grasp or a joint that does not exist.
        SceneKeyError: A start sets a joint that its object does not draw, or no selected grasp can hold a target.
    """
    kinds = [_kind(plan, grips, i, config) for i, config in enumerate(plan.scene.config.start)]
    robots = [b for one in plan.reaching.arms for b in plan.scene.moving(one.robot)]
    return {
        **{name: np.array([kind[name] for kind in kinds]) for name in kinds[0]},
        "robot_qposadr": plan.scene.mjm.jnt_qposadr[np.isin(plan.scene.mjm.jnt_bodyid, robots)],
        "grip_share": np.array([grip.share for grip in grips], float),
        "grip_pos": np.reshape([grip.pos for grip in grips], (-1, 3)),
    }


def _kind(plan: Plan, grips: tuple[Grip, ...], number: int, config: StartConfig) -> dict[str, ArrayLike]:
    """Return the row of one kind of start in each field of `Starts`, by field name."""
    where, pose, arm = f"{plan.scene.config.where}: start.{number}", _pose(config), -1
    names, arm_range = config.targets(plan.scene.config.variants), np.tile(_UNDRAWN, (MAX_JOINTS, 1))
    targets = plan.reaching.targets
    counts: list[np.ndarray] = [np.zeros(0)]
    for target in targets:
        own = _counting(plan, config, target, f"{where}.grasp") & (target.name in names)
        if pose in _FITS and target.name in names:
            first = sum(map(len, counts))
            lower = "It can be lifted by 0 m, so start it where it stands."
            own = firmest(grips[first : first + len(own)], _FITS[pose], own, where, target.name, lower)
        counts.append(own)
        if target.name in names:
            arm = target.arm
            arm_range = _arm_range(plan, plan.reaching.arms[arm], config, where)
    order, markers = {o.name: i for i, o in enumerate(plan.objects)}, plan.scene.config.markers(config)
    return {
        "pose": int(pose),
        "pregrasp": pose == StartPose.PREGRASP or len(plan.reaching.arms[arm].arm.joints if arm >= 0 else ()) >= _ANY,
        "arm": arm,
        "target": np.array([target.name in names for target in targets], bool),
        "grasp": np.concatenate(counts) > 0.0,
        "press": [each.max(initial=0.0) * (pose in _FITS) for each in counts[1:]],
        "lift": config.lift or (0.0, 0.0),
        "share": config.share or (0.0, 1.0),
        "arm_range": arm_range,
        "draw_range": _draw_ranges(plan, config.joints, f"{where}.joints"),
        "marker": [order[markers[name]] if name in markers else -1 for name in order],
    }


def _arm_range(plan: Plan, one: ReachingArm, config: StartConfig, where: str) -> np.ndarray:
    """Return the interval for each arm joint in a kind of start, shape (MAX_JOINTS, 2). If not drawn, low > high."""
    if one.robot in plan.scene.apart:
        raise SceneKeyError(f"{where}: needs the robot in the scene. Remove its 'in_scene: false', or this start.")
    found, index = np.tile(_UNDRAWN, (MAX_JOINTS, 1)), one.arm.qposadr.tolist()
    for drawn in _drawn(plan, one.robot, config.robot_joints, f"{where}.robot_joints"):
        if drawn.qposadr in index:  # a pattern also matches joints of the gripper, which a start does not draw
            found[index.index(drawn.qposadr)] = drawn.low, drawn.high
    if config.robot_joints and (found == _UNDRAWN).all():
        names = ", ".join(name.rpartition("/")[2] for name in one.arm.joints)
        raise SceneKeyError(f"{where}.robot_joints: should draw joints of the arm ({names}), not of its gripper.")
    return found


def _pose(config: StartConfig) -> StartPose:
    if config.robot != "grasp":
        return StartPose[config.robot.upper()]
    still = StartPose.HELD if config.robot_joints else StartPose.STANDING
    return StartPose.LIFTED if config.lift is not None else still


def _counting(plan: Plan, config: StartConfig, target: ReachTarget, where: str) -> np.ndarray:
    """Return a mask of the target's grasps that the start's `grasp` selects, shape (ngrasp,), bool."""
    grasps, word = target.grasp_set.grasps, config.grasp
    names = {grasp.name for grasp in (grasps if word is None else selected(plan.scene, target.name, grasps, word))}
    if target.name == config.of and not names:
        raise UnknownNameError("grasp", str(word), where, {grasp.name.removeprefix(PREFIX) for grasp in grasps})
    return np.array([grasp.name in names for grasp in grasps], bool)


def _drawn(plan: Plan, owner: str, words: Mapping[str, JointConfig], where: str) -> Iterator[JointRange]:
    """Yield a `JointRange` for each joint that `words` names in the object or robot `owner`."""
    for joint, config in plan.scene.resolve_joints(owner, words, where).items():
        yield joint_range(plan.scene, joint, config)


def _draw_ranges(plan: Plan, words: Mapping[str, JointConfig], where: str) -> np.ndarray:
    """Return a start's interval for each drawn joint of the plan, shape (ndraw, 2). Without an interval, low > high."""
    usual = [r.qposadr for o in plan.objects for r in o.joint_ranges]
    found = np.tile(_UNDRAWN, (len(usual), 1))
    for key, config in words.items():
        name, _, joint = key.rpartition("/")
        members = plan.scene.config.variants.get(name, (name,))
        for drawn in (one for member in members for one in _drawn(plan, member, {joint: config}, where)):
            if drawn.qposadr not in usual:
                raise SceneKeyError(f"{where}: '{key}' is not a drawn joint. Add this joint to objects.{name}.joints.")
            found[usual.index(drawn.qposadr)] = drawn.low, drawn.high
    return found
