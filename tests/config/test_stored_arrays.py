"""Arrays in files: read whole, and never allocated where the file is too small to hold them."""

from __future__ import annotations

import io
import os
import resource
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from sceniris_gym.files import UNREADABLE, read_array, read_arrays

BROKEN = b"\x93NUMPY\x01\x00\x10\x00{'descr': ('<f8'\n\n"
"""A head in which a bracket is open, at which Python's tokenizer gives up."""


def _header(shape: tuple[int, ...]) -> bytes:
    """The head of a file that declares an array of this shape, and a little of its contents."""
    file = io.BytesIO()
    npy.write_array_header_2_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return file.getvalue() + bytes(64)


def _archive(path: Path, member: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", member)
    return path


def test_what_numpy_writes_is_read(tmp_path: Path):
    """One array, or several, compressed or not."""
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array("text"), "c": np.zeros((0, 4), np.float16)}
    np.save(tmp_path / "one.npy", arrays["a"])
    np.testing.assert_array_equal(read_array(tmp_path / "one.npy"), arrays["a"])
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "all.npz", **arrays)
        found = read_arrays(tmp_path / "all.npz")
        assert list(found) == list(arrays)
        for name, array in arrays.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array)


@pytest.mark.parametrize("shape", [(10**10,), (10**6, 10**6), (2**62, 4), (-1, 5)])
def test_a_file_that_declares_more_than_it_holds_is_refused(tmp_path: Path, shape: tuple[int, ...]):
    """Before anything is allocated: memory is limited to what is in use and a gigabyte more."""
    (tmp_path / "a.npy").write_bytes(_header(shape))
    kept = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + (1 << 30), kept[1]))
    try:
        with pytest.raises(ValueError, match=r"bytes, but the file has|Invalid shape|shape is not valid"):
            read_array(tmp_path / "a.npy")
        with pytest.raises(ValueError, match=r"bytes, but the file has|Invalid shape|shape is not valid"):
            read_arrays(_archive(tmp_path / "a.npz", _header(shape)))
    finally:
        resource.setrlimit(resource.RLIMIT_AS, kept)


def test_objects_of_python_are_never_loaded(tmp_path: Path):
    """Loading them could run anything."""
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match="objects"):
        read_array(tmp_path / "a.npy")


@pytest.mark.parametrize(
    "text", [b"", b"PK\x03\x04", b"\x93NUMPY", b"\x93NUMPY\x01\x00\xff\xff", b"nothing" * 99, BROKEN]
)
def test_what_is_no_such_file_is_refused(tmp_path: Path, text: bytes):
    """With one of the errors that callers translate."""
    (tmp_path / "a").write_bytes(text)
    for read in (read_array, read_arrays):
        with pytest.raises(UNREADABLE):
            read(tmp_path / "a")


def test_arrays_without_an_end_are_refused(tmp_path: Path):
    """A link to a device has no size to compare with, and a pipe nobody who writes to it."""
    (tmp_path / "zero").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    for name in ("zero", "pipe"):
        for read in (read_array, read_arrays):
            with pytest.raises(UNREADABLE, match="a pipe or a device"):
                read(tmp_path / name)
