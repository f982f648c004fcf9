"""Names of MuJoCo and MuJoCo-Warp that differ between the supported versions, 3.11 to 4; no other file knows of it."""

from __future__ import annotations

import dataclasses
import importlib
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np

_WITH_OVERFLOWS = mjw if hasattr(mjw, "OverflowType") else importlib.import_module("mujoco_warp._src.types")
OverflowType: Any = _WITH_OVERFLOWS.OverflowType
"""Bits of `Data.overflow`; 3.11 does not export it, and has no bits for limits of iterations."""


def silence_iterations(m: mjw.Model) -> None:
    """Turn off warnings about the solver's limits of iterations, where there are any: since 4.0."""
    iterations = [getattr(OverflowType, name, 0) for name in ("ITERATIONS", "LS_ITERATIONS")]
    if any(iterations):
        m.opt.warn_overflow &= ~int(iterations[0] | iterations[1])


def fields_of_data(*names: str) -> tuple[str, ...]:
    """Return those of the names that this version's Data has, in their order."""
    found = {field.name for field in dataclasses.fields(mjw.Data)}
    return tuple(name for name in names if name in found)


def actuator_controls(mjm: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the address of each actuator's first control, and their number: one of each before 4.0."""
    nactuator = len(mjm.actuator_trntype)
    return (
        getattr(mjm, "actuator_ctrladr", np.arange(nactuator)),
        getattr(mjm, "actuator_ctrlnum", np.ones(nactuator, int)),
    )


def actuator_outputs(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the address of each actuator's first output: one of each before 4.0."""
    return getattr(mjm, "actuator_outadr", np.arange(len(mjm.actuator_trntype)))


def keyframe_plastic(mjm: mujoco.MjModel, key: int) -> np.ndarray:
    """Return the plastic references of springs in a keyframe, of which there are none before 4.0."""
    return mjm.key_plastic[key] if hasattr(mjm, "key_plastic") else np.empty(0)
