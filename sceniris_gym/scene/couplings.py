"""Joints that follow others: MuJoCo's joint equalities, in the order in which they are to be applied.

An equality says `y - y0 = a0 + a1 (x - x0) + ... + a4 (x - x0)^4`, with y the position of its first joint, x that of
its second one, and y0 and x0 those of `qpos0`. Without a second joint the first one is held at `y0 + a0`.
"""

from __future__ import annotations

import copy
import graphlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError, in_a_cycle

# Positions that differ by less than this [m or rad] are equal but for rounding.
_SAME = 1e-9
# The range [m or rad] of a joint without limits in which followers may meet theirs.
_FAR = 1e3

_Coef = tuple[float, float, float, float]


@dataclass(frozen=True)
class Coupling:
    """A joint that follows another one, or is held.

    Attributes:
        label: The equality, as errors name it.
        follower: The joint that follows.
        driver: The joint that it follows, None where it is held.
        adr: Address of the follower in qpos.
        driver_adr: Address of the driver in qpos; the follower's own where it is held.
        origin: Position x0 of the driver [m or rad].
        offset: Position y0 + a0 of the follower [m or rad] where the driver is at x0.
        coef: a1 to a4; zeros where it is held.
        limits: Limits of the follower [m or rad], infinite where it has none.
    """

    label: str
    follower: int
    driver: int | None
    adr: int
    driver_adr: int
    origin: float
    offset: float
    coef: _Coef
    limits: tuple[float, float]

    def at(self, x: np.ndarray | float) -> np.ndarray:
        """Return the position of the follower [m or rad] when the driver is at x."""
        return np.polyval((*reversed(self.coef), self.offset), np.asarray(x, float) - self.origin)

    def over(self, low: float, high: float) -> tuple[float, float]:
        """Return the least and greatest position of the follower [m or rad] while the driver is in [low, high]."""
        return extremes(np.poly1d((*reversed(self.coef), self.offset)), low - self.origin, high - self.origin)


def extremes(polynomial: np.poly1d, low: float, high: float) -> tuple[float, float]:
    """Return the least and the greatest value of a polynomial in the interval [low, high]."""
    turns = np.roots(np.polyder(polynomial).coeffs)
    turns = turns.real[np.abs(turns.imag) < _SAME]
    values = polynomial(np.array([low, high, *turns[(turns > low) & (turns < high)]]))
    return float(values.min()), float(values.max())


def joint_couplings(mjm: mujoco.MjModel, where: str) -> tuple[Coupling, ...]:
    """Read the active joint equalities of a model, drivers before their followers.

    Args:
        mjm: The model.
        where: The beginning of errors.

    Raises:
        SceneKeyError: A joint that two equalities determine. Joints that follow each other.
    """
    found: dict[int, Coupling] = {}
    for eq in active_equalities(mjm):
        if mjm.eq_type[eq] != mujoco.mjtEq.mjEQ_JOINT:
            continue
        follower, driver = int(mjm.eq_obj1id[eq]), int(mjm.eq_obj2id[eq])
        held = driver < 0
        start, origin = mjm.qpos0[mjm.jnt_qposadr[[follower, follower if held else driver]]].tolist()
        offset, a1, a2, a3, a4 = mjm.eq_data[eq, :5].tolist()
        coef = (0.0, 0.0, 0.0, 0.0) if held else (a1, a2, a3, a4)
        label = equality_label(mjm, eq)
        coupling = _made(mjm, label, follower, None if held else driver, origin, start + offset, coef)
        other = found.setdefault(coupling.follower, coupling)
        if other is not coupling:
            raise SceneKeyError(
                f"{where}: {coupling.label}: joint '{mjm.joint(coupling.follower).name}' is determined by "
                f"{other.label} already. A joint should be the first one of one equality only; remove one of the two."
            )
    return tuple(_in_order(mjm, found, where))


def turned_round(mjm: mujoco.MjModel, couplings: Iterable[Coupling], drawn: Iterable[int]) -> tuple[Coupling, ...]:
    """Return the couplings, reversed where they would make a drawn joint follow one that is not drawn.

    Both directions are equivalent if the coupling is a straight line, x = x0 + (y - y0 - a0) / a1; others stay.

    Args:
        mjm: The model.
        couplings: Of the model.
        drawn: The joints that are drawn by name, the first ones first.
    """
    found, drawn = {c.follower: c for c in couplings}, list(drawn)
    for joint in drawn:
        chain = _chain(found, joint)
        if all(c.coef[0] != 0.0 and not any(c.coef[1:]) and c.driver not in drawn for c in chain):
            for c in chain:
                del found[c.follower]
            for c in chain:
                if c.driver is not None:  # the same line, with the driver following the follower
                    coef = (1.0 / c.coef[0], 0.0, 0.0, 0.0)
                    found[c.driver] = _made(mjm, c.label, c.driver, c.follower, c.offset, c.origin, coef)
    return tuple(_in_order(mjm, found, "couplings"))


def active_equalities(mjm: mujoco.MjModel) -> list[int]:
    """Return the ids of the equalities that MuJoCo enforces from the start."""
    disabled = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    if mjm.opt.disableflags & disabled:
        return []
    return [eq for eq in range(mjm.neq) if mjm.eq_active0[eq]]


def equality_label(mjm: mujoco.MjModel, eq: int) -> str:
    """Return the name of an equality in errors: its kind, and its name or number."""
    kind = mujoco.mjtEq(int(mjm.eq_type[eq])).name.removeprefix("mjEQ_").lower()
    name = mjm.equality(eq).name
    return f"equality '{name}' ({kind})" if name else f"equality {eq} ({kind})"


