"""Checks masks and row numbers that users pass, and copies them to the device."""

from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.errors import MaskError, MaskTypeError


def as_mask(mask: Any, nworld: int, device: wp.Device, name: str = "mask") -> wp.array:
    """Return a mask of worlds as a Warp array on `device`, without waiting for it.

    Args:
        mask: Booleans, shape (nworld,): a numpy array, a torch tensor or a Warp array. It is not modified.
        nworld: Number of worlds.
        device: The target device.
        name: Name of the mask in error messages.

    Raises:
        MaskTypeError: Not one of these arrays, or not an array of booleans.
        MaskError: Wrong shape.
    """
    check_mask(mask, nworld, name)
    return _to_device(mask, wp.bool, device)


def check_mask(mask: Any, nworld: int, name: str = "mask") -> None:
    """Raise what `as_mask` raises if `mask` is not a mask of worlds, without waiting for a device."""
    if _kind(mask) is None:
        raise MaskTypeError(f"{name} should be a boolean numpy array, torch tensor or Warp array, got {type(mask)}.")
    if str(mask.dtype) not in ("bool", "torch.bool") and mask.dtype is not wp.bool:
        raise MaskTypeError(f"{name} should hold booleans, got {mask.dtype}. A comparison such as `x > 0` gives them.")
    _check_plain(mask, name)
    if tuple(mask.shape) != (nworld,):
        raise MaskError(f"{name} should have shape ({nworld},), one element per world, got {tuple(mask.shape)}.")


def as_rows(rows: Any, nrow: int, nworld: int, device: wp.Device) -> wp.array:
    """Return row numbers, one per world and -1 for none, as an int32 Warp array on `device`.

    Args:
        rows: Integers, shape (nworld,): a sequence, a numpy array, a torch tensor or a Warp array of int32.
        nrow: Number of rows to choose from.
        nworld: Number of worlds.
        device: The target device.

    Raises:
        MaskTypeError: Not integers.
        MaskError: Wrong shape, or a row that does not exist (checked in sequences and numpy arrays only).
    """
    if _kind(rows) is None:
        try:
            rows = np.asarray(rows)
        except ValueError:  # lists of different lengths
            raise MaskTypeError(f"rows should be integers, one per world, got {type(rows)}.") from None
    _check_plain(rows, "rows")
    if "int" not in getattr(rows.dtype, "__name__", str(rows.dtype)):
        raise MaskTypeError(f"rows should hold integers, got {rows.dtype}.")
    if tuple(rows.shape) != (nworld,):
        raise MaskError(f"rows should have shape ({nworld},), one row (or -1) per world, got {tuple(rows.shape)}.")
    if _kind(rows) == "numpy":
        wrong = np.flatnonzero((rows < -1) | (rows >= nrow))
        if len(wrong):
            raise MaskError(f"rows[{wrong[0]}] should be from 0 to {nrow - 1}, or -1 for none, got {rows[wrong[0]]}.")
        rows = rows.astype(np.int32)
    elif _kind(rows) == "torch":
        rows = rows.long().clamp(-1, nrow).int()  # what does not exist must not wrap around to what does
    return _to_device(rows, wp.int32, device)


def as_ids(ids: Any, nworld: int, device: wp.Device) -> wp.array:
    """Return numbers of worlds as an int32 Warp array on `device`, in any order and of any length.

    Args:
        ids: Integers, shape (n,): a sequence, a slice, a numpy array, a torch tensor or a Warp array of int32.
        nworld: Number of worlds.
        device: The target device.

    Raises:
        MaskTypeError: Not integers.
        MaskError: Wrong shape, or a world that does not exist (checked in sequences and numpy arrays only).
    """
    if isinstance(ids, slice):
        ids = np.arange(nworld)[ids]
    if _kind(ids) is None:
        ids = np.asarray(ids)
        ids = ids.astype(int) if ids.size == 0 else ids
    if "int" not in getattr(ids.dtype, "__name__", str(ids.dtype)):
        raise MaskTypeError(f"env_ids should hold integers, got {ids.dtype}. For booleans there is `mask`.")
    if len(ids.shape) != 1:
        raise MaskError(f"env_ids should have shape (n,), the numbers of worlds, got {tuple(ids.shape)}.")
    if _kind(ids) == "numpy":
        wrong = np.flatnonzero((ids < 0) | (ids >= nworld))
        if len(wrong):
            raise MaskError(f"env_ids[{wrong[0]}] should be from 0 to {nworld - 1}, got {ids[wrong[0]]}.")
    elif _kind(ids) == "torch":
        ids = ids.clamp(-1, nworld).int().contiguous()  # what does not exist must not wrap around to what does
    return _to_device(ids, wp.int32, device)


def _check_plain(array: Any, name: str) -> None:
    """Refuse a torch tensor that has no values of its own in memory, and a NumPy array that hides some."""
    if _kind(array) == "torch" and (array.is_meta or str(array.layout) != "torch.strided" or array.is_nested):
        what = "a meta tensor, which has no values" if array.is_meta else f"a tensor of layout {array.layout}"
        raise MaskError(f"{name} should be a dense array, got {what}. `to_dense()` makes one of a sparse one.")
    if isinstance(array, np.ma.MaskedArray):
        raise MaskError(f"{name} should be a dense array, got a masked one. `filled(False)` makes one of it.")


def _kind(array: Any) -> str | None:
    """Return the library that an array belongs to, or None; torch is recognised without being imported."""
    if isinstance(array, np.ndarray):
        return "numpy"
    if isinstance(array, wp.array):
        return "warp"
    return "torch" if type(array).__module__ == "torch" and hasattr(array, "data_ptr") else None


def _to_device(array: Any, dtype: type, device: wp.Device) -> wp.array:
    match _kind(array):
        case "numpy":
            return wp.array(array, dtype=dtype, device=device)
        case "torch":
            array = wp.from_torch(array.detach(), dtype=dtype)
    return array.to(device)
