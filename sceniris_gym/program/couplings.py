"""Joints that follow drawn ones: their couplings, and the positions that they pass through."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.scene.couplings import Coupling


@dataclass(frozen=True)
class Follower:
    """A joint that follows a drawn one: its coupling, and the least and greatest position that it takes [m or rad]."""

    coupling: Coupling
    low: float
    high: float


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


def followers_of(
    couplings: Iterable[Coupling], drawn: Mapping[int, Sequence[tuple[float, float]]]
) -> tuple[Follower, ...]:
    """Return the joints that follow drawn ones, drivers before their followers.

    Args:
        couplings: All couplings of the scene, drivers before their followers.
        drawn: The intervals that each joint is drawn from [m or rad], by its address in qpos.
    """
    inside, found = dict(drawn), []
    for c in couplings:
        if c.driver is not None and c.driver_adr in inside:
            inside[c.adr] = [c.over(*part) for part in inside[c.driver_adr]]
            found.append(Follower(c, float(np.min(inside[c.adr])), float(np.max(inside[c.adr]))))
    return tuple(found)
