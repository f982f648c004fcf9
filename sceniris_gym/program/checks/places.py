"""Checks that objects stay near enough to the origin for single precision, and away from parked objects."""

from collections.abc import Mapping

import mujoco
import numpy as np

from sceniris_gym.config.bounds import BOUNDS, MOST_FAR, MOST_WIDE
from sceniris_gym.config.member_names import variant_of
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.geometry.pieces import ROUGH, PieceType, geom_name, obstacle_flexes
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.dropping import point
from sceniris_gym.program.placed_object import PlacedObject, keys_of_bodies
from sceniris_gym.program.plan import Plan
from sceniris_gym.scene.parking import GROUND_RISE, PARKING_FROM, PARKING_SPACING

# An object that may get beyond this [m] in both x and y is too close to parked objects.
_NEAREST = PARKING_FROM - PARKING_SPACING
# Least distance [m] between what layouts move and a shape that is only bounded by a box.
_APART = 0.1
# An empty box (lower corner, upper corner), and the directions that its corners move to as it grows.
_NOWHERE, _OUTWARDS = np.array([[np.inf] * 3, [-np.inf] * 3]), np.array([[-1.0], [1.0]])


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
    at = o.corners if o.support.owner in placed else point(plan.scene.home, o.support.body, o.corners)
    reach = float(np.abs(at).max())
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
            cure = "leave this variant out" if variant_of(o.name) else "place it in every layout"
            raise SceneKeyError(
                f"{config.where}: {config.key(o.name)}: is {edge:.3g} m wide and may be absent, but absent objects are "
                f"parked only {PARKING_SPACING:g} m apart. Use a smaller object, or {cure}."
            )
    for name, (_, corner) in _reaches(plan, GROUND_RISE).items():
        if corner[:2].min() > _NEAREST:
            path = config.key(name) if name in config.objects else f"body '{name}'"
            raise SceneKeyError(
                f"{config.where}: {path}: reaches as far as ({corner[0]:.3g}, {corner[1]:.3g}) m, but absent objects "
                f"are parked from ({PARKING_FROM:g}, {PARKING_FROM:g}) m on. Move it and its support nearer to the "
                "world's origin, or place all objects in every layout."
            )


def check_rough_shapes(plan: Plan) -> None:
    """Check that layouts keep objects away from height fields, signed distance fields and flexes.

    Raises:
        NotSupportedError: An object may come near such a shape, or the shape is part of an object that layouts move.
    """
    scene, config, rough = plan.scene, plan.scene.config, _rough_shapes(plan)
    if not rough:
        return
    ends, keys = _reaches(plan), keys_of_bodies(scene)
    moving = {o.name: ends[o.name] for o in plan.objects if o.kind != ObjectKind.MARKER}
    if any(part.reachable for part in config.objects.values()):  # the arms move too
        for name in config.all_robots.keys() - moving.keys() & ends.keys():
            moving[name] = ends[name] + 2.0 * _size(plan, scene.subtree(name), {}) * _OUTWARDS
    for label, bodies, box in rough:
        first = min(bodies, key=lambda body: body not in scene.owners)
        owner, (low, high) = scene.owners.get(first), box + _APART * _OUTWARDS
        near = [name for name, at in moving.items() if (at[0] < high).all() and (at[1] > low).all()]
        if name := owner if owner in moving else next(iter(near), None):
            key = config.key(name) if name in config.objects else config.all_robots[name].key
            away = "" if name == owner else f", or keep {key} more than {_APART:g} m away from the box around it"
            raise NotSupportedError(
                f"{keys[first]}: {label} cannot be an obstacle. Use rigid primitives or meshes, turn its collisions "
                f"off (contype=0, conaffinity=0, and rgba alpha=0 for visual geometry){away}."
            )


