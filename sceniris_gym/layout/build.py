"""`build_world`: the only door from host to device. What cannot be supported fails here, with a reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

from sceniris_gym.errors import InfeasibleSceneError, UnknownNameError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.scene.config import SceneConfig
from sceniris_gym.scene.device import Program
from sceniris_gym.scene.model import SceneModel, build_model
from sceniris_gym.scene.world import World, fill_program, load_world

# The probe makes layouts in rounds until the bank is full or this many rounds are over.
_ROUNDS = 8
# What a row of the bank holds.
_BANK = ("qpos", "mocap_pos", "mocap_quat", "present")


def build_world(
    scene: str | Path | Mapping | SceneConfig | SceneModel, device: str | None = None, *, bank_size: int = 64
) -> World:
    """Build the World of a scene on a device, prove that it can be made, and fill its bank of valid layouts.

    Args:
        scene: A shipped scene's name, a path, a mapping, a SceneConfig, or a model built before.
        device: Warp's name of the device; None takes "cuda:0" if there is one, else "cpu".
        bank_size: Valid layouts to keep for worlds that run out of attempts and restarts, at least 1.

    Raises:
        ValueError: a bank without room.
        UnknownNameError: there is no such device.
        InfeasibleSceneError: no valid layout was found; says which object fails and why.
        ScenirisError: the scene is wrong in another way; see `SceneConfig.load`, `build_model` and `build_plan`.
    """
    if bank_size < 1:
        raise ValueError(f"build_world: bank_size={bank_size} should be 1 or more.")
    wp.init()
    name = device_name(device)
    model = scene if isinstance(scene, SceneModel) else build_model(SceneConfig.load(scene))
    world = load_world(model, name)
    return _with_bank(world, bank_size)


def device_name(device: str | None, where: str = "build_world") -> str:
    """Return Warp's name of a device, of its preferred one for None.

    Raises:
        UnknownNameError: there is no such device.
    """
    if device is None:
        return str(wp.get_preferred_device())
    try:
        return str(wp.get_device(device))
    except ValueError:
        raise UnknownNameError("device", device, where, [d.alias for d in wp.get_devices()]) from None


def _with_bank(world: World, size: int) -> World:
    probe = LayoutGenerator(world, size, seed=0, split="bank")
    layouts = probe.layouts
    found: list[tuple[np.ndarray, ...]] = []
    for _ in range(_ROUNDS):
        probe.generate()
        valid = layouts.status.numpy() == Status.VALID
        rows = [getattr(layouts, name).numpy()[valid] for name in _BANK]
        found += zip(*rows, strict=True)
        if len(found) >= size:
            break
    if not found:
        raise _infeasible(world, probe)
    program = _copy(world.program)
    bank = {f"bank_{name}": np.stack(rows) for name, rows in zip(_BANK, zip(*found[:size], strict=True), strict=True)}
    fill_program(program, bank, world.device)
    return replace(world, program=program)


def _copy(program: Program) -> Program:
    other = Program()
    for name in Program.vars:
        setattr(other, name, getattr(program, name))
    return other


def _infeasible(world: World, probe: LayoutGenerator) -> InfeasibleSceneError:
    """Blame the last object that was ever tried: all before it could be placed."""
    counts = probe.rejection_counts()
    tried = [name for name, causes in counts.items() if any(causes.values())]
    name = tried[-1]
    cause = max(counts[name], key=lambda c: counts[name][c])
    return InfeasibleSceneError(world.config.where, name, cause, counts)
