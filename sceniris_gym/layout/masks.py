"""Masks, world ids and row indices as users pass them: checked once, then moved to the device."""

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


def as_host_mask(mask: Any, nworld: int, name: str = "mask") -> np.ndarray:
    """Return a copy of a mask of worlds on the host, shape (nworld,), bool. Waits for the mask's device.

    Raises:
        ArgumentTypeError, ArgumentError: As `check_mask`.
    """
    check_mask(mask, nworld, name)
    if _kind(mask) == "torch":
        mask = mask.detach().cpu().numpy()
    elif _kind(mask) == "warp":
        wp.synchronize_device(mask.device)  # the mask may have been written on any stream
        mask = mask.numpy()
    return np.array(mask)


def check_mask(mask: Any, nworld: int, name: str = "mask") -> None:
    """Check that a mask is a boolean array of numpy, torch or Warp, shape (nworld,).

    Raises:
        ArgumentTypeError: Not an array of these libraries, or not booleans.
        ArgumentError: Wrong shape.
    """
    if _kind(mask) is None:
        raise ArgumentTypeError(f"{name} should be a boolean array of numpy, torch or Warp, got {type(mask)}.")
    if not is_mask(mask):
        raise ArgumentTypeError(f"{name} should hold booleans, got {mask.dtype}. Pass a comparison such as `x > 0`.")
    _check_dense(mask, name)
    if tuple(mask.shape) != (nworld,):
        raise ArgumentError(f"{name} should have shape ({nworld},), one element per world, got {tuple(mask.shape)}.")


def as_rows(rows: Any, nrow: int, nworld: int, device: Any) -> wp.array:
    """Return row indices as an int32 Warp array on `device`: the row of each world, -1 for a world without a row.

    Args:
        rows: Integers, shape (nworld,): a sequence, a numpy array, a torch tensor or a Warp array of int32.
        nrow: Number of rows to choose from.
        nworld: Number of worlds.
        device: The target device.

    Raises:
        ArgumentTypeError: Not integers.
        ArgumentError: Wrong shape, or a row that does not exist (not checked on a GPU or during a capture).
    """
    rows = _as_array(rows, "rows")
    _check_integers(rows, "rows")
    if tuple(rows.shape) != (nworld,):
        raise ArgumentError(f"rows should have shape ({nworld},), one row (or -1) per world, got {tuple(rows.shape)}.")
    return _upload_numbers(rows, "rows", -1, nrow, ", or -1 for none", device)


def as_worlds(worlds: Any, nworld: int, device: Any, mask_out: wp.array | None = None) -> wp.array | None:
    """Return the mask of the worlds that a user chose, shape (nworld,), bool, on `device`, or None for all worlds.

    Args:
        worlds: None for all worlds, booleans of shape (nworld,), ids of worlds in any order, shape (k,), or a slice.
            Booleans and ids may be a sequence, or an array of numpy, torch or Warp (int32).
        nworld: Number of worlds.
        device: The target device.
        mask_out: Memory for a mask made from ids, required in a captured graph. None allocates the memory.

    Raises:
        ArgumentTypeError: Other values than booleans or integers.
        ArgumentError: Wrong shape, a world that does not exist (not checked on a GPU or during a capture), or
            `nworld` integers with repetitions, which look like a mask.
    """
    if worlds is None:
        return None
    if isinstance(worlds, wp.array) and worlds.dtype is wp.bool and worlds.shape == (nworld,):
        return _to_device(worlds, wp.bool, device)  # the usual mask of a loop: the tests below take 2 us
    worlds = _chosen(worlds, nworld)
    if is_mask(worlds):
        check_mask(worlds, nworld, "worlds")
        return _to_device(worlds, wp.bool, device)
    _check_ids(worlds)
    _refuse_integer_mask(worlds, nworld)
    mask = wp.zeros(nworld, dtype=wp.bool, device=device) if mask_out is None else mask_out
    mask_of_ids(_upload_numbers(worlds, "worlds", 0, nworld, "", device), mask)
    return mask


