"""`Snapshot`: the state of worlds in the middle of their episodes, stored to continue from there again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import FunctionType, ModuleType
from typing import Any

import torch
import warp as wp
from torch import Tensor

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, SceneMismatchError, check_type
from sceniris_gym.layout.columns import columns
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.stored import INTEGERS, check_numbers
from sceniris_gym.scene.layout_table import row_numbers
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.versions import fields_of_data
from sceniris_gym.vector.state import State
from sceniris_gym.vector.variants import VariantView

_OF_DATA = (*ResetRandomizer.STATE_FIELDS, *fields_of_data("tree_awake"))
_FINITE = ("data.", "layout.qpos", "layout.mocap")
_WERE_FINITE = "finite"
"""Name of a snapshot's flags of finite rows, with a column for each float tensor, sorted by name."""
_INDICES = {f"layout.{name}": name for name in (*INTEGERS, "attempts", "next_episode")} | {
    "data.tree_asleep": "tree_asleep",
    "elapsed": "elapsed",
}
_FOREIGN = ("torch", "warp", "mujoco", "mujoco_warp", "numpy", "gymnasium")
"""Packages whose objects are no memory of a task."""


@dataclass(frozen=True)
class Snapshot:
    """The state of worlds, a row for each.

    Attributes:
        source: Hash of the scene, split and params of the layouts.
        worlds: World of each row, shape (nrow,), int64.
        rows: Tensors of shape (nrow, ...) by name: the state in mujoco_warp's Data, the layout, the choice of the next
            layout, the steps since the reset, the memory of the task, and flags of the finite rows.
    """

    source: tuple[str, ...]
    worlds: Tensor
    rows: Mapping[str, Tensor]

    def __len__(self) -> int:
        return self.worlds.numel() if isinstance(self.worlds, Tensor) else 0

    def __getitem__(self, index: Any) -> Snapshot:
        chosen = torch.from_numpy(row_numbers(index, len(self), "Snapshot")).to(self.worlds.device)
        return Snapshot(self.source, self.worlds[chosen], {name: rows[chosen] for name, rows in self.rows.items()})


def take(source: tuple[str, ...], live: Mapping[str, Tensor], worlds: Tensor) -> Snapshot:
    """Return the rows of these worlds, copied."""
    rows = {name: tensor[worlds] for name, tensor in live.items()}
    return Snapshot(source, worlds, {**rows, _WERE_FINITE: _are_finite(rows)})


def _are_finite(rows: Mapping[str, Tensor]) -> Tensor:
    """Return which rows of each tensor of floats, sorted by name, are finite, shape (nrow, n), bool."""
    floats = [rows[name] for name in sorted(rows) if rows[name].is_floating_point()]
    return torch.stack([values[..., None].isfinite().flatten(1).all(dim=1) for values in floats], dim=1)


def versions(live: Mapping[str, Tensor]) -> dict[str, tuple[Tensor, int]]:
    """Return all tensors with the versions that torch counts at each write, for `written`."""
    return {name: (tensor, tensor._version) for name, tensor in live.items()}


def written(live: Mapping[str, Tensor], made: Mapping[str, tuple[Tensor, int]]) -> dict[str, Tensor]:
    """Return the tensors that were written to or replaced since they were `made`.

    Other tensors with a row for each world, such as indices and tables, do not belong to an episode.
    """
    kept = [name for name, (tensor, version) in made.items() if live.get(name) is tensor and tensor._version == version]
    return {name: tensor for name, tensor in live.items() if name not in kept}


def _is_plain(tensor: Tensor) -> bool:
    return tensor.layout is torch.strided and not tensor.is_meta


