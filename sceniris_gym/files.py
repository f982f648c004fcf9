"""Atomic file writes, checks before long work that a file can be written, JSON, and safe reads of untrusted files."""

import errno
import json
import math
import os
import re
import secrets
import stat
import sys
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tokenize import TokenError
from typing import IO, Annotated, Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from pydantic import PlainSerializer, PlainValidator

from sceniris_gym.errors import ArgumentError, NotSupportedError, OutputError

UNWRITABLE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO})
"""Errors of the operating system that mean that the file system rejects writes."""

NO_FILE = "a folder, a pipe or a device, not a file"
"""Kinds of paths that exist but are not read."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file next to `path`, which replaces `path` if the block succeeds.

    If the block fails, or a signal ends the program, the temporary file is removed and `path` stays unchanged. If a
    process is killed, its temporary file stays until the next process in the same container writes to `path`. The
    user's umask sets the permissions.

    Raises:
        OutputError: The file cannot be written.
    """
    with _file_beside(path) as file:
        try:
            yield file
        except OSError as error:
            if error.errno not in UNWRITABLE:
                raise
            raise OutputError(str(path), str(error.strerror).lower()) from error
        with _in_words(path):
            os.replace(file, path)


def opened(path: Path, *, own: bool = False) -> BinaryIO:
    """Open a regular file for reading. Pipes and devices are refused, because they may never end.

    Args:
        path: The file.
        own: Also refuse a file that other users own or may write. Root may own it.

    Raises:
        OSError: The file cannot be opened, or is refused.
    """
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # opening a pipe would block
    found = os.fstat(file)
    foreign = found.st_uid not in (0, os.geteuid()) or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if stat.S_ISREG(found.st_mode) and not (own and foreign):
        return os.fdopen(file, "rb")
    os.close(file)
    raise OSError(errno.EINVAL, "it should be a file that no other user may write to" if own else NO_FILE, str(path))


def no_file(path: Path, what: str = "file") -> str:
    """Return why a path is not a file, for an error message. `what` names the kind of file."""
    return f"it is {NO_FILE}" if path.exists() else f"there is no such {what}"


def read_bytes(path: Path) -> bytes:
    """Read a whole file, opened by `opened`."""
    with opened(path) as file:
        return file.read()


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, see `replacing`."""
    with replacing(path) as file:
        file.write_text(text)


@contextmanager
def redirected(source: int, target: int) -> Iterator[None]:
    """Send the output of a file descriptor, such as 1 for stdout, to another descriptor, also in compiled libraries."""
    sys.stdout.flush()
    kept = os.dup(source)
    os.dup2(target, source)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, source)
        os.close(kept)


def check_writable(path: Path) -> None:
    """Check that `path` can be written, before the work that produces its content. Leaves no file behind.

    Raises:
        OutputError: The path cannot be written.
    """
    if path.is_dir():
        raise OutputError(str(path), "it is a folder")
    folder = next(folder for folder in path.parents if folder.exists())
    with _file_beside(folder / path.name):
        pass


def check_new(path: Path | None, command: str, remedy: str = "Give another --out, or remove this file.") -> None:
    """Check that a file does not exist, so that `command` does not overwrite a file that the user may have edited.

    None means no file.

    Raises:
        ArgumentError: The file exists. The message ends with `remedy`.
    """
    if path is not None and path.exists():
        raise ArgumentError(f"{command}: {path} exists. {remedy}")


def check_picture(path: Path | None, suffix: str = ".png") -> None:
    """Check that `path` ends in `suffix` and can be written. None means no picture.

    Raises:
        NotSupportedError: The path has another suffix.
        OutputError: The path cannot be written.
    """
    if path is None:
        return
    if path.suffix.lower() != suffix:
        raise NotSupportedError(
            f"{path}: a picture should be a PNG, a video an MP4. Give a path that ends in {suffix}."
        )
    check_writable(path)


def as_json(value: Any, *, digits: int | None = None, indent: int | None = None) -> str:
    """Return strict JSON. Non-finite numbers become null, and paths become text.

    Args:
        value: The value.
        digits: Significant digits of floats, None for all.
        indent: Spaces per level of indentation, None for a single line.
    """

    def plain(part: Any) -> Any:
        if isinstance(part, dict):
            return {key: plain(item) for key, item in part.items()}
        if isinstance(part, list | tuple):
            return [plain(item) for item in part]
        if isinstance(part, float):
            short = part if digits is None else float(f"{part:.{digits}g}")
            return short if math.isfinite(part) else None
        return str(part) if isinstance(part, Path) else part

    return json.dumps(plain(value), allow_nan=False, indent=indent)


@contextmanager
def _file_beside(path: Path) -> Iterator[Path]:
    """Make an empty file next to `path`, and remove it at the end of the block. Until then it stays open."""
    with _in_words(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_orphans(path)
        file = path.with_name(f".{path.name}.{_container()}-{os.getpid()}.{secrets.token_hex(4)}.tmp")
        # a signal's thread finds it among the open files, see `stopping`
        made = file.open("x")
    try:
        yield file
    finally:
        file.unlink(missing_ok=True)
        made.close()


def _remove_orphans(path: Path) -> None:
    """Remove temporary files for `path` that processes of this container left behind when they were killed."""
    form = re.compile(rf"\.{re.escape(path.name)}\.{_container()}-(\d+)\.\w+\.tmp")
    for other in path.parent.iterdir():
        found = form.fullmatch(other.name)
        if found is not None and not Path("/proc", found[1]).exists():
            other.unlink(missing_ok=True)


def _container() -> str:
    """Return a name for this container: the running kernel's boot id and its process namespace.

    Host names do not distinguish containers. On systems without /proc, each call returns a different name, so that no
    process takes another container's file for an orphan.
    """
    with suppress(OSError):
        kernel = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{kernel}-{os.stat('/proc/self/ns/pid').st_ino}"
    return secrets.token_hex()


@contextmanager
def _in_words(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(str(path), (error.strerror or str(error)).lower()) from error


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
        return _read_npy(file, path.stat().st_size)


def read_arrays(path: Path, *, own: bool = False) -> dict[str, np.ndarray]:
    """Read all arrays of a .npz file. With `own`, refuse a file that other users may write.

    Raises:
        UNREADABLE: The file is not a .npz file, or has less data than its headers declare.
    """
    with opened(path, own=own) as file, zipfile.ZipFile(file) as archive:
        size = path.stat().st_size
        members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
        if sum(info.compress_size for info in members) > size:
            raise ValueError("it declares parts that are larger than the file")
        found = {}
        for info in members:
            if info.file_size > _MOST_PACKED * (info.compress_size + 64):
                raise ValueError(f"'{info.filename}' declares an impossible size of {info.file_size} bytes")
            with archive.open(info) as member:
                found[info.filename.removesuffix(".npy")] = _read_npy(member, info.file_size)
        return found


def _read_npy(file: IO[bytes], size: int) -> np.ndarray:
    """Read an array, after a check that its header declares at most `size` bytes."""
    major, _ = npy.read_magic(file)
    read = npy.read_array_header_1_0 if major == 1 else npy.read_array_header_2_0
    shape, _, dtype = read(file, max_header_size=_HEADER)
    declared = math.prod(shape) * dtype.itemsize
    if dtype.hasobject:
        raise ValueError("its values are Python objects, but should be numbers")
    if any(n < 0 for n in shape) or declared > size:
        raise ValueError(f"an array of shape {shape} has {declared} bytes, but the file has at most {size}")
    file.seek(0)
    return np.asarray(npy.read_array(file, allow_pickle=False))
