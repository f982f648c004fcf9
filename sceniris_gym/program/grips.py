"""The grasps of an object that hold it: the gripper closes on each, and MuJoCo C tests it with twice the weight."""

from collections.abc import Collection, Sequence
from itertools import product

import mujoco
import numpy as np

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.grasping.grasps import GraspSet
from sceniris_gym.grasping.grip import SLIPS, Fingers, Grip
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.scene.draws import WEAK, at_ends, corners
from sceniris_gym.scene.model import SceneModel

_CARRIED = np.zeros((1, 3))
_ALL_WAYS = np.concatenate([np.eye(3), -np.eye(3)])
_HOW = {"fits": "from both sides", "lifts": "upright in the air", "holds": "in every orientation"}
"""The attributes of a Grip, and the words for them in errors."""


def tested_grips(
    scene: SceneModel,
    arm: SerialArm,
    gripper: Gripper,
    placed: PlacedObject,
    grasps: GraspSet,
    asked: Collection[str],
    where: str,
) -> list[Grip]:
    """Return the grip of each grasp of an object. `asked` names the attributes of Grip that are tested, if it is free.

    Raises:
        SceneKeyError: The robot is not in the scene. The error begins with `where`.
        NotSupportedError: The gripper has no fingers to close.
    """
    robot = scene.config.robot_for(placed.name)
    if robot in scene.apart:
        raise SceneKeyError(f"{where}: needs the robot in the scene. Remove its 'in_scene: false', or this word.")
    if not len(gripper.qposadr):
        raise NotSupportedError(
            f"{where}: the tool of '{robot}' has no fingers that close on '{placed.name}'. Start from 'home' or "
            "'pregrasp', and remove 'firm'."
        )
    fingers, found = Fingers(weakest(scene), arm, gripper, scene.home), []
    is_free = placed.kind == ObjectKind.FREE
    for i, grip in enumerate(fingers.grips(placed.bodies, grasps.grasps)):
        ways = {"fits": _CARRIED, "lifts": _downs(placed, grasps, i), "holds": _ALL_WAYS}
        tested = asked if grip.fits and is_free else ()
        fits = {fit: fingers.hold(placed.bodies, grasps.grasps[i], grip, ways[fit]) for fit in tested}
        found.append(grip._replace(**fits))  # pyrefly: ignore[bad-argument-type]
    return found


def firmest(grips: Sequence[Grip], fit: str, selected: np.ndarray, where: str, name: str, instead: str) -> np.ndarray:
    """Return for each of an object's grips how firm it is, and 0 unless it is selected and the firmest, shape (n,).

    Args:
        grips: The grips.
        fit: The attribute of a Grip that counts.
        selected: Mask of the grips that may be used, shape (n,), bool.
        where: The beginning of the error.
        name: The object.
        instead: The part of the error for an object that the fingers fit around.

    Raises:
        SceneKeyError: No selected grip holds the object.
    """
    firm = selected * np.array([getattr(grip, fit) for grip in grips])
    slips, found = -firm[firm < 0.0], firm * (firm == firm.max(initial=0.0))
    if found.any():
        return found
    why = f": in the best it moves by {1e3 * slips.min():.1f} mm (limit {1e3 * SLIPS:g})" if len(slips) else ""
    fix = f" {instead}" * any(g.fits > 0.0 for g in grips)
    raise SceneKeyError(
        f"{where}: no selected grasp can hold '{name}' {_HOW[fit]} for all values of 'randomize'{why}.{fix} Select "
        "other grasps, or use a stronger gripper (its actuators should drive all fingers), a lighter object, or "
        "narrower draws."
    )


def weakest(scene: SceneModel) -> list[mujoco.MjModel]:
    """Return models with the drawn physics parameters at which a gripper holds an object least well.

    Joint friction and joint stiffness are greatest, because they resist the closing of the fingers. For the constant
    force of actuators and for centres of mass, the worst value is unknown. The result has a model for each combination
    of their least and greatest values.
    """
    ends, draws = WEAK | {"dof_frictionloss": "most", "jnt_stiffness": "most"}, scene.draws
    unknown = product(corners(draws, "actuator_biasprm"), corners(draws, "body_ipos"))
    return [at_ends(scene.mjm, draws, **ends, actuator_biasprm=bias, body_ipos=center) for bias, center in unknown]


def _downs(placed: PlacedObject, grasps: GraspSet, grasp: int) -> np.ndarray:
    """Return the direction of gravity in the object's frame for each stable pose that allows `grasp`, shape (n, 3)."""
    if placed.orientation == "any":
        return _ALL_WAYS
    spans = zip(placed.stable_poses, grasps.spans, strict=True)
    return np.array([-matrix(v.quat)[2] for v, (first, num) in spans if first <= grasp < first + num])
