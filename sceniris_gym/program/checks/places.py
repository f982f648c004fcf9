"""Checks that objects stay near enough to the origin for single precision, and away from parked objects."""

import mujoco
import numpy as np

from sceniris_gym.config.bounds import BOUNDS, MOST_FAR, MOST_WIDE
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.geometry.pieces import PieceType, geom_name
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.plan import Plan
from sceniris_gym.scene.parking import GROUND_RISE, PARKING_FROM, PARKING_SPACING

# An object that may get beyond this [m] in both x and y is too close to parked objects.
_NEAREST = PARKING_FROM - PARKING_SPACING


def check_distances(plan: Plan) -> None:
    """Check that objects and obstacles stay near enough to the world's origin for single precision.

    A geom that is wholly too far away is ignored if it is not part of an object or robot of the scene, because no
    placed object can reach this geom.

    Raises:
        NotSupportedError: A placed object has a plane as a geom.
        SceneKeyError: An object or robot stands too far from the origin, or may be placed too far away. A geom reaches
            too far. The range of a drawn joint includes too large positions.
    """
    placed = {o.name for o in plan.objects if o.kind != ObjectKind.STATIC}
    config = plan.scene.config
    for name in (name for name in plan.slots if name not in placed):
        at = plan.scene.home.xpos[plan.scene.bodies[name]]
        if np.abs(at).max() > MOST_FAR:
            key, robot = config.key(name), config.all_robots.get(name)
            if robot is not None:
                key = f"{robot.section}.base" if robot.in_model is None else robot.key
            place = ", ".join(f"{x:.4g}" for x in at)
            raise SceneKeyError(
                f"{config.where}: {key}: stands at ({place}) m, but should be within {MOST_FAR:g} m of the world's "
                "origin along each axis: rounding grows with distance. Move the model to the origin."
            )
    for o in plan.objects:
        where = f"{config.where}: {config.key(o.name)}"
        _check_region(plan, o, placed)
        if o.name in placed and any(p.type == PieceType.PLANE and p.body in o.bodies for p in plan.pieces):
            raise NotSupportedError(f"{where}: a plane is endless and cannot be part of a placed object. Use a box.")
        for p, *ends in (solid for solid in plan.solids if o.name in placed and solid[0].body in o.bodies):
            # measured from the object's frame, because the object is placed elsewhere than at home
            reach = float(np.abs(np.subtract(ends, plan.scene.home.xpos[o.bodies[0]])).max())
            if reach > MOST_FAR:
                raise SceneKeyError(
                    f"{where}: geom '{geom_name(plan.scene.mjm, p.geom)}' reaches {reach:.4g} m from the object's "
                    f"origin, but should end within {MOST_FAR:g} m of it: rounding grows with distance. Correct its "
                    "position, or give its mesh a smaller `scale`."
                )
        bound, mjm = BOUNDS["joint"], plan.scene.mjm
        for drawn in o.joint_ranges:
            ends = drawn.choice or (drawn.low, drawn.high)
            if not all(map(bound.holds, ends)):
                joint = mjm.joint(int(np.flatnonzero(mjm.jnt_qposadr == drawn.qposadr)[0])).name
                raise SceneKeyError(
                    f"{where}.joints: '{joint}' is drawn between {min(ends):g} and {max(ends):g}, but {bound.advice}. "
                    "Correct its limits in the model, or give a 'range'."
                )
    for p, low, high in plan.solids:
        reach = float(np.abs([low, high]).max())
        if reach > MOST_WIDE and np.all(low <= MOST_FAR) and np.all(high >= -MOST_FAR):
            raise SceneKeyError(
                f"{plan.scene.config.where}: geom '{geom_name(plan.scene.mjm, p.geom)}': reaches {reach:.4g} m from "
                f"the world's origin, but should end within {MOST_WIDE:g} m along each axis: rounding grows with "
                "distance. Use a plane, or smaller geoms."
            )


