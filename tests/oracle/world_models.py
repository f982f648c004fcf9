"""MuJoCo C's own model and state of each world of a simulation, from the rows that a reset has written."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

_OPTIONS = ("gravity", "wind", "magnetic", "density", "viscosity")
_STATE = ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat", "qacc_warmstart")
# Places of geoms that a variant does not use have this margin [m] or less.
_UNUSED = -1e5


class WorldModels:
    """The worlds of a batch as MuJoCo C would have them.

    Args:
        mjm: The model that the batch was made from.
        m: Its mujoco_warp Model, of which some fields have a row for each world.
        d: Its Data.

    Attributes:
        fields: Rows of the fields of the Model that have one for each world, by name.
        states: Rows of the state, by name.
    """

    def __init__(self, mjm: mujoco.MjModel, m: mjw.Model, d: mjw.Data) -> None:
        self.mjm, self.nworld = mjm, d.nworld
        arrays = {name: getattr(m, name) for name in mjw.Model.__dataclass_fields__ if hasattr(mjm, name)}
        self.fields = {name: rows for name, array in arrays.items() if (rows := self._rows(array)) is not None}
        options = {name: self._rows(getattr(m.opt, name)) for name in _OPTIONS}
        self._options = {name: rows for name, rows in options.items() if rows is not None}
        self.states = {name: getattr(d, name).numpy().copy() for name in _STATE}
        self.own = copy.copy(mjm)
        self.own.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # 4.0.0 factorises sparse ones wrongly
        self.own.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE  # its boxes are those of the first variant
        for name in ("body", "geom", "site"):
            getattr(self.own, f"{name}_sameframe")[:] = 0  # frames may differ as soon as centres of mass are drawn

    def _rows(self, array: Any) -> np.ndarray | None:
        """Return an array that has a row for each world; None for any other value."""
        if not isinstance(array, wp.array) or not array.size or array.shape[0] != self.nworld or self.nworld == 1:
            return None
        return array.numpy()

    def model(self, world: int) -> mujoco.MjModel:
        """Return the model of a world, always in the same memory."""
        for name, rows in self.fields.items():
            field = getattr(self.own, name)
            if field.size == rows[world].size:
                field[:] = rows[world].reshape(field.shape)
        for name, rows in self._options.items():
            setattr(self.own.opt, name, rows[world])
        unused = self.own.geom_margin < _UNUSED
        for name in ("contype", "conaffinity"):
            field = getattr(self.own, f"geom_{name}")
            field[:] = np.where(unused, 0, getattr(self.mjm, f"geom_{name}"))
        self.own.geom_margin[unused] = 0.0
        self.own.geom_dataid[:] = np.where(self.own.geom_dataid < 0, self.mjm.geom_dataid, self.own.geom_dataid)
        return self.own

    def put(self, data: mujoco.MjData, world: int) -> None:
        """Reset data to the state of a world."""
        mujoco.mj_resetData(self.own, data)
        for name, rows in self.states.items():
            field = getattr(data, name)
            field[:] = rows[world][: len(field)].reshape(field.shape)
        for i in np.flatnonzero(self.own.actuator_history[:, 0] > 0):  # a delayed one has had this control all along
            past = np.full((int(self.own.actuator_history[i, 0]), 1), data.ctrl[i])
            mujoco.mj_initCtrlHistory(self.own, data, int(i), None, past)
