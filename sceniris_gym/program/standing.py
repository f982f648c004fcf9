"""How free objects stand: their feet, the springs of MuJoCo's contacts below them, and what they carry."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import shapely

from sceniris_gym.geometry.feet import foot
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces
from sceniris_gym.geometry.resting_poses import HomeShape, Variant
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.resting import touch_distances

if TYPE_CHECKING:
    from sceniris_gym.program.plan import Plan

# Pieces that begin this far [m] above the lowest one carry nothing.
_LOW = 5.0e-4


@dataclass(frozen=True)
class Law:
    """The margin that keeps a load from falling; `placement/standing.py` has the formula and its measurement.

    Attributes:
        margin: The least distance [m] of its centre from the edge of what carries it.
        shake: What its fall adds to that, as a share of the root of fall times height.
        move: The greatest move [m] of the uppermost object while it comes to rest.
    """

    margin: float
    shake: float
    move: float


BOXES, OTHERS = Law(0.0, 0.17, 0.016), Law(5.0e-4, 0.3, 9.25e-3)
"""The laws of boxes on boxes or planes, and of all other contacts, of which MuJoCo finds fewer points."""


@dataclass(frozen=True)
class Stance:
    """What carries an object that has to stand.

    Attributes:
        carrier: The object that carries it, as its number in `Plan.objects`, if that is free; else None.
        feet: Its foot in each of its variants, corners around its pivot [m] at heading 0, and whether it is curved.
        spring: Of its contacts: sink under a weight of 1 kg on one rigid contact [m], and the least and the greatest
            impedance and the depth between them [m], as in MuJoCo's solimp.
        law: The margin that it needs.
        is_whole: Whether all of its foot is on its support.
        meets: Whether it collides with its support at all.
    """

    carrier: int | None
    feet: list[tuple[np.ndarray, bool]]
    spring: np.ndarray
    law: Law
    is_whole: bool
    meets: bool

    @property
    def is_certain(self) -> bool:
        """True if it stands wherever it is placed, so that only what is put on it needs a test."""
        return self.carrier is None and self.is_whole


NO_STANCE = Stance(None, [], np.array([0.0, 0.9, 0.95, 1e-3]), BOXES, is_whole=True, meets=True)
"""The stance of what need not stand."""


def stances(plan: Plan) -> list[Stance | None]:
    """Return how each object of a plan stands, None for all that need not."""
    number = {o.name: i for i, o in enumerate(plan.objects)}
    return [
        _stance(plan, o, number) if o.config is not None and o.config.has_to_stand and o.heap is None else None
        for o in plan.objects
    ]


def carrier_of(o: PlacedObject, objects: Iterable[PlacedObject]) -> int | None:
    """Return the number of the placed free object that carries an object, None if there is none."""
    owner = None if o.support is None else o.support.owner
    return next(
        (i for i, x in enumerate(objects) if x.name == owner and x.config is not None and x.config.kind == "free"), None
    )


def _stance(plan: Plan, o: PlacedObject, number: dict[str, int]) -> Stance:
    """Work out how one object stands."""
    scene, support = plan.scene, o.support
    assert support is not None
    assert o.config is not None
    pieces = extract_pieces(scene.mjm, "physics", set(o.bodies))
    touch = touch_distances(scene, pieces, support.body)
    own = [p for p, distance in zip(pieces, touch, strict=True) if distance is not None and p.mesh is not None]
    below = [p for p in plan.pieces if p.body == support.body and support.geom in (None, p.geom)]
    shape = HomeShape(plan.home, o.bodies[0], own)
    feet = [foot(_in_pose(shape.points(), v)) if own else (np.zeros((1, 2)), True) for v in o.variants]
    whole = support.is_floor or all(s.is_endless for surfaces in o.surfaces for s in surfaces)
    boxes = {PieceType.BOX, PieceType.PLANE}
    owner = scene.config.objects.get(support.owner or "")
    return Stance(
        carrier=number.get(support.owner or "") if owner is not None and owner.has_to_stand else None,
        feet=feet,
        spring=_softest(scene.mjm, [p.geom for p in own], [p.geom for p in below]),
        law=BOXES if {p.type for p in (*own, *below)} <= boxes else OTHERS,
        is_whole=whole or o.config.ratio_on_support == 1.0 or _lies_inside(o, [corners for corners, _ in feet]),
        meets=bool(own),
    )


def _in_pose(points: np.ndarray, variant: Variant) -> np.ndarray:
    """Return points of the root's frame [m] around the pivot of a pose, shape (n, 3)."""
    return (points - variant.pivot) @ matrix(variant.quat).T


def _lies_inside(o: PlacedObject, feet: list[np.ndarray]) -> bool:
    """Return whether the foot lies on its support in any heading, wherever in its region the pivot is."""
    return all(
        s.outline.contains(shapely.buffer(s.region, np.linalg.norm(corners, axis=1).max()))
        for surfaces, corners in zip(o.surfaces, feet, strict=True)
        for s in surfaces
    )


def _softest(mjm: mujoco.MjModel, own: list[int], below: list[int]) -> np.ndarray:
    """Return the spring of the softest contact of two lists of geoms; see `Stance.spring`."""
    springs = [_spring(mjm, a, b) for a in own for b in below]
    return max(springs, key=lambda s: s[0], default=np.array([0.0, 0.9, 0.95, 1e-3]))


def _spring(mjm: mujoco.MjModel, a: int, b: int) -> np.ndarray:
    """Return the spring of a contact, by the mixing and the impedance of the chapter "Computation" of MuJoCo's manual.

    At rest a contact with impedance d under a force f is (1 - d) / d^2 w f / k deep, where w is the sum of the inverse
    weights of its bodies, k = 1 / (dmax^2 timeconst^2 dampratio^2), and d grows with the depth from dmin to dmax.
    """
    share = mjm.geom_solmix[a] / max(mjm.geom_solmix[a] + mjm.geom_solmix[b], mujoco.mjMINVAL)
    if mjm.geom_priority[a] != mjm.geom_priority[b]:
        share = float(mjm.geom_priority[a] > mjm.geom_priority[b])
    ref, imp = (share * x[a] + (1.0 - share) * x[b] for x in (mjm.geom_solref, mjm.geom_solimp))
    if 0.0 < share < 1.0 and min(mjm.geom_solref[a][0], mjm.geom_solref[b][0]) <= 0.0:
        ref = np.minimum(mjm.geom_solref[a], mjm.geom_solref[b])
    if mjm.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        ref, imp = mjm.opt.o_solref, mjm.opt.o_solimp
    least, most = np.clip(imp[:2], mujoco.mjMINIMP, mujoco.mjMAXIMP)
    stiff = -ref[0] / most**2
    if ref[0] > 0.0:
        time = ref[0] if mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE else max(ref[0], 2 * mjm.opt.timestep)
        stiff = 1.0 / (most * time * ref[1]) ** 2
    weight = mjm.body_invweight0[mjm.geom_bodyid[[a, b]], 0].sum()
    gravity = np.linalg.norm(mjm.opt.gravity)
    return np.array([gravity * weight / max(stiff, mujoco.mjMINVAL), least, most, max(imp[2], mujoco.mjMINVAL)])
