"""Joints that follow others by MuJoCo's joint equalities, in the order of their evaluation.

An equality requires `y - y0 = a0 + a1 (x - x0) + ... + a4 (x - x0)^4`. Here y and x are the positions of its first and
second joint, and y0 and x0 are their positions in `qpos0`. Without a second joint, the first is held at `y0 + a0`.
"""

import copy
import graphlib
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError, in_a_cycle

# Positions that differ by less than this [m or rad] are equal up to rounding.
_SAME = 1e-9
# Search range [m or rad] of a joint without limits, for positions where its followers reach their limits.
_FAR = 1e3

_Coef = tuple[float, float, float, float]


class Coupling(NamedTuple):
    """A joint that follows another joint, or is held.

    Attributes:
        label: The equality's name in errors.
        follower: The joint that follows.
        driver: The joint that the follower follows, or None if the follower is held.
        adr: Address of the follower in qpos.
        driver_adr: Address of the driver in qpos, or the address of the follower if the follower is held.
        origin: Position x0 of the driver [m or rad].
        offset: Position y0 + a0 of the follower [m or rad] when the driver is at x0.
        coef: a1 to a4, or zeros if the follower is held.
        limits: Limits of the follower [m or rad], infinite if it is unlimited.
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
        """Return the lowest and highest position of the follower [m or rad] while the driver is in [low, high]."""
        return extremes(np.poly1d((*reversed(self.coef), self.offset)), low - self.origin, high - self.origin)


def extremes(polynomial: np.poly1d, low: float, high: float) -> tuple[float, float]:
    """Return the minimum and the maximum of a polynomial in the interval [low, high]."""
    extrema = np.roots(np.polyder(polynomial).coeffs)
    extrema = extrema.real[np.abs(extrema.imag) < _SAME]
    values = polynomial(np.array([low, high, *extrema[(extrema > low) & (extrema < high)]]))
    return float(values.min()), float(values.max())


def joint_couplings(mjm: mujoco.MjModel, where: str) -> tuple[Coupling, ...]:
    """Read the active joint equalities of a model, drivers before their followers.

    A second equality of the same first joint is reversed if it is linear: its second joint follows the first joint.

    Args:
        mjm: The model.
        where: The text at the beginning of error messages.

    Raises:
        SceneKeyError: Two equalities determine the same joint, or joints follow each other in a cycle.
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
        coupling = couple(mjm, label, follower, None if held else driver, origin, start + offset, coef)
        if follower in found and driver not in found and not held and _is_linear(coupling):
            coupling = _swapped(mjm, coupling)
        other = found.setdefault(coupling.follower, coupling)
        if other is not coupling:
            raise SceneKeyError(
                f"{where}: {coupling.label}: joint '{mjm.joint(coupling.follower).name}' is determined by "
                f"{other.label} already. A joint should be the first joint of at most one equality. Remove one of them."
            )
    return tuple(_in_order(mjm, found, where))


def reversed_for(mjm: mujoco.MjModel, couplings: Iterable[Coupling], drawn: Iterable[int]) -> tuple[Coupling, ...]:
    """Return the couplings, reversed if a drawn joint would follow a joint that is not drawn.

    Only linear couplings are reversed, as they can be inverted: x = x0 + (y - y0 - a0) / a1.

    Args:
        mjm: The model.
        couplings: The model's couplings.
        drawn: The joints that the scene file draws by name. If two follow the same joint, the first becomes the driver.
    """
    found, drawn = {c.follower: c for c in couplings}, list(drawn)
    for joint in drawn:
        chain = _chain(found, joint)
        if all(_is_linear(c) and c.driver not in drawn for c in chain):
            for c in chain:
                del found[c.follower]
            for c in chain:
                if c.driver is not None:
                    found[c.driver] = _swapped(mjm, c)
    return tuple(_in_order(mjm, found, "couplings"))


def active_equalities(mjm: mujoco.MjModel) -> list[int]:
    """Return the ids of the equalities that MuJoCo enforces from the start."""
    disabled = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    return [] if mjm.opt.disableflags & disabled else np.flatnonzero(mjm.eq_active0).tolist()


