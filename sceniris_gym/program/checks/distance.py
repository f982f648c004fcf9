"""Check of distances: nothing stands or is placed where single precision is too coarse to tell whether it touches."""

from __future__ import annotations

import numpy as np

from sceniris_gym.config.bounds import BOUNDS, MOST_FAR, MOST_WIDE
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.geometry.pieces import PieceType, geom_name
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.plan import Plan


def check_distances(plan: Plan) -> None:
    """Check that objects stay, and obstacles end, within distances that single precision resolves.

    Obstacles that stand beyond them as a whole and are no objects of the scene can meet nothing, and are left alone.

    Raises:
        NotSupportedError: A plane in an object that is placed.
        SceneKeyError: An object that stands too far away or may be placed there, a geom that reaches too far, or a
            joint that is drawn too far out.
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
                f"{config.where}: {key}: stands at ({place}) m, and should be within {MOST_FAR:g} m of the world's "
                "origin along each axis: rounding grows with distance. Move the model to the origin."
            )
    for o in plan.objects:
        where = f"{config.where}: {config.key(o.name)}"
        _check_region(plan, o, placed)
        if o.name in placed and any(p.type == PieceType.PLANE and p.body in o.bodies for p in plan.pieces):
            raise NotSupportedError(f"{where}: a plane is endless and cannot be part of what is placed. Use a box.")
        for p, *ends in (solid for solid in plan.solids if o.name in placed and solid[0].body in o.bodies):
            # it ends near enough to its own frame, wherever that is at home
            reach = float(np.abs(np.subtract(ends, plan.scene.home.xpos[o.bodies[0]])).max())
            if reach > MOST_FAR:
                raise SceneKeyError(
                    f"{where}: geom '{geom_name(plan.scene.mjm, p.geom)}' reaches {reach:.4g} m from the object's "
                    f"origin, and should end within {MOST_FAR:g} m of it: rounding grows with distance. Correct its "
                    "position, or give its mesh a smaller `scale`."
                )
        bound, mjm = BOUNDS["joint"], plan.scene.mjm
        for drawn in o.joint_ranges:
            ends = drawn.choice or (drawn.low, drawn.high)
            if not all(map(bound.holds, ends)):
                joint = mjm.joint(int(np.flatnonzero(mjm.jnt_qposadr == drawn.qposadr)[0])).name
                raise SceneKeyError(
                    f"{where}.joints: '{joint}' is drawn between {min(ends):g} and {max(ends):g}, and {bound.advice}. "
                    "Correct its limits in the model, or give a 'range'."
                )
    for p, low, high in plan.solids:
        reach = float(np.abs([low, high]).max())
        if reach > MOST_WIDE and np.all(low <= MOST_FAR) and np.all(high >= -MOST_FAR):
            raise SceneKeyError(
                f"{plan.scene.config.where}: geom '{geom_name(plan.scene.mjm, p.geom)}': reaches {reach:.4g} m from "
                f"the world's origin, and should end within {MOST_WIDE:g} m along each axis: rounding grows with "
                "distance. Use a plane, or smaller geoms."
            )


def _check_region(plan: Plan, o: PlacedObject, placed: set[str]) -> None:
    """Check that no point of a support on which an object may be placed is too far away.

    A support that is placed itself is checked for its size alone: its own region bounds how far it gets.
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
            f"{where}: '{o.config.support.parent}' reaches {reach:.4g} m from the world's origin, and objects "
            f"should be placed within {MOST_FAR:g} m of it along each axis: rounding grows with distance. Give it "
            "a 'region' nearer to the origin."
        )