def _check_region(plan: Plan, o: PlacedObject, placed: set[str]) -> None:
    """Check that an object cannot be placed on its support too far from the world's origin.

    If the support is also placed, only the extent of the object's region on the support is checked. The check of the
    support limits how far the support is from the origin.
    """
    if o.support is None or o.config.support is None:
        return
    moves = o.support.owner in placed
    pos = np.zeros(3) if moves else plan.scene.home.xpos[o.support.body]
    mat = np.eye(3) if moves else plan.scene.home.xmat[o.support.body].reshape(3, 3)
    reach = float(np.abs(o.corners @ mat.T + pos).max())
    if reach > MOST_FAR + 1e-6:
        where = f"{plan.scene.config.where}: {plan.scene.config.key(o.name)}.{o.config.support.word}"
        raise SceneKeyError(
            f"{where}: '{o.config.support.parent}' reaches {reach:.4g} m from the world's origin, but objects should "
            f"be placed within {MOST_FAR:g} m of the origin along each axis: rounding grows with distance. Give the "
            "object a 'region' nearer to the origin."
        )


def check_parking(plan: Plan) -> None:
    """Check that objects that may be absent fit into their parking places, and that no other object gets there.

    Raises:
        SceneKeyError: An object is too large to be parked. An object or body may get to the parking places.
    """
    config = plan.scene.config
    if not config.absent:
        return
    for o in (o for o in plan.objects if o.name in config.absent):
        edge = float((o.stable_poses[0].bounds[2:] - o.stable_poses[0].bounds[:2]).max())
        if edge >= PARKING_SPACING:  # neighbours on the lattice would touch
            cure = "leave this variant out" if o.name in config.owners else "take it out of its group"
            raise SceneKeyError(
                f"{config.where}: objects.{o.name}: is {edge:.3g} m wide and may be absent, but absent objects are "
                f"parked only {PARKING_SPACING:g} m apart. Use a smaller object, or {cure}."
            )
    corners: dict[str, np.ndarray] = {}  # at home, of pieces that rise above the ground
    for p, _, high in plan.solids:
        if high[2] > GROUND_RISE:
            name = plan.scene.owners.get(p.body) or str(plan.scene.mjm.body(p.body).name)
            corners[name] = np.maximum(corners[name], high[:2]) if name in corners else high[:2]
    for o in plan.objects:
        corners[o.name] = _corner(plan, o, corners)
    for name, corner in corners.items():
        if corner.min() > _NEAREST:
            path = f"objects.{name}" if name in config.objects else f"body '{name}'"
            raise SceneKeyError(
                f"{config.where}: {path}: reaches as far as ({corner[0]:.3g}, {corner[1]:.3g}) m, but absent members "
                f"of groups are parked from ({PARKING_FROM:g}, {PARKING_FROM:g}) m on. Move it and its support "
                "nearer to the world's origin, or use no groups."
            )


def _corner(plan: Plan, o: PlacedObject, corners: dict[str, np.ndarray]) -> np.ndarray:
    """Return the greatest x and y [m] that an object may reach. `corners` has the known results, by name."""
    size = _size(plan, o)
    if not o.config.is_placed:
        return corners.get(o.name, np.full(2, -np.inf)) + (2.0 * size if o.joint_ranges else 0.0)
    if o.config.support is None:
        at = np.array(o.config.region and o.config.region.corners)[1, :2]
    elif o.support is not None and o.support.owner is not None:
        at = corners.get(o.support.owner, np.full(2, -np.inf))
    else:  # on a support that belongs to no object
        assert o.ground is not None
        pos, mat = plan.scene.home.xpos[o.ground], plan.scene.home.xmat[o.ground].reshape(3, 3)
        at = (o.corners @ mat.T + pos)[:, :2].max(axis=0)
    return at + 2.0 * size


def _size(plan: Plan, o: PlacedObject) -> float:
    """Return an upper bound [m] of the distance from an object's root to its pieces, for all drawn joint positions."""
    mjm = plan.scene.mjm
    own = [p for p in plan.pieces if p.body in o.bodies]
    if not own:
        return 0.0
    drawn = {adr: max(map(abs, ends)) for adr, ends in o.spans.items()}
    size = max(float(np.linalg.norm(np.maximum(*np.abs(p.bounds)))) for p in own)
    size += float(np.linalg.norm(mjm.body_pos[o.bodies[1:]], axis=1).sum())
    for joint in np.flatnonzero(np.isin(mjm.jnt_bodyid, o.bodies)):
        adr = int(mjm.jnt_qposadr[joint])
        if mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            size += drawn.get(adr, abs(float(plan.scene.home_qpos[adr]))) + abs(float(mjm.qpos0[adr]))
        elif mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            size += 2.0 * float(np.linalg.norm(mjm.jnt_pos[joint]))
    return size