def equality_label(mjm: mujoco.MjModel, eq: int) -> str:
    """Return the name of an equality in errors: its kind, and its name or number."""
    kind = mujoco.mjtEq(int(mjm.eq_type[eq])).name.removeprefix("mjEQ_").lower()
    name = mjm.equality(eq).name
    return f"equality '{name}' ({kind})" if name else f"equality {eq} ({kind})"


def equality_errors(mjm: mujoco.MjModel, states: np.ndarray) -> np.ndarray:
    """Return MuJoCo C's error of each equality in states (n, nq) [m or rad], (n, neq), 0 for inactive equalities."""
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
        couplings: The couplings, drivers before their followers.
        qpos: Positions, shape (..., nq).
    """
    for c in couplings:
        # Positions that already agree up to rounding keep their bits.
        wanted = c.at(qpos[..., c.driver_adr])
        qpos[..., c.adr] = np.where(np.abs(qpos[..., c.adr] - wanted) < _SAME, qpos[..., c.adr], wanted)


def driven_by(couplings: Iterable[Coupling], joints: Iterable[int]) -> list[Coupling]:
    """Return the couplings whose follower moves with any of `joints`, directly or through others, drivers first."""
    moving, found = set(joints), []
    for c in couplings:
        if c.driver in moving:
            moving.add(c.follower)
            found.append(c)
    return found


def free_range(mjm: mujoco.MjModel, couplings: Iterable[Coupling], joint: int, home: np.ndarray) -> tuple[float, float]:
    """Return the interval around home in which a joint and all its followers stay within their limits.

    Without followers, this is the range of the joint's limits.

    Args:
        mjm: The model.
        couplings: The model's couplings, in order.
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
    """Return the farthest position from `start` towards `end` that `within` accepts, by bisection."""
    goal = end if np.isfinite(end) else float(np.copysign(_FAR, end))
    if within(goal):
        return end
    good, bad = start, goal
    for _ in range(80):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if within(middle) else (good, middle)
    return good


def couple(
    mjm: mujoco.MjModel, label: str, follower: int, driver: int | None, origin: float, offset: float, coef: _Coef
) -> Coupling:
    """Return a coupling of two joints or of a held joint, with addresses and limits from the model."""
    adr = int(mjm.jnt_qposadr[follower])
    driver_adr = adr if driver is None else int(mjm.jnt_qposadr[driver])
    return Coupling(label, follower, driver, adr, driver_adr, origin, offset, coef, _limits(mjm, follower))


def _is_linear(c: Coupling) -> bool:
    return c.coef[0] != 0.0 and not any(c.coef[1:])


def _swapped(mjm: mujoco.MjModel, c: Coupling) -> Coupling:
    """Return the same line as a linear coupling of two joints, with driver and follower swapped."""
    assert c.driver is not None
    return couple(mjm, c.label, c.driver, c.follower, c.offset, c.origin, (1.0 / c.coef[0], 0.0, 0.0, 0.0))


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
    """Return the couplings in an order in which drivers come before their followers."""
    drivers = {joint: [c.driver] if c.driver in found else [] for joint, c in found.items()}
    try:
        return [found[joint] for joint in graphlib.TopologicalSorter(drivers).static_order()]
    except graphlib.CycleError as error:
        names = [mjm.joint(joint).name for joint in error.args[1][:0:-1]]
        raise in_a_cycle(where, names, "joints follow each other by equalities") from None


def coupling_arrays(couplings: Sequence[Coupling]) -> dict[str, np.ndarray]:
    """Return the couplings as arrays, by the names of the fields `follow_*` in the device structs."""
    return {
        "follow_driveradr": np.array([c.driver_adr for c in couplings], int),
        "follow_qposadr": np.array([c.adr for c in couplings], int),
        "follow_coef": np.reshape([(c.origin, c.offset, *c.coef) for c in couplings], (-1, 6)).astype(float),
    }
