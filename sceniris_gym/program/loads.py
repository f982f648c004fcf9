"""Worst effects of drawn physics on standing objects: how deep they sink, and how far gravity and wind tilt a load."""

import copy
from itertools import product
from typing import NamedTuple

import mujoco
import numpy as np

from sceniris_gym.geometry.pieces import ROUND, Piece, PieceType
from sceniris_gym.geometry.resting_poses import HomeShape, StablePose, weights
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.scene.model import SceneModel

CONTACTS = 4
"""Greatest number of contacts of a piece on a flat support."""
# Number of contacts of round pieces that stand upright, and that lie. A piece lies if the vertical part of its axis is
# below the third number.
_UPRIGHT, _LYING = {PieceType.CYLINDER: 3}, {PieceType.CYLINDER: 2, PieceType.CAPSULE: 2}
_LYING_BELOW = 0.7
# Points at this height [m] or above never touch the support: an object that sinks deeper is rejected.
_HIGHEST = 5.0e-3
# Number of depths in the table of a contact's impedance.
_GRID = 1001


class Contact(NamedTuple):
    """The softest contact of two geoms.

    If `randomize` draws the parameters of a contact, the softest contact combines the worst ends of these draws.

    Attributes:
        own, below: Body of the upper geom, and body of the lower geom.
        ref: The contact's `solref`.
        imps: The contact's `solimp`, once for each combination of the ends of its draws.
        cone: Factor in the depth of the contact. The factor depends on friction.
        friction: The contact's least coefficient of sliding friction.
    """

    own: int
    below: int
    ref: tuple[float, ...]
    imps: frozenset[tuple[float, ...]]
    cone: float
    friction: float


def contact_of(scene: SceneModel, a: int, b: int) -> Contact:
    """Return the softest contact of two geoms, by the chapter "Computation" of MuJoCo's manual.

    The contact's parameters come from an explicit contact pair, from the geom of higher priority, or from a mix of both
    geoms. With a pyramidal friction cone, MuJoCo derives the softness of all n edges from the first edge. A friction
    coefficient m therefore multiplies the softness by m^2 (1 + m^2) / (n / 2).
    """
    mjm, least, most = scene.mjm, scene.least, scene.most
    rank = mjm.geom_priority[[a, b]]
    first = np.array([a, b])[rank == rank.max()]
    mix = np.maximum(mjm.geom_solmix[first], mujoco.mjMINVAL)
    fields = most.geom_solref, least.geom_solimp, most.geom_solimp
    ref, *imps = (np.average(x[first], axis=0, weights=mix) for x in fields)
    if most.geom_solref[first, 0].min() <= 0.0:
        ref = most.geom_solref[first].min(axis=0)
    frictions = [least.geom_friction[first, 0].max(), most.geom_friction[first, 0].max()]
    dim = mjm.geom_condim[first].max()
    for pair in np.flatnonzero(np.isin(mjm.pair_geom1, (a, b)) & np.isin(mjm.pair_geom2, (a, b))):
        ref, imps, dim = mjm.pair_solref[pair], [mjm.pair_solimp[pair]] * 2, mjm.pair_dim[pair]
        frictions = [mjm.pair_friction[pair, 0]] * 2
    if mjm.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        ref, imps, frictions = mjm.opt.o_solref, [mjm.opt.o_solimp] * 2, [mjm.opt.o_friction[0]] * 2
    cone, square = 1.0, float(frictions[1]) ** 2
    if dim > 1 and mjm.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL:
        cone = square * (1.0 + square) / (mjm.opt.impratio * int(dim - 1))
    ends = frozenset(product(*np.transpose(imps).tolist()))
    own, below = mjm.geom_bodyid[[a, b]].tolist()
    return Contact(own, below, tuple(ref.tolist()), ends, cone, float(frictions[0]) if dim > 1 else 0.0)


def contact_heights(pieces: list[Piece], shape: HomeShape, pose: StablePose) -> np.ndarray:
    """Return the heights [m] of points at which an object that sinks into level ground touches the ground.

    Args:
        pieces: The pieces of the object.
        shape: The shape of these pieces.
        pose: The stable pose of the object.

    Returns:
        The heights over the lowest of these points, shape (npiece, `CONTACTS`). If a piece has fewer contacts, the
        rest of its row is inf.
    """
    found, up = np.full((len(pieces), CONTACTS), np.inf), matrix(pose.quat)[2]
    for p, points, axis, row in zip(pieces, shape.points(), shape.axes(), found, strict=True):
        lowest = np.sort(points @ up)[:CONTACTS]
        if p.type in ROUND:
            lowest = lowest[:1].repeat((_LYING if abs(axis @ up) < _LYING_BELOW else _UPRIGHT).get(p.type, 1))
        row[: len(lowest)] = lowest
    return found - found.min()


