"""Differences between the supported versions of MuJoCo and MuJoCo-Warp, 3.11 to 4. Keep all these differences here."""

import dataclasses
import importlib
import inspect
from collections.abc import Sequence
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np

_WITH_OVERFLOWS = mjw if hasattr(mjw, "OverflowType") else importlib.import_module("mujoco_warp._src.types")
OverflowType: Any = _WITH_OVERFLOWS.OverflowType
"""Bits of `Data.overflow`. 3.11 does not export the type, and has no bits for iteration limits."""

_SLEEPS = "nvmax" in inspect.signature(mjw.make_data).parameters

SLEEPING: dict[str, Any] = {"enableflags": int(mujoco.mjtEnableBit.mjENBL_SLEEP)} if _SLEEPS else {}
"""Options that let bodies at rest sleep, so that steps take less time. Empty before 4.0, where batches cannot sleep."""


def sleeps(m: mjw.Model) -> bool:
    """Return whether bodies of a batch can sleep."""
    return bool(SLEEPING) and bool(m.opt.enableflags & SLEEPING["enableflags"])


def room_for_dofs(nvmax: int | None) -> dict[str, int]:
    """Return make_data's argument that limits a world's awake degrees of freedom, or {} before MuJoCo-Warp 4.0."""
    return {} if nvmax is None or not _SLEEPS else {"nvmax": nvmax}


def silence_iterations(m: mjw.Model) -> None:
    """Turn off warnings about the solver's iteration limits, which MuJoCo-Warp 4.0 introduced."""
    iterations = [getattr(OverflowType, name, 0) for name in ("ITERATIONS", "LS_ITERATIONS")]
    if any(iterations):
        m.opt.warn_overflow &= ~int(iterations[0] | iterations[1])


def fields_of_data(*names: str) -> tuple[str, ...]:
    """Return the `names` that are fields of this version's Data, in the given order."""
    found = {field.name for field in dataclasses.fields(mjw.Data)}
    return tuple(name for name in names if name in found)


def actuator_controls(mjm: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the address of each actuator's first control, and its number of controls, which is 1 before MuJoCo 4.0."""
    address, number = np.arange(len(mjm.actuator_trntype)), np.ones(len(mjm.actuator_trntype), int)
    return getattr(mjm, "actuator_ctrladr", address), getattr(mjm, "actuator_ctrlnum", number)


def actuator_outputs(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the address of each actuator's first output. Before MuJoCo 4.0, each actuator has one output."""
    return getattr(mjm, "actuator_outadr", np.arange(len(mjm.actuator_trntype)))


def keyframe_plastic(mjm: mujoco.MjModel, key: int) -> np.ndarray:
    """Return the plastic references of springs in a keyframe, or an empty array before MuJoCo 4.0."""
    return mjm.key_plastic[key] if hasattr(mjm, "key_plastic") else np.empty(0)


def render_context(mjm: mujoco.MjModel, nworld: int, cameras: Sequence[str], **options: Any) -> Any:
    """Return mujoco_warp's context for rendering the named cameras. The context lists cameras in the model's order.

    Options that this version of mujoco_warp does not have are left out. Before MuJoCo-Warp 4.0,
    `samples_per_pixel` is one of them, so edges in pictures are not smooth.
    """
    known = inspect.signature(mjw.create_render_context).parameters
    options = {name: value for name, value in options.items() if name in known}
    active = [mjm.camera(i).name in cameras for i in range(mjm.ncam)]
    return mjw.create_render_context(mjm, nworld, cam_active=active, **options)
