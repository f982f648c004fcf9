"""Checks and conversions of an environment's arguments: tasks, scenes, groups, seeds, reset masks, actions."""

import importlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import Space
from gymnasium.vector import AutoresetMode
from torch import Tensor

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, check_names
from sceniris_gym.layout.compile import compile_scene, device_name
from sceniris_gym.layout.layout_id import ChosenLayouts, entries_of_worlds
from sceniris_gym.layout.masks import as_host_mask
from sceniris_gym.layout.seeds import as_seeds
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.ranks import Rank
from sceniris_gym.vector.task import Task

RESET_MASK = "reset_mask"  # the name in Gymnasium's vector environments
LAYOUTS, STATE, PARAMS = "layouts", "state", "params"
RESET_OPTIONS = (RESET_MASK, LAYOUTS, STATE, PARAMS)


def as_task(task: Task | type[Task] | str) -> Task:
    """Return a Task, given as an instance, a class, or "module:Class".

    Raises:
        ArgumentError: The string has another form, or Python cannot import the class.
        ArgumentTypeError: The value has another type.
    """
    if isinstance(task, str):
        module, _, name = task.partition(":")
        try:
            task = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise ArgumentError(f"task {task!r} should be an importable class, as 'module:Class': {error}.") from None
    made = task() if isinstance(task, type) else task
    if not isinstance(made, Task):
        raise ArgumentTypeError(f"task should be a Task, its class, or 'module:Class', got {short(made)}.")
    return made


def as_compiled_scene(scene: Any, overrides: Mapping[str, Any] | None, device: str | None) -> CompiledScene:
    """Return a CompiledScene unchanged, or compile a scene given in another form.

    If `device` is None, the scene is compiled for cuda:0, or for cpu if there is no GPU.

    Raises:
        ArgumentError: A CompiledScene is given together with overrides or another device.
        ScenirisError: As in compile_scene.
    """
    if isinstance(scene, CompiledScene):
        if overrides or (device is not None and device_name(device) != scene.device):
            raise ArgumentError("overrides and device should be None for a CompiledScene, which cannot be changed.")
        return scene
    return compile_scene(scene, device, overrides=overrides)


def as_autoreset_mode(value: Any) -> AutoresetMode:
    """Return an AutoresetMode of Gymnasium, which a user gave as a member or as the member's value.

    Raises:
        ArgumentError: The value is not a mode.
    """
    try:
        return AutoresetMode(value)
    except ValueError:
        modes = ", ".join(mode.value for mode in AutoresetMode)
        raise ArgumentError(f"autoreset_mode should be one of {modes}, got {short(value)}.") from None


def as_groups(value: str | Sequence[str] | None) -> tuple[str, ...] | None:
    """Return names of observation groups, given as a sequence or as a single name. None selects all groups.

    Raises:
        ArgumentError: The sequence is empty, or an entry is not a string.
    """
    if value is None:
        return None
    groups = (value,) if isinstance(value, str) else tuple(value) if isinstance(value, Sequence) else ()
    if not groups or not all(isinstance(group, str) for group in groups):
        raise ArgumentError(
            "observation_groups should be names of groups to observe, such as ('policy',), "
            f"got {short(value)}. Leave it out to observe all of them."
        )
    return groups


def as_reset_seeds(
    seed: Any, num_envs: int, rank: Rank, *, first: bool, mask: np.ndarray | None = None
) -> ChosenLayouts | None:
    """Return the layout choices of a reset by seed: episode 0 of each given seed. Return None if `seed` is None.

    Args:
        seed: None, an integer (world i gets seed + i), or a sequence of num_envs entries, each an integer or None. With
            a mask, the sequence may also have one entry for each masked world, in order.
        num_envs: Number of worlds.
        rank: The process. Each process shifts an integer seed into a separate range of seeds.
        first: Whether this is the first reset, which draws a seed for each None in a sequence.
        mask: The worlds to reset, shape (num_envs,), bool, or None for all worlds.

    Raises:
        ArgumentError: The seed has another form, or is out of range.
    """
    if seed is None:
        return None
    given = np.ones(num_envs, bool)
    if mask is not None and np.ndim(seed) == 1 and len(seed) == mask.sum() < num_envs:
        seed = [seed[i] for i in entries_of_worlds(len(seed), mask, num_envs, "seed")]
    if isinstance(seed, list | tuple) and len(seed) == num_envs and type(None) in set(map(type, seed)):
        wanted = np.fromiter(seed, dtype=object, count=len(seed))
        missing = (wanted == np.array(None)).astype(bool)
        wanted[missing] = fresh_seeds(int(missing.sum()))
        return ChosenLayouts(as_seeds(wanted, num_envs), given if first else ~missing)
    seeds = as_seeds(seed, num_envs)
    own = as_seeds(rank.own_seed(int(seed)), num_envs) if isinstance(seed, int | np.integer) else seeds
    return ChosenLayouts(own, given)


def as_reset_mask(options: Mapping[str, Any] | None, num_envs: int) -> np.ndarray | None:
    """Return a copy of `options["reset_mask"]` on the host, shape (num_envs,), bool, or None for all worlds.

    Raises:
        ArgumentTypeError: The options are not a mapping. The mask is not an array of booleans.
        UnknownNameError: The options have an unknown name.
        ArgumentError: The mask has the wrong shape, or is false everywhere.
    """
    if not isinstance(options, Mapping | None):
        raise ArgumentTypeError(f"reset: options should be {{'{RESET_MASK}': mask}} or None, got {short(options)}.")
    options = options or {}
    check_names("option", options, "reset", RESET_OPTIONS)
    if options.get(RESET_MASK) is None:
        return None
    name = f"options['{RESET_MASK}']"
    mask = as_host_mask(options[RESET_MASK], num_envs, name)
    if not mask.any():
        raise ArgumentError(f"{name} should be true for at least one world. Leave it out to reset all worlds.")
    return mask


def as_action(actions: Any, space: Space, device: torch.device) -> Tensor:
    """Return the actions of all worlds on the device, detached and clipped to [-1, 1], with 0 for NaN.

    A NaN would stay in the controls until the next reset of its world. If actions kept their gradient graph, the task's
    tensors would stay attached to this graph.

    Raises:
        ArgumentError: The actions have the wrong shape, or are not real numbers.
    """
    try:
        given = torch.as_tensor(actions, device=device).detach()
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:
        raise ArgumentError(f"actions should be an array of numbers, shape {space.shape}: {error}") from None
    if given.layout is not torch.strided or given.is_nested or isinstance(actions, np.ma.MaskedArray):
        raise ArgumentError(f"actions should be a dense array, got a {type(actions)} of layout {given.layout}.")
    if given.shape != space.shape:
        raise ArgumentError(f"actions should have shape {space.shape}, got {tuple(given.shape)}.")
    if given.is_complex():
        raise ArgumentError("actions should be real numbers, got complex ones. Pass their real parts.")
    return given.to(torch.float32).nan_to_num(nan=0.0).clamp(-1.0, 1.0)


def fresh_seeds(count: int) -> np.ndarray:
    """Draw seeds from the operating system, shape (count,), uint64. 62 bits keep seed + i a positive int64."""
    return np.random.SeedSequence().generate_state(count, np.uint64) >> np.uint64(2)


def fresh_seed() -> int:
    """Draw one seed, as `fresh_seeds` does."""
    return int(fresh_seeds(1)[0])
