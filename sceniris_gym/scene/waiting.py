"""Where absent members of groups wait: on a square lattice far away, which nothing that is placed may reach.

Absent objects are laid down without a test against anything, and what was placed before them was not tested against
them. That is right as long as nothing gets there and all of them lie in places of their own, which is seen to here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.scene.device import PieceType
from sceniris_gym.scene.limits import WAITING_COLUMNS, WAITING_FROM, WAITING_SPACING
from sceniris_gym.scene.values import FLOOR

if TYPE_CHECKING:
    from sceniris_gym.scene.model import SceneModel
    from sceniris_gym.scene.program import PlacedObject, Plan

# Both coordinates [m] of what is nearer to the lattice than this are refused.
_NEAREST = WAITING_FROM - WAITING_SPACING
_LEVEL = 1.0e-3


def add_waiting_ground(spec: mujoco.MjSpec, nslot: int) -> None:
    """Add a slab far away for the absent among `nslot` objects to lie on."""
    low, high = _corners(nslot)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + 1.0
    spec.worldbody.add_geom(
        name="waiting_ground",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[*middle, -0.05],
        size=[*half, 0.05],
        group=3,
    )


def has_waiting_ground(mjm: mujoco.MjModel, nslot: int, where: str) -> bool:
    """Whether a plane of the model is the ground on which absent objects lie, at z = 0.

    Raises:
        SceneKeyError: a plane that they would lie under.
    """
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    low, high = _corners(nslot)
    corners = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
    found = False
    for geom in np.flatnonzero(mjm.geom_type == mujoco.mjtGeom.mjGEOM_PLANE):
        over = (corners - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)[:, 2]
        if not mjm.geom_contype[geom] | mjm.geom_conaffinity[geom]:
            continue
        if over.min() < -_LEVEL:
            raise SceneKeyError(
                f"{where}: groups: the plane '{mjm.geom(geom).name or geom}' lies above the ground (z = 0) at "
                f"({WAITING_FROM:g}, {WAITING_FROM:g}) m, where absent objects wait. Lower it, or use a box."
            )
        found = found or over.max() < _LEVEL
    return found


def check_waiting(scene: SceneModel, plan: Plan) -> None:
    """Check that absent objects have room where they wait, and that nothing else gets there.

    Raises:
        SceneKeyError: an object that is too large to wait, or something that may stand where others wait.
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
                f"{scene.config.where}: {path}: reaches as far as ({corner[0]:.3g}, {corner[1]:.3g}) m, and "
                f"absent members of groups wait from ({WAITING_FROM:g}, {WAITING_FROM:g}) m on. Bring it and what "
                "carries it nearer to the world's origin, or use no groups."
            )


def _corners(nslot: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner [m] of the rectangle in which objects wait, with half a place around them."""
    rows = max(WAITING_COLUMNS, math.ceil(nslot / WAITING_COLUMNS))
    low = np.full(2, WAITING_FROM - 0.5 * WAITING_SPACING)
    return low, low + WAITING_SPACING * np.array([WAITING_COLUMNS, rows])


def _check_room(scene: SceneModel, o: PlacedObject) -> None:
    """Neighbours on the lattice must not touch."""
    edge = float((o.variants[0].bounds[2:] - o.variants[0].bounds[:2]).max())
    if edge >= WAITING_SPACING:
        raise SceneKeyError(
            f"{scene.config.where}: objects.{o.name}: is {edge:.3g} m wide and may be absent, and what is absent waits "
            f"{WAITING_SPACING:g} m apart. Use something smaller, or take it out of its group."
        )


def _home_corners(scene: SceneModel, plan: Plan) -> dict[str, np.ndarray]:
    """How far [m] what rises above the ground reaches to the right and to the back at home, by object or body."""
    corners: dict[str, np.ndarray] = {}
    names = {body: name for name in scene.bodies for body in scene.subtree(name)}
    for p in plan.pieces:
        if p.type == PieceType.PLANE:
            continue
        high = plan.home.xpos[p.body] + p.extents(plan.home.xmat[p.body].reshape(3, 3))[1]
        if high[2] > _LEVEL:
            name = str(names.get(p.body) or scene.mjm.body(p.body).name)
            corners[name] = np.maximum(corners[name], high[:2]) if name in corners else high[:2]
    return corners


def _corner(scene: SceneModel, plan: Plan, o: PlacedObject, corners: dict[str, np.ndarray]) -> np.ndarray:
    """How far [m] an object may reach to the right and to the back, wherever it is placed, in any joint state."""
    size = _size(scene, plan, o)
    if o.config is None or not o.config.is_placed:
        return corners.get(o.name, np.full(2, -np.inf)) + (2.0 * size if o.draws else 0.0)
    if o.config.support is None:
        assert o.config.region is not None
        assert o.config.region.box is not None
        at = np.array(o.config.region.box[1][:2])
    elif o.config.support.parent == FLOOR:
        assert scene.config.floor is not None
        at = 0.5 * np.array(scene.config.floor.size)
    else:
        at = corners.get(o.config.support.parent.split("/")[0], np.full(2, -np.inf))
    return at + 2.0 * size


def _size(scene: SceneModel, plan: Plan, o: PlacedObject) -> float:
    """A distance [m] from its root beyond which an object has no piece, in any joint state that is drawn."""
    mjm = scene.mjm
    own = [p for p in plan.pieces if p.body in o.bodies]
    if not own:
        return 0.0
    drawn = {d.qposadr: max(abs(d.low), abs(d.high), *map(abs, d.choice), 0.0) for d in o.draws}
    size = max(float(np.linalg.norm(np.maximum(*np.abs(p.bounds())))) for p in own)
    size += float(np.linalg.norm(mjm.body_pos[o.bodies[1:]], axis=1).sum())
    for joint in np.flatnonzero(np.isin(mjm.jnt_bodyid, o.bodies)):
        adr = int(mjm.jnt_qposadr[joint])
        if mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            size += drawn.get(adr, abs(float(scene.home_qpos[adr]))) + abs(float(mjm.qpos0[adr]))
        elif mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            size += 2.0 * float(np.linalg.norm(mjm.jnt_pos[joint]))
    return size
