"""Reads untrusted NumPy files, without executing code and without allocating more memory than their contents need."""

import math
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import IO, Annotated, Any

import numpy as np
from numpy.lib import format as npy
from pydantic import PlainSerializer, PlainValidator

from sceniris_gym.files import opened

UNREADABLE = (
    *(OSError, ValueError, TypeError, KeyError, EOFError, RuntimeError, NotImplementedError, OverflowError),
    *(SyntaxError, TokenError, MemoryError, zipfile.BadZipFile, zlib.error),
)
"""Errors that a damaged file may raise when it is read."""

# Maximum compression ratio of Deflate.
_MOST_PACKED = 1040
_HEADER = 1 << 16  # bytes


def _as_list(array: np.ndarray) -> list:
    return [array.dtype.str, array.shape, array.ravel().tolist()]


def _from_list(value: Any) -> np.ndarray:
    kind, shape, values = value
    return np.array(values, np.dtype(kind)).reshape(shape)


Array = Annotated[np.ndarray, PlainValidator(_from_list), PlainSerializer(_as_list)]
"""An array that pydantic writes to JSON and reads back. The numbers stay exactly the same."""


def read_array(path: Path) -> np.ndarray:
    """Read the array of a .npy file.

    Raises:
        UNREADABLE: The file is not a .npy file, or is shorter than its header declares.
    """
    with opened(path) as file:
        if file.read(4) == b"PK\x03\x04":
            raise ValueError("it is an archive of several arrays")
        file.seek(0)
        return _read(file, path.stat().st_size)


def read_arrays(path: Path, *, own: bool = False) -> dict[str, np.ndarray]:
    """Read all arrays of a .npz file. With `own`, refuse a file that other users may write.

    Raises:
        UNREADABLE: The file is not a .npz file, or has less data than its headers declare.
    """
    with opened(path, own=own) as file, zipfile.ZipFile(file) as archive:
        size = path.stat().st_size
        members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
        if sum(info.compress_size for info in members) > size:
            raise ValueError("its parts are larger than the file")
        found = {}
        for info in members:
            if info.file_size > _MOST_PACKED * (info.compress_size + 64):
                raise ValueError(f"'{info.filename}' declares an impossible size of {info.file_size} bytes")
            with archive.open(info) as member:
                found[info.filename.removesuffix(".npy")] = _read(member, info.file_size)
        return found


def _read(file: IO[bytes], size: int) -> np.ndarray:
    """Read an array, after a check that its header declares at most `size` bytes."""
    major, _ = npy.read_magic(file)
    read = npy.read_array_header_1_0 if major == 1 else npy.read_array_header_2_0
    shape, _, dtype = read(file, max_header_size=_HEADER)
    declared = math.prod(shape) * dtype.itemsize
    if dtype.hasobject:
        raise ValueError("it holds Python objects")
    if any(n < 0 for n in shape) or declared > size:
        raise ValueError(f"an array of shape {shape} has {declared} bytes, but the file has at most {size}")
    file.seek(0)
    return np.asarray(npy.read_array(file, allow_pickle=False))
