"""Whether layouts keep the equalities of their model: welds, connects, coupled joints and tendons, by MuJoCo C."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.scene.layout_table import LayoutTable

BROKEN = 2e-4
"""An equality that is missed by more [m or rad] is broken: keyframes are written with few digits."""


@dataclass(frozen=True)
class Equalities:
    """How well layouts keep equalities.

    Attributes:
        broken: Number of layouts in which any is missed by more than `BROKEN`.
        worst: The largest amount by which one is missed [m or rad].
        name: The equality that is missed most, by its number if it has no name; empty if none is missed.
    """

    broken: int
    worst: float
    name: str


def equalities(mjm: mujoco.MjModel, table: LayoutTable) -> Equalities:
    """Return how well layouts keep the active equalities of a model."""
    if not mjm.neq:
        return Equalities(0, 0.0, "")
    data = mujoco.MjData(mjm)
    missed = np.zeros((len(table), mjm.neq))
    for row in range(len(table)):
        table.put(data, row)
        mujoco.mj_fwdPosition(mjm, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        np.maximum.at(missed[row], data.efc_id[rows], np.abs(data.efc_pos[rows]))
    worst = float(missed.max(initial=0.0))
    eq = int(missed.max(axis=0, initial=0.0).argmax())
    name = (mjm.equality(eq).name or str(eq)) if worst > 0.0 else ""
    return Equalities(int((missed > BROKEN).any(axis=1).sum()), worst, name)
