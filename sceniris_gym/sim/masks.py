"""Masks and rows as users give them, checked and brought to the device."""

from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.errors import MaskError, MaskTypeError


def as_mask(mask: Any, nworld: int, device: wp.Device, name: str = "mask") -> wp.array:
    """Return a mask of worlds as a Warp array on `device`, without waiting for it.

    Args:
        mask: booleans, shape (nworld,): a numpy array, a torch tensor or a Warp array; it is read only
        nworld: number of worlds
        device: where the mask is needed
        name: what the mask is called in an error

    Raises:
        MaskTypeError: not one of these arrays, or not of booleans
        MaskError: wrong shape
    """
    check_mask(mask, nworld, name)
    return _to_device(mask, wp.bool, device)


def check_mask(mask: Any, nworld: int, name: str = "mask") -> None:
    """Refuse what is not a mask of worlds, without waiting for a device; see `as_mask` for arguments and errors."""
    if _kind(mask) is None:
        raise MaskTypeError(f"{name} must be a boolean numpy array, torch tensor or Warp array, got {type(mask)}.")
    if str(mask.dtype) not in ("bool", "torch.bool") and mask.dtype is not wp.bool:
        raise MaskTypeError(f"{name} must hold booleans, got {mask.dtype}. A comparison such as `x > 0` gives them.")
    if tuple(mask.shape) != (nworld,):
        raise MaskError(f"{name} must have shape ({nworld},), one element per world, got {tuple(mask.shape)}.")


def as_rows(rows: Any, nrow: int, nworld: int, device: wp.Device) -> wp.array:
    """Return row numbers, one per world and -1 for none, as an int32 Warp array on `device`.

    Args:
        rows: integers, shape (nworld,): a sequence, a numpy array, a torch tensor or a Warp array of int32
        nrow: number of rows there are
        nworld: number of worlds
        device: where the rows are needed

    Raises:
        MaskTypeError: not integers
        MaskError: wrong shape, or (seen only in sequences and numpy arrays) a row that does not exist
    """
    if _kind(rows) is None:
        rows = np.asarray(rows)
    if "int" not in getattr(rows.dtype, "__name__", str(rows.dtype)):
        raise MaskTypeError(f"rows must hold integers, got {rows.dtype}.")
    if tuple(rows.shape) != (nworld,):
        raise MaskError(f"rows must have shape ({nworld},), one row (or -1) per world, got {tuple(rows.shape)}.")
    if _kind(rows) == "numpy":
        wrong = np.flatnonzero((rows < -1) | (rows >= nrow))
        if len(wrong):
            raise MaskError(f"rows[{wrong[0]}] is {rows[wrong[0]]}; rows are 0 to {nrow - 1}, or -1 for none.")
        rows = rows.astype(np.int32)
    elif _kind(rows) == "torch":
        rows = rows.int()
    return _to_device(rows, wp.int32, device)


def _kind(array: Any) -> str | None:
    """Return the library an array is of, or None; torch is recognised without being imported."""
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
