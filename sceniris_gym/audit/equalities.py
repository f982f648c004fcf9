"""Check of the equalities of a model in layouts, by MuJoCo C: welds, connects, coupled joints and tendons."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.scene.layout_table import LayoutTable

BROKEN = 2e-4
"""Greatest error of an equality that is kept [m or rad]; keyframes have few digits."""


@dataclass(frozen=True)
class Equalities:
    """Errors of the equalities in layouts.

    Attributes:
        broken: Number of layouts with an error above `BROKEN`.
        worst: The largest error [m or rad].
        name: The equality with the largest error, by its number if it has no name; empty if there is no error.
    """

    broken: int
    worst: float
    name: str


def equalities(mjm: mujoco.MjModel, table: LayoutTable) -> Equalities:
    """Return the errors of the active equalities of a model in layouts."""
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
