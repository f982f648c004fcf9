"""`compile_scene`: the only way from host to device. What cannot be supported fails here, with a reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import CountError, InfeasibleSceneError, NotSupportedError, UnknownNameError
from sceniris_gym.layout.blame import obstructions
from sceniris_gym.layout.collision import NODE_CAPACITY
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.program.device import Cause, Program, fill_struct
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.plan import UPRIGHT
from sceniris_gym.scene.model import SceneModel, build_model

# The probe makes layouts until the bank is full, in this many rounds at most.
_ROUNDS = 8
# Causes that only come up once all objects are placed.
_LATE = (Cause.NO_IK.name.lower(), Cause.BLOCKED.name.lower())
# What a row of the bank holds.
_BANK = ("qpos", "mocap_pos", "mocap_quat", "present")
_REACH_BANK = ("grasp", "grasp_qpos", "pregrasp_qpos")


def compile_scene(
    scene: str | Path | Mapping | SceneConfig | SceneModel, device: str | None = None, *, bank_size: int = 64
) -> CompiledScene:
    """Compile a scene for a device, prove that layouts of it can be made, and fill its bank of valid layouts.

    Args:
        scene: A shipped scene's name, a path, a mapping, a SceneConfig, or a SceneModel.
        device: Warp's name of the device; None takes "cuda:0" if there is one, else "cpu".
        bank_size: Number of valid layouts to keep for worlds that run out of attempts and restarts, at least 1.

    Raises:
        CountError: `bank_size` is below 1.
        UnknownNameError: There is no such device.
        InfeasibleSceneError: No valid layout was found; the message says which object fails and why.
        ScenirisError: Something else is wrong with the scene; see `SceneConfig.load`, `build_model` and `build_plan`.
    """
    if bank_size < 1:
        raise CountError(f"compile_scene: bank_size={bank_size} should be 1 or more.")
    wp.init()
    name = device_name(device)
    model = scene if isinstance(scene, SceneModel) else build_model(SceneConfig.load(scene))
    compiled = upload_scene(model, name)
    _check_room(compiled)
    return _with_bank(compiled, bank_size)


def _check_room(compiled: CompiledScene) -> None:
    """Refuse a scene of which an object is kept apart from more bodies than the collision test has room for."""
    room, starts = NODE_CAPACITY[compiled.config.geometry], compiled.program.obj_startnum.numpy()
    names = [*compiled.placed, *["robot"] * (len(starts) - len(compiled.placed))]
    for name, count in zip(names, starts.tolist(), strict=True):
        if count > room:
            raise NotSupportedError(
                f"{compiled.config.where}: '{name}' is kept apart from others in {count} pairs of bodies, and there is "
                f"room for {room}. Make one body of several that never move against each other: geoms of one body "
                "count as one."
            )


def device_name(device: str | None, where: str = "compile_scene") -> str:
    """Return Warp's name of a device, by default of its preferred one.

    Raises:
        UnknownNameError: There is no such device.
    """
    if device is None:
        return str(wp.get_preferred_device())
    try:
        return str(wp.get_device(device))
    except ValueError:
        raise UnknownNameError("device", device, where, [d.alias for d in wp.get_devices()]) from None


def _with_bank(compiled: CompiledScene, size: int) -> CompiledScene:
    probe = LayoutGenerator(compiled, size, seed=0, split="bank")
    layouts = probe.layouts
    found: list[tuple[np.ndarray, ...]] = []
    for _ in range(_ROUNDS):
        probe.generate()
        valid = layouts.status.numpy() == Status.VALID
        rows = [getattr(layouts, name).numpy()[valid] for name in (*_BANK, *_REACH_BANK)]
        found += zip(*rows, strict=True)
        if len(found) >= size:
            break
    if not found:
        raise _infeasible(compiled, probe)
    columns = (np.stack(rows) for rows in zip(*found[:size], strict=True))
    bank: dict[str, np.ndarray] = dict(zip((*_BANK, *_REACH_BANK), columns, strict=True))
    program = _with_rows(Program, compiled.program, bank, _BANK, compiled.device)
    if compiled.reaching is None:
        return replace(compiled, program=program)
    view = _with_rows(Reach, compiled.reaching.view, bank, _REACH_BANK, compiled.device)
    return replace(compiled, program=program, reaching=replace(compiled.reaching, view=view))


def _with_rows(declared: Any, instance: Any, bank: Mapping[str, np.ndarray], names: Sequence[str], device: str) -> Any:
    """A copy of a device struct whose fields `bank_*` hold these rows."""
    other = declared()
    for name in declared.vars:
        setattr(other, name, getattr(instance, name))
    fill_struct(declared, other, {f"bank_{name}": bank[name] for name in names}, device)
    return other


def _infeasible(compiled: CompiledScene, probe: LayoutGenerator) -> InfeasibleSceneError:
    """Blame the last object that was ever tried: all before it could be placed. Stages after placing are tried last."""
    counts = probe.rejection_counts()
    late = {name: {c: n for c, n in causes.items() if c in _LATE} for name, causes in counts.items()}
    tried = [(name, causes) for found in (counts, late) for name, causes in found.items() if any(causes.values())]
    name, causes = tried[-1]
    cause = max(causes, key=causes.__getitem__)
    leaning = _leaning_support(compiled, probe, name) if cause == Cause.EMPTY.name.lower() else None
    orientation = None if leaning is None else compiled.config.objects[leaning.split("/")[0]].drawn_orientation.kind
    obstruction = obstructions(compiled).get(name) if causes.get(Cause.COLLISION.name.lower()) else None
    return InfeasibleSceneError(
        compiled.config.where,
        name,
        cause,
        counts,
        leaning,
        orientation if orientation in ("any", "stable") else None,
        None if obstruction is None else str(obstruction),
    )


def _leaning_support(compiled: CompiledScene, probe: LayoutGenerator, name: str) -> str | None:
    """What carries an object, if that leans in most worlds as they were left."""
    ground = next(o.ground for o in compiled.plan.objects if o.name == name)
    support = None if name == ROBOT else compiled.config.objects[name].support
    if ground is None or support is None:
        return None
    x, y = probe.layouts.view.body_quat.numpy()[:, ground, 1:3].T
    leans = 1.0 - 2.0 * (x * x + y * y) < UPRIGHT  # the z component of the body's z axis
    return support.parent if leans.mean() > 0.5 else None
