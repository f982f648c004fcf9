"""Checks that absent members of groups have room where they are parked, and that nothing else gets there."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.plan import PlacedObject, Plan
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.parking import LEVEL, PARKING_FROM, PARKING_SPACING

# Objects that may get beyond this [m] in both x and y are too close to the parked ones.
_NEAREST = PARKING_FROM - PARKING_SPACING


def check_parking(scene: SceneModel, plan: Plan) -> None:
    """Check that absent objects have room where they are parked, and that nothing else gets there.

    Raises:
        SceneKeyError: An object is too large to be parked, or something may get to where objects are parked.
    """
    absent = {name for group in scene.config.groups.values() if not group.always_whole for name in group.of}
    if not absent:
        return
    for o in plan.objects:
        if o.name in absent:
            _check_room(scene, o)
    corners = _home_corners(scene, plan)
    for o in plan.objects:
        corners[o.name] = _corner(scene, plan, o, corners)
    for name, corner in corners.items():
        if corner.min() > _NEAREST:
            path = f"objects.{name}" if name in scene.config.objects else f"body '{name}'"
            raise SceneKeyError(
                f"{scene.config.where}: {path}: reaches as far as ({corner[0]:.3g}, {corner[1]:.3g}) m, and absent "
                f"members of groups are parked from ({PARKING_FROM:g}, {PARKING_FROM:g}) m on. Bring it and what "
                "carries it nearer to the world's origin, or use no groups."
            )


def _check_room(scene: SceneModel, o: PlacedObject) -> None:
    """Check that neighbours on the lattice cannot touch."""
    edge = float((o.variants[0].bounds[2:] - o.variants[0].bounds[:2]).max())
    if edge >= PARKING_SPACING:
        raise SceneKeyError(
            f"{scene.config.where}: objects.{o.name}: is {edge:.3g} m wide and may be absent, and absent objects are "
            f"parked {PARKING_SPACING:g} m apart. Use something smaller, or take it out of its group."
        )


def _home_corners(scene: SceneModel, plan: Plan) -> dict[str, np.ndarray]:
    """How far [m] what rises above the ground reaches to the right and to the back at home, by object or body."""
    corners: dict[str, np.ndarray] = {}
    names = {body: name for name in scene.bodies for body in scene.subtree(name)}
    for p in plan.pieces:
        if p.type == PieceType.PLANE:
            continue
        high = plan.extents(p)[1]
        if high[2] > LEVEL:
            name = str(names.get(p.body) or scene.mjm.body(p.body).name)
            corners[name] = np.maximum(corners[name], high[:2]) if name in corners else high[:2]
    return corners


def _corner(scene: SceneModel, plan: Plan, o: PlacedObject, corners: dict[str, np.ndarray]) -> np.ndarray:
    """How far [m] an object may reach to the right and to the back, wherever it is placed, in any joint state."""
    size = _size(scene, plan, o)
    if o.config is None or not o.config.is_placed:
        return corners.get(o.name, np.full(2, -np.inf)) + (2.0 * size if o.joint_ranges else 0.0)
    if o.config.support is None:
        assert o.config.region is not None
        assert o.config.region.corners is not None
        at = np.array(o.config.region.corners[1][:2])
    elif o.support is not None and o.support.owner is not None:
        at = corners.get(o.support.owner, np.full(2, -np.inf))
    else:
        at = _far_corner(plan, o)
    return at + 2.0 * size


def _far_corner(plan: Plan, o: PlacedObject) -> np.ndarray:
    """How far [m] the region of an object reaches to the right and to the back, on what never moves."""
    assert o.ground is not None
    at, mat = plan.home.xpos[o.ground], plan.home.xmat[o.ground].reshape(3, 3)
    bounds = np.array([s.region.bounds for surfaces in o.surfaces for s in surfaces]).reshape(-1, 2, 2)
    corners = [[x, y, 0.0] for low, high in bounds for x in (low[0], high[0]) for y in (low[1], high[1])]
    return (np.array(corners) @ mat.T + at)[:, :2].max(axis=0)


def _size(scene: SceneModel, plan: Plan, o: PlacedObject) -> float:
    """A distance [m] from its root beyond which an object has no piece, in any joint state that is drawn."""
    mjm = scene.mjm
    own = [p for p in plan.pieces if p.body in o.bodies]
    if not own:
        return 0.0
    drawn = {d.qposadr: max(abs(d.low), abs(d.high), *map(abs, d.choice), 0.0) for d in o.joint_ranges}
    drawn |= {f.coupling.adr: max(abs(f.low), abs(f.high)) for f in o.followers}
    size = max(float(np.linalg.norm(np.maximum(*np.abs(p.bounds())))) for p in own)
    size += float(np.linalg.norm(mjm.body_pos[o.bodies[1:]], axis=1).sum())
    for joint in np.flatnonzero(np.isin(mjm.jnt_bodyid, o.bodies)):
        adr = int(mjm.jnt_qposadr[joint])
        if mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            size += drawn.get(adr, abs(float(scene.home_qpos[adr]))) + abs(float(mjm.qpos0[adr]))
        elif mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            size += 2.0 * float(np.linalg.norm(mjm.jnt_pos[joint]))
    return size