def as_world_ids(worlds: Any, nworld: int) -> np.ndarray:
    """Return the ids of the worlds that a user chose, on the host, in the given order. Waits for their device.

    Raises:
        ArgumentError, ArgumentTypeError: As `as_worlds`.
    """
    if worlds is None:
        return np.arange(nworld)
    worlds = _chosen(worlds, nworld)
    if is_mask(worlds):
        return np.flatnonzero(as_host_mask(worlds, nworld, "worlds"))
    _check_ids(worlds)
    found = as_numbers(worlds)  # once, as each call waits for the device
    _refuse_integer_mask(found, nworld)
    _check_range(found, "worlds", 0, nworld)
    return found


def is_mask(worlds: Any) -> bool:
    """Return whether `worlds` is None or an array of booleans."""
    dtype = getattr(worlds, "dtype", None)
    return worlds is None or dtype is wp.bool or str(dtype) in ("bool", "torch.bool")


def as_numbers(values: Any) -> np.ndarray:
    """Return numbers from lists or from an array of any library, on the host. Invalid values give shape (0, 0)."""
    try:
        given = values.detach().cpu() if _kind(values) == "torch" else values
        found = np.asarray(given.numpy() if _kind(values) in ("torch", "warp") else given)
    except (TypeError, ValueError, RuntimeError):  # lists of different lengths, or a tensor without values
        return np.zeros((0, 0))
    is_whole = found.dtype.kind in "iuf" and not isinstance(values, np.ma.MaskedArray)  # masked arrays hide values
    return found if is_whole else np.zeros((0, 0))


def as_floats(values: Any, device: Any) -> wp.array:
    """Return floats of any library as a Warp array. A Warp array stays as it is, and others become float32."""
    if isinstance(values, wp.array):
        return values
    if _kind(values) == "torch":
        return wp.from_torch(values.detach().float().contiguous())
    return wp.array(np.ascontiguousarray(values, np.float32), device=device)


@wp.func
def selects(mask: wp.array[bool], worldid: int) -> bool:
    """Return True if a mask of worlds selects a world. If there is no mask, all worlds are selected."""
    if mask:
        return mask[worldid]
    return True


@wp.func
def row_of(worldid: int, rows: wp.array[int]) -> int:
    """Return the row of layouts for a world: `rows[worldid]`, or the id of the world if there are no `rows`."""
    row = worldid
    if rows:
        row = rows[worldid]
    return row


def fill_mask(mask: wp.array | None, mask_out: wp.array) -> None:
    """Copy a mask of worlds, shape (nworld,), bool, to `mask_out`. None selects all worlds."""
    if mask is None:
        mask_out.fill_(True)
    elif mask is not mask_out:
        wp.copy(mask_out, mask)


@wp.kernel
def _mask_of_rows(rows: wp.array[int], nrow: int, mask_out: wp.array[wp.bool]):
    worldid = wp.tid()
    mask_out[worldid] = rows[worldid] >= 0 and rows[worldid] < nrow


def mask_of_rows(rows: wp.array, nrow: int, mask_out: wp.array) -> None:
    """Fill `mask_out` (nworld,) bool: true for worlds whose entry of `rows` is a valid index below `nrow`."""
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


def _chosen(worlds: Any, nworld: int) -> Any:
    """Return worlds as an array of numpy, torch or Warp, with unchecked values."""
    if not isinstance(worlds, slice):
        return _as_array(worlds, "worlds")
    try:
        return np.arange(nworld)[worlds]
    except (TypeError, ValueError) as error:  # not integers, or a step of 0
        raise ArgumentError(f"worlds should be a slice of integers, got {worlds}: {error}.") from None


def _check_ids(worlds: Any) -> None:
    _check_integers(worlds, "worlds", "booleans or ids")
    if len(worlds.shape) == 0:
        raise ArgumentError(f"worlds should be booleans, ids or a slice, got {worlds}. For one world, pass [{worlds}].")
    if len(worlds.shape) != 1:
        raise ArgumentError(f"worlds should have shape (k,), the ids of worlds, got {tuple(worlds.shape)}.")


