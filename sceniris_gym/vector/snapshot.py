"""The memory of a task: the tensors that a snapshot of an environment copies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import FunctionType, ModuleType
from typing import Any

from torch import Tensor

from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.vector.state import State
from sceniris_gym.vector.variants import VariantView

_FOREIGN = ("torch", "warp", "mujoco", "mujoco_warp", "numpy", "gymnasium")
"""Packages whose objects are not searched for the memory of a task."""


def versions(live: Mapping[str, Tensor]) -> dict[str, tuple[Tensor, int]]:
    """Return each tensor with its version, which torch increments at each write. `written` compares these versions."""
    return {name: (tensor, tensor._version) for name, tensor in live.items()}


def written(live: Mapping[str, Tensor], made: Mapping[str, tuple[Tensor, int]]) -> dict[str, Tensor]:
    """Return the tensors that were written to or replaced since `versions` returned `made`.

    Unchanged tensors, such as indices and tables, do not belong to an episode, even if they have a row for each world.
    """
    kept = [name for name, (tensor, version) in made.items() if live.get(name) is tensor and tensor._version == version]
    return {name: tensor for name, tensor in live.items() if name not in kept}


def memory_rows(memory: Mapping[str, Any], num_envs: int) -> dict[str, Tensor]:
    """Return all tensors with `num_envs` rows, by name, in the given objects and in the objects that these contain."""
    return dict(pair for name, value in memory.items() for pair in _memory(value, num_envs, name, set()))


def _memory(value: Any, num_envs: int, path: str, seen: set[int]) -> Iterator[tuple[str, Tensor]]:
    if id(value) in seen or isinstance(value, State | VariantView | Layouts | type | ModuleType | FunctionType):
        return
    seen.add(id(value))
    if isinstance(value, Tensor):
        if value.ndim and value.shape[0] == num_envs and (value.stride(0) or num_envs == 1):  # not an expanded one
            yield path, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _memory(item, num_envs, f"{path}.{key}", seen)
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _memory(item, num_envs, f"{path}.{i}", seen)
    elif hasattr(value, "__dict__") and type(value).__module__.partition(".")[0] not in _FOREIGN:
        yield from _memory(vars(value), num_envs, path, seen)