def check_snapshot(snapshot: Any, source: tuple[str, ...], live: Mapping[str, Tensor], layouts: Layouts) -> None:
    """Check that a snapshot can be written into the worlds.

    Raises:
        ArgumentTypeError: The value is not a Snapshot.
        SceneMismatchError: The snapshot is of another scene, split or task, or of worlds with other params. It has
            non-finite values, or indices out of range.
        ArgumentError: A param cannot have its value.
    """
    check_type(snapshot, Snapshot, "options['state']")
    check_type(snapshot.rows, Mapping, "options['state'].rows")
    rows: dict[str, Any] = {**snapshot.rows, "worlds": snapshot.worlds}
    given = {name: values for name, values in rows.items() if isinstance(values, Tensor)}
    found = {name: (values.dtype, tuple(values.shape)) for name, values in given.items()}
    tensors = {"worlds": torch.zeros(1, dtype=torch.int64), **live}
    wanted = {name: (tensor.dtype, (len(snapshot), *tensor.shape[1:])) for name, tensor in tensors.items()}
    has_rows = all(_is_plain(values) and values.shape[:1] == (len(snapshot),) for values in given.values())
    if snapshot.source != source or not (has_rows and wanted.items() <= found.items() and _WERE_FINITE in found):
        got = "other rows" if snapshot.source == source else short(snapshot.source)
        raise SceneMismatchError(
            f"options['state'] should be a snapshot of this scene, split, task and params, got {got}. Take one "
            "of this environment."
        )
    # infinities in the memory of a task are legitimate, and so are the NaNs of a layout without a grasp
    state = {name: rows for name, rows in snapshot.rows.items() if name.startswith(_FINITE)}
    if not (torch.equal(_are_finite(snapshot.rows), rows[_WERE_FINITE]) and _are_finite(state).all()):
        raise SceneMismatchError("options['state'] should have finite numbers, got NaN or inf. Drop the broken worlds.")
    numbers = {name: snapshot.rows[key].cpu().numpy() for key, name in _INDICES.items() if key in snapshot.rows}
    check_numbers(layouts.compiled, numbers, "options['state']")
    for name in live.keys() & {"layout.param", "layout.next_param"}:
        layouts.params.checked(snapshot.rows[name], len(snapshot))


def put(snapshot: Snapshot, live: Mapping[str, Tensor], mask: Tensor | None) -> Tensor:
    """Write a snapshot into its own worlds, or in order into the worlds of a mask. Return a mask of these worlds.

    Raises:
        ArgumentError: The number of rows differs from the number of masked worlds. A world does not exist, or occurs
            twice.
    """
    num_envs, device = live["elapsed"].shape[0], live["elapsed"].device
    worlds = snapshot.worlds.to(device) if mask is None else mask.nonzero().flatten()
    if len(worlds) != len(snapshot):
        raise ArgumentError(
            f"options['state'] should have {len(worlds)} rows, one per masked world, got {len(snapshot)}."
        )
    if len(worlds.unique()) != len(worlds) or ((worlds < 0) | (worlds >= num_envs)).any():
        raise ArgumentError(f"options['state'] should be of different worlds below {num_envs}, got {worlds.tolist()}.")
    for name, tensor in live.items():
        tensor[worlds] = snapshot.rows[name].to(device)
    restored = torch.zeros(num_envs, dtype=torch.bool, device=device)
    restored[worlds] = True
    return restored


def live_tensors(
    state: State, layouts: Layouts, memory: Mapping[str, Any], following: tuple[str, ...]
) -> dict[str, Tensor]:
    """Return all tensors that have a row for each world, by name, in the memory that steps and resets use.

    Args:
        state: The worlds.
        layouts: The layouts of the worlds.
        memory: Other objects that may have such tensors, by name.
        following: Columns that choose the next layouts: `NEXT`, or empty if a sampler chooses them.
    """
    arrays = {f"data.{name}": getattr(state.data, name) for name in _OF_DATA}
    arrays |= {f"layout.{name}": getattr(layouts.view, name) for name in (*columns(), *following)}
    # new tensors, not the tensors of `layouts`: `written` would drop them, because Warp writes to them and not torch
    tensors = {name: wp.to_torch(array)[: state.num_envs] for name, array in arrays.items() if array.size}
    tensors |= {f"model.{name}": tensor for name, tensor in state.model_rows.items()}
    # torch cannot index uint64
    found = {name: t.view(torch.int64) if t.dtype is torch.uint64 else t for name, t in tensors.items()}
    found["elapsed"] = state.elapsed
    for name, value in memory.items():
        found.update(_memory(value, state.num_envs, name, set()))
    return found


def _memory(value: Any, num_envs: int, path: str, seen: set[int]) -> Iterator[tuple[str, Tensor]]:
    """Yield the tensors with `num_envs` rows in an object, and in its containers and helpers."""
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
