"""Masks of worlds, numbers of worlds and numbers of rows as users pass them: checked once, then on the device."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import Any, SupportsIndex

import numpy as np
import warp as wp

from sceniris_gym.config.bounds import MOST_WORLDS
from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, ArgumentTypeError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def as_mask(mask: Any, nworld: int, device: Any, name: str = "mask") -> wp.array:
    """Return a mask of worlds as a Warp array on `device`, without waiting for it.

    Args:
        mask: Booleans, shape (nworld,): a numpy array, a torch tensor or a Warp array. It is not modified.
        nworld: Number of worlds.
        device: The target device.
        name: Name of the mask in error messages.

    Raises:
        ArgumentTypeError: Not one of these arrays, or not an array of booleans.
        ArgumentError: Wrong shape.
    """
    check_mask(mask, nworld, name)
    return _to_device(mask, wp.bool, device)


def as_host_mask(mask: Any, nworld: int, name: str = "mask") -> np.ndarray:
    """Return a copy of a mask of worlds on the host, shape (nworld,), bool. Wait for the device that it is on.

    Raises:
        ArgumentTypeError, ArgumentError: As `as_mask`.
    """
    check_mask(mask, nworld, name)
    if _kind(mask) == "torch":
        mask = mask.detach().cpu().numpy()
    elif _kind(mask) == "warp":
        wp.synchronize_device(mask.device)  # it may have been written on any stream
        mask = mask.numpy()
    return np.array(mask)


def check_mask(mask: Any, nworld: int, name: str = "mask") -> None:
    """Refuse what `as_mask` does not take, by the same errors."""
    if _kind(mask) is None:
        raise ArgumentTypeError(f"{name} should be a boolean array of numpy, torch or Warp, got {type(mask)}.")
    if str(mask.dtype) not in ("bool", "torch.bool") and mask.dtype is not wp.bool:
        raise ArgumentTypeError(f"{name} should hold booleans, got {mask.dtype}. A comparison, as `x > 0`, gives them.")
    _check_dense(mask, name)
    if tuple(mask.shape) != (nworld,):
        raise ArgumentError(f"{name} should have shape ({nworld},), one element per world, got {tuple(mask.shape)}.")


def as_rows(rows: Any, nrow: int, nworld: int, device: Any) -> wp.array:
    """Return row numbers, one per world and -1 for none, as an int32 Warp array on `device`.

    Args:
        rows: Integers, shape (nworld,): a sequence, a numpy array, a torch tensor or a Warp array of int32.
        nrow: Number of rows to choose from.
        nworld: Number of worlds.
        device: The target device.

    Raises:
        ArgumentTypeError: Not integers.
        ArgumentError: Wrong shape, or a row that does not exist (checked in sequences and numpy arrays only).
    """
    rows = _as_integers(rows, "rows")
    if tuple(rows.shape) != (nworld,):
        raise ArgumentError(f"rows should have shape ({nworld},), one row (or -1) per world, got {tuple(rows.shape)}.")
    return _upload_numbers(rows, "rows", -1, nrow, ", or -1 for none", device)


def as_ids(ids: Any, nworld: int, device: Any) -> wp.array:
    """Return numbers of worlds as an int32 Warp array on `device`, in any order and of any length.

    Args:
        ids: Integers, shape (n,): a sequence, a slice, a numpy array, a torch tensor or a Warp array of int32.
        nworld: Number of worlds.
        device: The target device.

    Raises:
        ArgumentTypeError: Not integers.
        ArgumentError: Wrong shape, or a world that does not exist (checked in sequences and numpy arrays only).
    """
    ids = np.arange(nworld)[ids] if isinstance(ids, slice) else ids
    ids = _as_integers(ids, "env_ids", " For booleans there is `mask`.")
    if len(ids.shape) != 1:
        raise ArgumentError(f"env_ids should have shape (n,), the numbers of worlds, got {tuple(ids.shape)}.")
    return _upload_numbers(ids, "env_ids", 0, nworld, "", device)


def as_numbers(values: Any) -> np.ndarray:
    """Return numbers of a user, in an array of any library or in lists, on the host; all else has shape (0, 0)."""
    try:
        given = values.detach().cpu() if _kind(values) == "torch" else values
        found = np.asarray(given.numpy() if _kind(values) in ("torch", "warp") else given)
    except (TypeError, ValueError, RuntimeError):  # lists of different lengths, or a tensor that has no values
        return np.zeros((0, 0))
    is_whole = found.dtype.kind in "iuf" and not isinstance(values, np.ma.MaskedArray)  # which hides some
    return found if is_whole else np.zeros((0, 0))


@wp.func
def row_of(worldid: int, rows: wp.array[int]) -> int:
    """Return the row of layouts that a world gets: that of its own number, unless there are `rows`."""
    row = worldid
    if rows:
        row = rows[worldid]
    return row


def fill_mask(mask: wp.array | None, mask_out: wp.array) -> None:
    """Copy a mask of worlds, shape (nworld,), bool, to `mask_out`; None is all worlds."""
    if mask is None:
        mask_out.fill_(True)
    elif mask is not mask_out:
        wp.copy(mask_out, mask)


@wp.kernel
def _mask_of_rows(rows: wp.array[int], nrow: int, mask_out: wp.array[wp.bool]):
    worldid = wp.tid()
    mask_out[worldid] = rows[worldid] >= 0 and rows[worldid] < nrow


def mask_of_rows(rows: wp.array, nrow: int, mask_out: wp.array) -> None:
    """Fill `mask_out` (nworld,) bool: true where `rows` names one of `nrow` rows."""
    wp.launch(_mask_of_rows, dim=rows.shape[0], inputs=[rows, nrow], outputs=[mask_out], device=rows.device)


@wp.kernel
def _mask_of_ids(ids: wp.array[int], mask_out: wp.array[wp.bool]):
    worldid = ids[wp.tid()]
    if worldid >= 0 and worldid < mask_out.shape[0]:
        mask_out[worldid] = True


def mask_of_ids(ids: wp.array, mask_out: wp.array) -> None:
    """Fill `mask_out` (nworld,) bool: true for the worlds in `ids` (n,) int32, false for the others."""
    mask_out.zero_()
    wp.launch(_mask_of_ids, dim=ids.shape[0], inputs=[ids], outputs=[mask_out], device=mask_out.device)


def _as_integers(values: Any, name: str, hint: str = "") -> Any:
    """Return integers as an array of one of the libraries; a sequence becomes a numpy array."""
    if _kind(values) is None:
        try:
            values = np.asarray(values)
        except ValueError:  # lists of different lengths
            raise ArgumentTypeError(f"{name} should be integers, got {type(values)} of different lengths.") from None
        values = values.astype(int) if values.size == 0 else values
    _check_dense(values, name)
    if "int" not in getattr(values.dtype, "__name__", str(values.dtype)):
        raise ArgumentTypeError(f"{name} should hold integers, got {values.dtype}.{hint}")
    return values


def _upload_numbers(values: Any, name: str, least: int, end: int, more: str, device: Any) -> wp.array:
    """Return integers from `least` to `end - 1` as int32 on the device; others are refused where the host sees them."""
    if _kind(values) == "numpy":
        wrong = np.flatnonzero((values < least) | (values >= end))
        if len(wrong):
            found = values[wrong[0]]
            raise ArgumentError(f"{name}[{wrong[0]}] should be from 0 to {end - 1}{more}, got {found}.")
        values = values.astype(np.int32)
    elif _kind(values) == "torch":
        # a number out of range must not wrap around to one in range
        values = values.long().clamp(-1, end).int().contiguous()
    return _to_device(values, wp.int32, device)


def _check_dense(array: Any, name: str) -> None:
    """Refuse a torch tensor that has no values of its own in memory, and a NumPy array that hides some."""
    if _kind(array) == "torch" and (array.is_meta or str(array.layout) != "torch.strided" or array.is_nested):
        what = "a meta tensor, which has no values" if array.is_meta else f"a tensor of layout {array.layout}"
        raise ArgumentError(f"{name} should be a dense array, got {what}. `to_dense()` makes one of a sparse one.")
    if isinstance(array, np.ma.MaskedArray):
        raise ArgumentError(f"{name} should be a dense array, got a masked one. `filled(False)` makes one of it.")


def _kind(array: Any) -> str | None:
    """Return the library that an array belongs to, or None; torch is recognised without being imported."""
    if isinstance(array, np.ndarray):
        return "numpy"
    if isinstance(array, wp.array):
        return "warp"
    return "torch" if type(array).__module__ == "torch" and hasattr(array, "data_ptr") else None


def _to_device(array: Any, dtype: type, device: Any) -> wp.array:
    if _kind(array) == "numpy":
        return wp.array(array, dtype=dtype, device=device)
    return (wp.from_torch(array.detach(), dtype=dtype) if _kind(array) == "torch" else array).to(device)


def as_shape(shape: SupportsIndex | Sequence[SupportsIndex], name: str) -> tuple[int, ...]:
    """Return a shape, given as a sequence or as the length of its only axis.

    Raises:
        ArgumentError: A length that is no integer of at least 0, or too many numbers.
    """
    found = tuple(as_count(n, name, 0) for n in (shape if isinstance(shape, Sequence) else (shape,)))
    as_count(math.prod(found), name, 0)
    return found


def as_count(value: Any, name: str, least: int = 1, most: int = MOST_WORLDS) -> int:
    """Return an integer of any library as an int.

    Raises:
        ArgumentError: Not an integer, or one outside of `least` to `most`.
    """
    try:
        count = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        count = None
    if count is None:
        raise ArgumentError(f"{name} should be an integer of at least {least}, got {short(value)}.")
    if not least <= count <= most:
        bound = f"an integer of at least {least}" if count < least else f"at most {most}"
        got = str(count) if abs(count) < 1 << 128 else "a number of more than 38 digits"
        raise ArgumentError(f"{name} should be {bound}, got {got}.")
    return count
