"""Check of parking: absent members of groups have room where they are parked, and nothing else gets there."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.plan import Plan
from sceniris_gym.scene.parking import LEVEL, PARKING_FROM, PARKING_SPACING

# An object that may get beyond this [m] in both x and y is too close to the parked ones.
_NEAREST = PARKING_FROM - PARKING_SPACING


def check_parking(plan: Plan) -> None:
    """Check that absent objects have room where they are parked, and that nothing else gets there.

    Raises:
        SceneKeyError: An object is too large to be parked, or something may get to where objects are parked.
    """
    config = plan.scene.config
    if not config.absent:
        return
    for o in (o for o in plan.objects if o.name in config.absent):
        edge = float((o.variants[0].bounds[2:] - o.variants[0].bounds[:2]).max())
        if edge >= PARKING_SPACING:  # neighbours on the lattice would touch
            cure = "leave this variant out" if o.name in config.owners else "take it out of its group"
            raise SceneKeyError(
                f"{config.where}: objects.{o.name}: is {edge:.3g} m wide and may be absent, and absent objects are "
                f"parked {PARKING_SPACING:g} m apart. Use something smaller, or {cure}."
            )
    corners: dict[str, np.ndarray] = {}  # at home, of all that rises above the ground
    for p, _, high in plan.solids:
        if high[2] > LEVEL:
            name = plan.scene.owners.get(p.body) or str(plan.scene.mjm.body(p.body).name)
            corners[name] = np.maximum(corners[name], high[:2]) if name in corners else high[:2]
    for o in plan.objects:
        corners[o.name] = _corner(plan, o, corners)
    for name, corner in corners.items():
        if corner.min() > _NEAREST:
            path = f"objects.{name}" if name in config.objects else f"body '{name}'"
            raise SceneKeyError(
                f"{config.where}: {path}: reaches as far as ({corner[0]:.3g}, {corner[1]:.3g}) m, and absent members "
                f"of groups are parked from ({PARKING_FROM:g}, {PARKING_FROM:g}) m on. Bring it and what carries it "
                "nearer to the world's origin, or use no groups."
            )


def _corner(plan: Plan, o: PlacedObject, corners: dict[str, np.ndarray]) -> np.ndarray:
    """Return the greatest x and y [m] that an object may reach, wherever it is placed, in any joint state."""
    size = _size(plan, o)
    if not o.config.is_placed:
        return corners.get(o.name, np.full(2, -np.inf)) + (2.0 * size if o.joint_ranges else 0.0)
    if o.config.support is None:
        assert o.config.region is not None
        assert o.config.region.corners is not None
        at = np.array(o.config.region.corners[1][:2])
    elif o.support is not None and o.support.owner is not None:
        at = corners.get(o.support.owner, np.full(2, -np.inf))
    else:  # on a support that stays
        assert o.ground is not None
        pos, mat = plan.scene.home.xpos[o.ground], plan.scene.home.xmat[o.ground].reshape(3, 3)
        at = (o.corners @ mat.T + pos)[:, :2].max(axis=0)
    return at + 2.0 * size


def _size(plan: Plan, o: PlacedObject) -> float:
    """Return a distance [m] from its root beyond which an object has no piece, in any joint state that is drawn."""
    mjm = plan.scene.mjm
    own = [p for p in plan.pieces if p.body in o.bodies]
    if not own:
        return 0.0
    drawn = {adr: max(map(abs, ends)) for adr, ends in o.spans.items()}
    size = max(float(np.linalg.norm(np.maximum(*np.abs(p.bounds())))) for p in own)
    size += float(np.linalg.norm(mjm.body_pos[o.bodies[1:]], axis=1).sum())
    for joint in np.flatnonzero(np.isin(mjm.jnt_bodyid, o.bodies)):
        adr = int(mjm.jnt_qposadr[joint])
        if mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            size += drawn.get(adr, abs(float(plan.scene.home_qpos[adr]))) + abs(float(mjm.qpos0[adr]))
        elif mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            size += 2.0 * float(np.linalg.norm(mjm.jnt_pos[joint]))
    return size