def _rough_shapes(plan: Plan) -> list[tuple[str, set[int], np.ndarray]]:
    """Return the shapes that are only bounded by boxes: their name in messages, bodies, and box [m], shape (2, 3).

    These are height fields and signed distance fields among the pieces. A flex has no piece, but counts if it collides
    or, with visual geometry, if it is visible.
    """
    scene, mjm, found = plan.scene, plan.scene.mjm, []
    for p, low, high in plan.solids:
        if mjm.geom_type[p.geom] in ROUGH:
            kind = mujoco.mjtGeom(mjm.geom_type[p.geom]).name.removeprefix("mjGEOM_").lower()
            found.append((f"geom '{geom_name(mjm, p.geom)}': a {kind}", {p.body}, np.array([low, high])))
    mujoco.mj_flex(mjm, scene.home)
    for flex, bodies in obstacle_flexes(mjm, scene.config.geometry):
        at = scene.home.flexvert_xpos[mjm.flex_vertadr[flex] :][: mjm.flex_vertnum[flex]]
        box = np.array([at.min(axis=0), at.max(axis=0)]) + mjm.flex_radius[flex] * _OUTWARDS
        name = mujoco.mj_id2name(mjm, mujoco.mjtObj.mjOBJ_FLEX, flex) or flex
        found.append((f"flex '{name}': a soft body", bodies, box))
    return found


def _reaches(plan: Plan, above: float = -np.inf) -> dict[str, np.ndarray]:
    """Return the box [m] that each object, robot and other body may reach, by name: lower and upper corner, (2, 3).

    Pieces of bodies that are not placed count if they rise above the height `above` [m] in the start pose.
    """
    ends: dict[str, np.ndarray] = {}
    for p, low, high in plan.solids:
        if high[2] > above:
            name = plan.scene.owners.get(p.body) or str(plan.scene.mjm.body(p.body).name)
            known = ends.get(name, _NOWHERE)
            ends[name] = np.array([np.minimum(known[0], low), np.maximum(known[1], high)])
    for o in plan.objects:
        ends[o.name] = _reach(plan, o, ends)
    return ends


def _reach(plan: Plan, o: PlacedObject, ends: dict[str, np.ndarray]) -> np.ndarray:
    """Return the box [m] that an object may reach, shape (2, 3). `ends` has the known boxes, by name."""
    size = _size(plan, o.bodies, o.spans)
    if not o.config.is_placed:
        return ends.get(o.name, _NOWHERE) + (2.0 * size if o.joint_ranges else 0.0) * _OUTWARDS
    if o.config.support is None:
        at = np.array(o.config.region and o.config.region.corners)
    elif o.support is not None and o.support.owner is not None:
        at = ends.get(o.support.owner, _NOWHERE)
    else:  # on a support that belongs to no object
        assert o.ground is not None
        corners = point(plan.scene.home, o.ground, o.corners)
        at = np.array([corners.min(axis=0), corners.max(axis=0)])
    return at + 2.0 * size * _OUTWARDS


def _size(plan: Plan, bodies: list[int], spans: Mapping[int, tuple[float, float]]) -> float:
    """Return an upper bound [m] of the distance from an object's root to its pieces, for all drawn joint positions.

    Args:
        plan: The plan.
        bodies: The object's bodies, the root first.
        spans: The ranges of its drawn joints, as `PlacedObject.spans`.
    """
    mjm = plan.scene.mjm
    own = [p for p in plan.pieces if p.body in bodies]
    if not own:
        return 0.0
    drawn = {adr: max(map(abs, ends)) for adr, ends in spans.items()}
    size = max(float(np.linalg.norm(np.maximum(*np.abs(p.bounds)))) for p in own)
    size += float(np.linalg.norm(mjm.body_pos[bodies[1:]], axis=1).sum())
    for joint in np.flatnonzero(np.isin(mjm.jnt_bodyid, bodies)):
        adr = int(mjm.jnt_qposadr[joint])
        if mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            size += drawn.get(adr, abs(float(plan.scene.home_qpos[adr]))) + abs(float(mjm.qpos0[adr]))
        elif mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            size += 2.0 * float(np.linalg.norm(mjm.jnt_pos[joint]))
    return size
