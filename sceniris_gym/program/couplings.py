"""Joints that follow drawn ones: their couplings, and the positions that they pass through."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sceniris_gym.scene.couplings import Coupling


@dataclass(frozen=True)
class Follower:
    """A joint that follows a drawn one: its coupling, and the least and greatest position that it takes [m or rad]."""

    coupling: Coupling
    low: float
    high: float


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