def deepest(
    scene: SceneModel, contacts: list[set[Contact]], foot: np.ndarray, bodies: list[int], load: float, is_whole: bool
) -> float:
    """Return the greatest depth [m] to which an object sinks, over all drawn masses of the object and its support.

    A light object sinks deepest under its load, because contacts get harder with the mass of the object.

    Args:
        scene: The scene.
        contacts: For each piece of the object, the contacts of the piece with the support.
        foot: Heights of these contacts, as `contact_heights` returns them. The object sinks until its lowest contacts
            carry it.
        bodies: The bodies of the object.
        load: Greatest weight [kg] of the object and everything on it.
        is_whole: Whether the whole foot of the object is on the support. If not, only half of its contacts carry it.
    """
    heights, light, found = np.sort(foot[foot < _HIGHEST]), scene.least.body_invweight0[:, 0], 0.0
    heights = heights if is_whole else heights[: max(len(heights) // 2, CONTACTS)]
    number, above = np.arange(1, len(heights) + 1), load - weights(scene.most)[bodies].sum()
    touching = set().union(*(own for own, at in zip(contacts, foot.min(axis=1), strict=True) if at < _HIGHEST))
    for contact, mjm in product(touching, (scene.least, scene.most)):
        inverse = mjm.body_invweight0[contact.own, 0] + light[contact.below]
        depths = depth_of(scene, contact, (above + weights(mjm)[bodies].sum()) / number, inverse)
        found = max(found, float((depths + np.cumsum(heights) / number).min()))
    return found


def depth_of(scene: SceneModel, contact: Contact, load: np.ndarray | float, inverse: float) -> np.ndarray:
    """Return the depths [m] at which a contact carries loads [kg], with the greatest pull of gravity.

    At rest, a contact with impedance d under a force f has the depth (1 - d) / d^2 w f / k. Here w is the sum of the
    inverse weights of both bodies [1/kg], and k = 1 / (dmax^2 timeconst^2 dampratio^2). The impedance d grows with the
    depth from dmin to dmax, as in the chapter "Computation" of MuJoCo's manual.
    """
    opt, ref = scene.mjm.opt, contact.ref
    gravity = np.linalg.norm(np.maximum(np.abs(scene.least.opt.gravity), np.abs(scene.most.opt.gravity)))
    force, found = load * gravity * inverse * contact.cone, np.zeros(np.shape(load))
    lower = [mujoco.mjMINIMP, mujoco.mjMINIMP, mujoco.mjMINVAL, mujoco.mjMINIMP, 1.0]
    upper = [mujoco.mjMAXIMP, mujoco.mjMAXIMP, np.inf, mujoco.mjMAXIMP, np.inf]
    for least, most, width, middle, power in np.clip(list(contact.imps), lower, upper):
        stiff = -ref[0] / most**2
        if ref[0] > 0.0:
            is_safe = not opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE
            stiff = 1.0 / (most * max(ref[0], 2.0 * opt.timestep * is_safe) * ref[1]) ** 2
        x = np.linspace(0.0, 1.0, _GRID)
        early, late = middle ** (1.0 - power) * x**power, 1.0 - (1.0 - middle) ** (1.0 - power) * (1.0 - x) ** power
        d = least + np.where(x < middle, early, late) * (most - least)
        share = force / max(stiff, mujoco.mjMINVAL)
        depth = np.interp(share, width * x * d**2 / (1.0 - d), width * x)
        found = np.maximum(found, np.maximum(depth, share * (1.0 - most) / most**2))  # dmax holds at greater depths
    return found


def least_upright(scene: SceneModel) -> np.ndarray:
    """Return the drawn gravity [m/s^2] that points furthest from straight down, shape (3,)."""
    low, high = scene.least.opt.gravity, scene.most.opt.gravity
    return np.array([*np.where(np.abs(low) > np.abs(high), low, high)[:2], high[2]])


def wind_push(scene: SceneModel, o: PlacedObject) -> float:
    """Return the greatest force of the wind on a free object, divided by the object's least mass [N/kg].

    The wind is tried along each inertial axis of the object's root body.
    """
    speed = np.linalg.norm(np.maximum(np.abs(scene.least.opt.wind), np.abs(scene.most.opt.wind)))
    if not speed:
        return 0.0
    windy, data, found = copy.copy(scene.least), mujoco.MjData(scene.mjm), 0.0
    dof = windy.body_dofadr[o.bodies[0]]
    for axis in scene.home.ximat[o.bodies[0]].reshape(3, 3).T:
        windy.opt.wind, data.qpos[:] = speed * axis, scene.home_qpos
        mujoco.mj_fwdPosition(windy, data)
        mujoco.mj_fwdVelocity(windy, data)
        found = max(found, float(np.linalg.norm(data.qfrc_fluid[dof : dof + 3])))
    return found / windy.body_mass[o.bodies].sum()


def tilt_of(scene: SceneModel, objects: list[PlacedObject]) -> float:
    """Return the tangent of the greatest angle between straight down and the pull of gravity and wind on objects."""
    pull, push = least_upright(scene), max((wind_push(scene, o) for o in objects), default=0.0)
    return float((np.hypot(*pull[:2]) + push) / max(-pull[2] - push, mujoco.mjMINVAL))
