"""`Snapshot`: the state of worlds in the middle of their episodes, from which the episodes can continue later."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, SceneMismatchError, check_type
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.stored import INTEGERS, check_numbers
from sceniris_gym.scene.layout_table import row_numbers

_FINITE = ("data.", "layout.qpos", "layout.mocap")
_WERE_FINITE = "finite"
"""Name of the tensor that marks a snapshot's finite rows, with a column for each float tensor, sorted by name."""
_INDICES = (
    *(f"layout.{name}" for name in (*INTEGERS, "attempts", "next_episode")),
    *("data.tree_asleep", "elapsed", "variant"),
)


@dataclass(frozen=True)
class Snapshot:
    """The state of worlds, with a row for each world.

    Attributes:
        source: The scene's hash, the split of the layouts, and the names of their params.
        worlds: Id of the world of each row, shape (nrow,), int64.
        rows: Tensors of shape (nrow, ...) by name: the state in mujoco_warp's Data, the layout, the next layout (seed,
            episode and params) or the current level of a curriculum, fields of the Model, and a mask that marks tensors
            without NaN or inf. Snapshots of an environment also have the steps since the reset and the memory of the
            task.
    """

    source: tuple[str, ...]
    worlds: Tensor = field(repr=False)
    rows: Mapping[str, Tensor] = field(repr=False)

    def __len__(self) -> int:
        return self.worlds.numel() if isinstance(self.worlds, Tensor) else 0

    def __getitem__(self, index: Any) -> Snapshot:
        chosen = torch.from_numpy(row_numbers(index, len(self), "Snapshot")).to(self.worlds.device)
        return Snapshot(self.source, self.worlds[chosen], {name: rows[chosen] for name, rows in self.rows.items()})


def on_warp_stream(device: wp.Device) -> AbstractContextManager:
    """Run torch's launches on Warp's current stream of a device, so that they keep their order with Warp's launches."""
    return torch.cuda.stream(wp.stream_to_torch(device)) if device.is_cuda else nullcontext()


def live_tensors(arrays: Mapping[str, wp.array], nworld: int) -> dict[str, Tensor]:
    """Return the first `nworld` rows of arrays as tensors in the same memory, by name. Empty arrays are left out."""
    # new tensors, because torch does not count the writes of Warp: see `written` in vector/task_worlds.py
    tensors = {name: wp.to_torch(array)[:nworld] for name, array in arrays.items() if array.size}
    # torch cannot index uint64
    return {name: t.view(torch.int64) if t.dtype is torch.uint64 else t for name, t in tensors.items()}


def take(source: tuple[str, ...], live: Mapping[str, Tensor], worlds: np.ndarray) -> Snapshot:
    """Return a snapshot of these worlds, with copies of their rows."""
    chosen = torch.from_numpy(worlds.astype(np.int64)).to(live["data.time"].device)
    rows = {name: tensor[chosen] for name, tensor in live.items()}
    return Snapshot(source, chosen, {**rows, _WERE_FINITE: _are_finite(rows)})


def _are_finite(rows: Mapping[str, Tensor]) -> Tensor:
    """Return whether each row of each float tensor is finite, shape (nrow, n), bool, with columns sorted by name."""
    floats = [rows[name] for name in sorted(rows) if rows[name].is_floating_point()]
    return torch.stack([values[..., None].isfinite().flatten(1).all(dim=1) for values in floats], dim=1)


def _is_plain(tensor: Tensor) -> bool:
    return tensor.layout is torch.strided and not tensor.is_meta


def check_rows(snapshot: Any, source: tuple[str, ...], live: Mapping[str, Tensor], layouts: Layouts, name: str) -> None:
    """Check that a snapshot can be written into the worlds.

    Args:
        snapshot: The snapshot, as a user gave it.
        source: The scene's hash, the split of the layouts, and the names of their params.
        live: The tensors to write to, by name.
        layouts: The layouts of the worlds.
        name: Name of the argument. Errors begin with this name.

    Raises:
        ArgumentTypeError: The value is not a Snapshot.
        SceneMismatchError: The snapshot comes from another scene, split or task, or from worlds with other params. Or
            it has non-finite values, or indices out of range.
        ArgumentError: The value of a param is out of range.
    """
    check_type(snapshot, Snapshot, name)
    check_type(snapshot.rows, Mapping, f"{name}.rows")
    rows: dict[str, Any] = {**snapshot.rows, "worlds": snapshot.worlds}
    given = {key: values for key, values in rows.items() if isinstance(values, Tensor)}
    found = {key: (values.dtype, tuple(values.shape)) for key, values in given.items()}
    tensors = {"worlds": torch.zeros(1, dtype=torch.int64), **live}
    wanted = {key: (tensor.dtype, (len(snapshot), *tensor.shape[1:])) for key, tensor in tensors.items()}
    has_rows = all(_is_plain(values) and values.shape[:1] == (len(snapshot),) for values in given.values())
    if snapshot.source != source or not (has_rows and wanted.items() <= found.items() and _WERE_FINITE in found):
        got = "rows of other names, types or shapes" if snapshot.source == source else short(snapshot.source)
        parts = "scene, split, task and params" if "elapsed" in live else "scene, split and params"
        raise SceneMismatchError(
            f"{name} should have the {parts} of the worlds to restore, got {got}. Take a new snapshot of them."
        )
    # infinities in the memory of a task are legitimate, and so are the NaNs of a layout without a grasp
    state = {key: values for key, values in snapshot.rows.items() if key.startswith(_FINITE)}
    if not (torch.equal(_are_finite(snapshot.rows), rows[_WERE_FINITE]) and _are_finite(state).all()):
        raise SceneMismatchError(f"{name} should have finite numbers, got NaN or inf. Leave out the broken worlds.")
    numbers = {key.split(".")[-1]: rows[key].cpu().numpy() for key in _INDICES if key in rows}
    check_numbers(layouts.compiled, numbers, name)
    for key in live.keys() & {"layout.param", "layout.next_param"}:
        layouts.params.checked(snapshot.rows[key], len(snapshot))


def put(snapshot: Snapshot, live: Mapping[str, Tensor], worlds: np.ndarray | None, name: str) -> Tensor:
    """Write row i of a snapshot into world `worlds[i]`, for all rows, and return the mask of these worlds.

    If `worlds` is None, each row goes into its original world.

    Raises:
        ArgumentError: The number of rows differs from the number of worlds. A world does not exist, or occurs twice.
    """
    nworld, device = len(live["data.time"]), live["data.time"].device
    chosen = (snapshot.worlds if worlds is None else torch.from_numpy(worlds.astype(np.int64))).to(device)
    if len(chosen) != len(snapshot):
        raise ArgumentError(f"{name} should have {len(chosen)} rows, one per chosen world, got {len(snapshot)}.")
    if len(chosen.unique()) != len(chosen) or ((chosen < 0) | (chosen >= nworld)).any():
        raise ArgumentError(f"{name} should go into different worlds with ids below {nworld}, got {chosen.tolist()}.")
    for key, tensor in live.items():
        tensor[chosen] = snapshot.rows[key].to(device)
    return torch.zeros(nworld, dtype=torch.bool, device=device).index_fill_(0, chosen, True)
