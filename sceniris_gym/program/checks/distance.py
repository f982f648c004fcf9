"""Checks that nothing stands or is placed where single precision is too coarse to tell whether it touches."""

from __future__ import annotations

import numpy as np

from sceniris_gym.config.bounds import BOUNDS, MOST_FAR, MOST_WIDE
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import PieceType, geom_name
from sceniris_gym.program.plan import PlacedObject, Plan
from sceniris_gym.scene.model import SceneModel


def check_distances(scene: SceneModel, plan: Plan) -> None:
    """Check that objects stay, and what they may meet ends, within distances that single precision resolves.

    What stands beyond them as a whole and is no object of the scene can meet nothing, and is left alone.

    Raises:
        SceneKeyError: An object that stands too far away or may be placed there, a geom that reaches too far, or a
            joint that is drawn too far out.
    """
    for name in scene.bodies:
        _check_start(scene, plan, name)
    for o in plan.objects:
        _check_region(scene, plan, o)
        _check_size(scene, plan, o)
        _check_draws(scene, o)
    for p in plan.pieces:
        if p.type == PieceType.PLANE:
            continue
        low, high = plan.extents(p)
        reach = float(np.abs([low, high]).max())
        if reach > MOST_WIDE and np.all(low <= MOST_FAR) and np.all(high >= -MOST_FAR):
            geom = scene.mjm.geom(p.geom).name or f"{p.geom} of body '{scene.mjm.body(p.body).name}'"
            raise SceneKeyError(
                f"{scene.config.where}: geom {geom!r}: reaches {reach:.4g} m from the world's origin, and should end "
                f"within {MOST_WIDE:g} m along each axis: rounding grows with distance. Use a plane, or smaller geoms."
            )


def _check_start(scene: SceneModel, plan: Plan, name: str) -> None:
    """Check that what is not placed stands near enough."""
    key, robot = scene.config.key(name), scene.config.all_robots.get(name)
    if robot is not None:
        key = f"{robot.section}.base" if robot.in_model is None else robot.key
    if name in scene.config.parts and scene.config.parts[name].is_placed:
        return
    at = plan.home.xpos[scene.bodies[name]]
    if np.abs(at).max() > MOST_FAR:
        place = ", ".join(f"{x:.4g}" for x in at)
        raise SceneKeyError(
            f"{scene.config.where}: {key}: stands at ({place}) m, and should be within {MOST_FAR:g} m of the world's "
            "origin along each axis: rounding grows with distance. Move the model to the origin."
        )


def _check_size(scene: SceneModel, plan: Plan, o: PlacedObject) -> None:
    """Check that what is placed ends near enough to its own frame, wherever that is at home."""
    if o.config is None or not o.config.is_placed:
        return
    for p in plan.pieces:
        reach = (
            float(np.abs(np.subtract(plan.extents(p), plan.home.xpos[o.bodies[0]])).max()) if p.body in o.bodies else 0
        )
        if reach > MOST_FAR:
            raise SceneKeyError(
                f"{scene.config.where}: {scene.config.key(o.name)}: geom '{geom_name(scene.mjm, p.geom)}' reaches "
                f"{reach:.4g} m from the object's origin, and should end within {MOST_FAR:g} m of it: rounding grows "
                "with distance. Correct its position, or give its mesh a smaller `scale`."
            )


def _check_draws(scene: SceneModel, o: PlacedObject) -> None:
    """Check that the limits, between which joints are drawn, are those of a mechanism."""
    bound = BOUNDS["joint"]
    for drawn in o.joint_ranges:
        ends = drawn.choice or (drawn.low, drawn.high)
        if not all(map(bound.holds, ends)):
            joint = scene.mjm.joint(int(np.flatnonzero(scene.mjm.jnt_qposadr == drawn.qposadr)[0])).name
            key = scene.config.key(o.name)
            raise SceneKeyError(
                f"{scene.config.where}: {key}.joints: '{joint}' is drawn between {min(ends):g} and {max(ends):g}, and "
                f"{bound.advice}. Correct its limits in the model, or give a 'range'."
            )


def _check_region(scene: SceneModel, plan: Plan, o: PlacedObject) -> None:
    """Check that no point of a support on which an object may be placed is too far away.

    On what is placed itself this is about its size: how far it may get is judged where it is placed.
    """
    if o.ground is None or o.config is None or o.config.support is None:
        return
    owner = None if o.support is None else o.support.owner
    moves = owner is not None and scene.config.parts[owner].is_placed
    pos = np.zeros(3) if moves else plan.home.xpos[o.ground]
    mat = np.eye(3) if moves else plan.home.xmat[o.ground].reshape(3, 3)
    for surface in {id(s): s for surfaces in o.surfaces for s in surfaces}.values():
        x0, y0, x1, y1 = surface.region.bounds
        corners = np.array([[x, y, surface.height] for x in (x0, x1) for y in (y0, y1)]) @ mat.T + pos
        reach = float(np.abs(corners).max())
        if reach > MOST_FAR + 1e-6:
            where = f"{scene.config.where}: {scene.config.key(o.name)}.{o.config.support.word}"
            raise SceneKeyError(
                f"{where}: '{o.config.support.parent}' reaches {reach:.4g} m from the world's origin, and objects "
                f"should be placed within {MOST_FAR:g} m of it along each axis: rounding grows with distance. Give it "
                "a 'region' nearer to the origin."
            )
