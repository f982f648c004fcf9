"""The kinds of starts of a scene (entries of `start`), as arrays: the targets, grasps and joints of each kind."""

from collections.abc import Iterator, Mapping
from itertools import product

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.robot import StartConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError, UnknownNameError
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.grasping.grasps import PREFIX, selected
from sceniris_gym.grasping.grip import SLIPS, Fingers, Grip
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.device_reach import StartPose
from sceniris_gym.program.placed_object import JointRange, PlacedObject
from sceniris_gym.program.plan import Plan, joint_range
from sceniris_gym.program.reach import ReachingArm, ReachTarget
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.scene.draws import WEAK, at_ends, corners
from sceniris_gym.scene.model import SceneModel

_ANY = 6
"""An arm with fewer joints than this cannot move its hand in every direction without turning it."""
_UNDRAWN = (1.0, -1.0)
"""The interval of a joint that a kind does not draw."""
_CARRIED = np.zeros((1, 3))
_ALL_WAYS = np.concatenate([np.eye(3), -np.eye(3)])
_FITS = {
    StartPose.STANDING: ("fits", "from both sides"),
    StartPose.LIFTED: ("lifts", "upright in the air"),
    StartPose.HELD: ("holds", "in every orientation"),
}
"""For each pose of the arm, the attribute of a Grip that has to be positive, and the words for it in errors."""


def plan_grips(plan: Plan) -> tuple[Grip, ...]:
    """Return a grip (the closed fingers) for each grasp of all reach targets.

    If no kind of start holds a target, the grips of the target are not computed. Their `fits` is 0.

    Raises:
        NotSupportedError: A start holds a target with an arm that has no fingers to close.
    """
    config = plan.scene.config
    kinds = [(kind, kind.targets(config.variants)) for kind in config.start if kind.robot == "grasp"]
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
        scene, bodies = plan.scene, plan.scene.subtree(target.name)
        fingers = Fingers(weakest(scene), one.arm, one.gripper, scene.home)
        is_free = plan.objects[target.number].kind == ObjectKind.FREE
        for i, (grasp, grip) in enumerate(zip(grasps, fingers.grips(bodies, grasps), strict=True)):
            ways = {"fits": _CARRIED, "lifts": _downs(plan.objects[target.number], target, i), "holds": _ALL_WAYS}
            asked = {"fits", *(_FITS[pose][0] for pose in poses)} if grip.fits and is_free else ()
            # pyrefly: ignore[bad-argument-type]
            found.append(grip._replace(**{fit: fingers.hold(bodies, grasp, grip, ways[fit]) for fit in asked}))
    return tuple(found)


def weakest(scene: SceneModel) -> list[mujoco.MjModel]:
    """Return models with the drawn physics parameters at which a gripper holds an object least well.

    Joint friction and joint stiffness are greatest, because they resist the closing of the fingers. For the constant
    force of actuators and for centres of mass, the worst value is unknown. The result has a model for each combination
    of their least and greatest values.
    """
    ends, draws = WEAK | {"dof_frictionloss": "most", "jnt_stiffness": "most"}, scene.draws
    unknown = product(corners(draws, "actuator_biasprm"), corners(draws, "body_ipos"))
    return [at_ends(scene.mjm, draws, **ends, actuator_biasprm=bias, body_ipos=center) for bias, center in unknown]


def _downs(placed: PlacedObject, target: ReachTarget, grasp: int) -> np.ndarray:
    """Return the direction of gravity in the object's frame for each stable pose that allows `grasp`, shape (n, 3)."""
    if placed.orientation == "any":
        return _ALL_WAYS
    spans = zip(placed.stable_poses, target.grasp_set.spans, strict=True)
    return np.array([-matrix(v.quat)[2] for v, (first, num) in spans if first <= grasp < first + num])


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
            fit, how = _FITS[pose]
            first = sum(map(len, counts))
            tried = grips[first : first + len(own)]
            firm = own * [getattr(grip, fit) for grip in tried]
            slips, own = -firm[firm < 0.0], firm * (firm == firm.max(initial=0.0))
            if not own.any():
                least = slips.min(initial=np.inf)
                why = f": in the best it moves by {1e3 * least:.1f} mm (limit {1e3 * SLIPS:g})" * bool(len(slips))
                lower = " It can be lifted by 0 m, so start it where it stands." * any(g.fits > 0.0 for g in tried)
                raise SceneKeyError(
                    f"{where}: no selected grasp can hold '{target.name}' {how} for all values of 'randomize'{why}."
                    f"{lower} Select other grasps, or use a stronger gripper (its actuators should drive all fingers), "
                    "a lighter object, or narrower draws."
                )
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