def _refuse_integer_mask(ids: Any, nworld: int) -> None:
    """Reject `nworld` integers with repetitions. Probably, they are a mask of 0 and 1 as for `mjw.reset_data`."""
    if ids.shape[0] != nworld or nworld == 1:
        return
    if _kind(ids) != "numpy" and wp.get_device(str(ids.device)).is_capturing:
        raise ArgumentError(f"during a capture, worlds should be booleans, or fewer than {nworld} ids.")
    if len(np.unique(as_numbers(ids))) < nworld:
        raise ArgumentError(
            f"worlds should be booleans or ids: {nworld} integers with repetitions look like a mask. Pass a comparison "
            "such as `x > 0` for booleans."
        )


def _as_array(values: Any, name: str) -> Any:
    """Return an array of numpy, torch or Warp unchanged, and a sequence as a numpy array."""
    if _kind(values) is None:
        try:
            values = np.asarray(values)
        except ValueError:  # lists of different lengths
            raise ArgumentTypeError(f"{name} should be integers in one list, got a nested {type(values)}.") from None
        values = values.astype(int) if values.size == 0 else values
    _check_dense(values, name)
    return values


def _check_integers(values: Any, name: str, wanted: str = "integers") -> None:
    if _kind(values) == "warp" and values.dtype not in (wp.int32, wp.bool):
        raise ArgumentTypeError(f"{name} should be a Warp array of int32, got {values.dtype.__name__}.")
    if "int" not in getattr(values.dtype, "__name__", str(values.dtype)):
        raise ArgumentTypeError(f"{name} should hold {wanted}, got {values.dtype}.")


def _upload_numbers(values: Any, name: str, least: int, end: int, more: str, device: Any) -> wp.array:
    """Return integers as int32 on the device. Check that values on the host are from `least` to `end - 1`.

    Values on a GPU are not checked, because the host would wait. During a capture, the values are not computed yet.
    """
    source = None if _kind(values) == "numpy" else wp.get_device(str(values.device))
    if source is None or not (source.is_cuda or source.is_capturing):
        _check_range(as_numbers(values), name, least, end, more)
    if _kind(values) == "numpy":
        values = values.astype(np.int32)
    elif _kind(values) == "torch":
        # clamp first, because an out-of-range number must not wrap around to a valid index
        values = values.long().clamp(-1, end).int().contiguous()
    return _to_device(values, wp.int32, device)


def _check_range(values: np.ndarray, name: str, least: int, end: int, more: str = "") -> None:
    wrong = np.flatnonzero((values < least) | (values >= end))
    if len(wrong):
        got = values[wrong[0]]
        raise ArgumentError(f"{name}[{wrong[0]}] should be from 0 to {end - 1}{more}, got {got}.")


def _check_dense(array: Any, name: str) -> None:
    """Reject meta, sparse and nested torch tensors, and masked NumPy arrays."""
    if _kind(array) == "torch" and (array.is_meta or str(array.layout) != "torch.strided" or array.is_nested):
        what = "a meta tensor, which has no values" if array.is_meta else f"a tensor of layout {array.layout}"
        raise ArgumentError(f"{name} should be a dense array, got {what}. Convert sparse tensors with `to_dense()`.")
    if isinstance(array, np.ma.MaskedArray):
        raise ArgumentError(f"{name} should be a dense array, got a masked array. Convert it with `filled(False)`.")


def _kind(array: Any) -> str | None:
    """Return the library of an array, or None. Recognises torch without importing it."""
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
        ArgumentError: A length that is not an integer of at least 0, or too many elements.
    """
    found = tuple(as_count(n, name, 0) for n in (shape if isinstance(shape, Sequence) else (shape,)))
    as_count(math.prod(found), name, 0)
    return found


def as_count(value: Any, name: str, least: int = 1, most: int = MOST_WORLDS) -> int:
    """Return an integer of any library as an int.

    Raises:
        ArgumentError: Not an integer, or not from `least` to `most`.
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