def equality_errors(mjm: mujoco.MjModel, states: np.ndarray) -> np.ndarray:
    """Return how far states (n, nq) miss each equality [m or rad], shape (n, neq), by MuJoCo C; 0 for inactive ones."""
    alone = copy.copy(mjm)
    alone.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)  # objects may lie on top of each other
    data, missed = mujoco.MjData(alone), np.zeros((len(states), mjm.neq))
    for row, qpos in enumerate(states):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(alone, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        np.maximum.at(missed[row], data.efc_id[rows], np.abs(data.efc_pos[rows]))
    return missed


def follow(couplings: Iterable[Coupling], qpos: np.ndarray) -> None:
    """Set the positions of all joints that follow others, in place.

    Args:
        couplings: In order, drivers before their followers.
        qpos: Positions, shape (..., nq).
    """
    for c in couplings:
        wanted = c.at(qpos[..., c.driver_adr])
        qpos[..., c.adr] = np.where(np.abs(qpos[..., c.adr] - wanted) < _SAME, qpos[..., c.adr], wanted)


def driven_by(couplings: Iterable[Coupling], joints: Iterable[int]) -> list[Coupling]:
    """Return the couplings that move along with any of these joints, directly or through others, in order."""
    moving, found = set(joints), []
    for c in couplings:
        if c.driver in moving:
            moving.add(c.follower)
            found.append(c)
    return found


def free_range(mjm: mujoco.MjModel, couplings: Iterable[Coupling], joint: int, home: np.ndarray) -> tuple[float, float]:
    """Return the interval around home in which a joint and all its followers stay within their limits.

    Without followers it is the interval of the joint's own limits.

    Args:
        mjm: The model.
        couplings: Of the model, in order.
        joint: The joint.
        home: The start pose, shape (nq,).
    """
    low, high = _limits(mjm, joint)
    driven = driven_by(couplings, [joint])
    adr, qpos = int(mjm.jnt_qposadr[joint]), home.copy()

    def within(x: float) -> bool:
        qpos[adr] = x
        for c in driven:
            qpos[c.adr] = c.at(qpos[c.driver_adr])
        return all(c.limits[0] - _SAME <= qpos[c.adr] <= c.limits[1] + _SAME for c in driven)

    start = float(home[adr])
    if not np.isfinite([c.limits for c in driven]).any() or not within(start):
        return low, high
    return _farthest(within, start, low), _farthest(within, start, high)


def _farthest(within, start: float, end: float) -> float:
    """Return the farthest position towards `end` that a joint may take, by bisection; `end` itself if it may."""
    goal = end if np.isfinite(end) else float(np.copysign(_FAR, end))
    if within(goal):
        return end
    good, bad = start, goal
    for _ in range(80):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if within(middle) else (good, middle)
    return good


def _made(
    mjm: mujoco.MjModel, label: str, follower: int, driver: int | None, origin: float, offset: float, coef: _Coef
) -> Coupling:
    """Return a coupling of two joints, or of one that is held, with what the model says about them."""
    adr = int(mjm.jnt_qposadr[follower])
    driver_adr = adr if driver is None else int(mjm.jnt_qposadr[driver])
    return Coupling(label, follower, driver, adr, driver_adr, origin, offset, coef, _limits(mjm, follower))


def _chain(found: dict[int, Coupling], joint: int) -> list[Coupling]:
    """Return the couplings from a joint up to the first driver, in that order."""
    chain: list[Coupling] = []
    follower: int | None = joint
    while follower in found:
        chain.append(found[follower])
        follower = chain[-1].driver
    return chain


def _limits(mjm: mujoco.MjModel, joint: int) -> tuple[float, float]:
    low, high = mjm.jnt_range[joint] if mjm.jnt_limited[joint] else (-np.inf, np.inf)
    return float(low), float(high)


def _in_order(mjm: mujoco.MjModel, found: dict[int, Coupling], where: str) -> list[Coupling]:
    """Return the couplings, each after the one that its driver follows."""
    drivers = {joint: [c.driver] if c.driver in found else [] for joint, c in found.items()}
    try:
        return [found[joint] for joint in graphlib.TopologicalSorter(drivers).static_order()]
    except graphlib.CycleError as error:
        names = [mjm.joint(joint).name for joint in error.args[1][:0:-1]]
        raise in_a_cycle(where, names, "joints follow each other by equalities") from None


def joined_bodies(mjm: mujoco.MjModel, eq: int) -> tuple[int, ...]:
    """Return the two bodies that a weld or a connect joins; none for other equalities."""
    if mujoco.mjtEq(int(mjm.eq_type[eq])) not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        return ()
    ends = [int(mjm.eq_obj1id[eq]), int(mjm.eq_obj2id[eq])]
    is_site = mjm.eq_objtype[eq] == mujoco.mjtObj.mjOBJ_SITE
    return tuple(mjm.site_bodyid[ends].tolist() if is_site else ends)


def coupling_arrays(couplings: Sequence[Coupling]) -> dict[str, np.ndarray]:
    """Return the fields `follow_*` of a device struct."""
    return {
        "follow_driveradr": np.array([c.driver_adr for c in couplings], int),
        "follow_qposadr": np.array([c.adr for c in couplings], int),
        "follow_coef": np.reshape([(c.origin, c.offset, *c.coef) for c in couplings], (-1, 6)).astype(float),
    }
