"""`LayoutDataset`: a data set of layouts for torch's data loaders, and its verification."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sceniris_gym.config.fields import as_integer, short
from sceniris_gym.dataset.manifest import MANIFEST, SCENE, checksum, part_name, read_manifest, row_of
from sceniris_gym.device.random import named_stream
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, DatasetError, check_names
from sceniris_gym.files import UNREADABLE
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.progress import tell
from sceniris_gym.scene.layout_table import COLUMNS, LayoutTable

_OPEN = 64  # maximum number of open memory maps, because each keeps a file open
_AGAIN = "Remove the file, and repeat the data set's `sceniris-gym generate` with --resume."


class LayoutDataset(torch.utils.data.Dataset[dict[str, torch.Tensor]]):
    """The layouts in a folder of `sceniris-gym generate`, read on demand from memory maps.

    Args:
        folder: The folder.
        columns: The columns of `LayoutTable` to return per layout. None returns all stored columns.

    Attributes:
        manifest: The contents of `dataset.json`: the scene and its hash, the split, seed, names and columns.
        columns: Names of the columns.

    Raises:
        DatasetError: The data set is not complete, or its files do not match its manifest.
        UnknownNameError: A column is unknown.
        ArgumentTypeError: `folder` is not a path, or `columns` are not names.
    """

    def __init__(self, folder: str | Path, columns: Sequence[str] | None = None) -> None:
        if not isinstance(folder, str | Path):
            raise ArgumentTypeError(f"LayoutDataset: folder should be a path, got {short(folder)}.")
        if columns is not None and not isinstance(columns, Iterable):
            raise ArgumentTypeError(f"LayoutDataset: columns should be column names, got {short(columns)}.")
        self.folder = Path(folder)
        self._absolute = self.folder.absolute()  # the working directory may change
        self.manifest = read_manifest(self.folder)
        self._written = (self.folder / MANIFEST).stat().st_mtime_ns
        self._row = self._read_row()
        known = tuple(self._row.names or ())
        self.columns = known if columns is None else tuple(columns)
        check_names("column", self.columns, f"LayoutDataset({str(folder)!r})", known)
        self._ends = np.cumsum([part["rows"] for part in self.manifest["parts"]])
        self._check_parts()

    def _read_row(self) -> np.dtype:
        try:
            row = row_of(self.manifest["columns"])
        except (TypeError, ValueError, KeyError, AttributeError, SyntaxError, OverflowError) as error:
            raise self._damaged(f"'columns' cannot be read ({error})") from error
        if row.hasobject or not row.names:
            raise self._damaged("'columns' is damaged: each column should have a name and a numeric dtype")
        return row

    def _damaged(self, what: str) -> DatasetError:
        return DatasetError(f"{self.folder / MANIFEST}: {what}. Generate the data set again.")

    def _check_parts(self) -> None:
        """Compare the number and the sizes of the files with the manifest, before memory is allocated."""
        rows = [part["rows"] for part in self.manifest["parts"]]
        if min(rows, default=0) < 1 or sum(rows) != self.manifest["layouts"]:
            raise self._damaged(f"the rows of all parts should add up to {short(self.manifest['layouts'])}")
        paths = [self.folder / part_name(part) for part in range(len(rows))]
        sizes = [path.stat().st_size if path.is_file() else -1 for path in paths]
        missing = [path.name for path, size, n in zip(paths, sizes, rows, strict=True) if size < n * self._row.itemsize]
        if missing:
            raise DatasetError(
                f"{self.folder}: {len(missing)} of its {len(rows)} parts are missing or cut off, among them "
                f"{missing[0]}. Repeat the data set's `sceniris-gym generate` with --resume."
            )

    def __len__(self) -> int:
        return self.manifest["layouts"]

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        """Return one layout: a tensor per column.

        Raises:
            IndexError: The row is out of range.
            ArgumentTypeError: `index` is not an integer.
        """
        return self.__getitems__([as_integer(index, "LayoutDataset: a row")])[0]

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, torch.Tensor]]:
        """Return several layouts, faster than separate calls."""
        found = {name: torch.from_numpy(values) for name, values in self.rows(indices).items()}
        return [{name: values[i] for name, values in found.items()} for i in range(len(indices))]

    def rows(self, indices: Sequence[int] | np.ndarray) -> dict[str, np.ndarray]:
        """Return copies of rows in the order of `indices`: an array of shape (len(indices), ...) per column.

        Raises:
            IndexError: A row is out of range.
            ArgumentTypeError: `indices` are not integers.
            DatasetError: A file is damaged.
        """
        wanted = self._numbers(indices)
        found = np.zeros(len(wanted), self._row)
        parts = np.searchsorted(self._ends, wanted, side="right")
        for part in np.unique(parts):
            here = parts == part
            start = self._ends[part] - self.manifest["parts"][part]["rows"]
            found[here] = self._part(int(part))[wanted[here] - start]
        return {name: np.ascontiguousarray(found[name]) for name in self.columns}

    def _numbers(self, indices: Any) -> np.ndarray:
        """Return row numbers as int64, shape (n,). Negative indices count from the end."""
        try:
            asked = np.asarray(indices).reshape(-1)
        except ValueError:  # lists of different lengths
            asked = np.array([indices], object)
        if asked.dtype == object and all(isinstance(number, int) for number in asked):  # beyond 64 bits
            asked = np.array([len(self)])
        if asked.size and asked.dtype.kind not in "iu":
            raise ArgumentTypeError(f"LayoutDataset: rows should be integers, got {short(indices)}.")
        if ((asked < -len(self)) | (asked >= len(self))).any():
            raise IndexError(f"{self.folder}: a row should be from 0 to {len(self) - 1}.")
        return asked.astype(np.int64) % len(self)

    def __call__(self, compiled: CompiledScene, num_envs: int) -> StoredLayouts:
        """Return a layout source that serves these layouts. A data set can therefore be a `layout_source`."""
        return StoredLayouts(compiled, self.table(), num_envs)

    def table(self, first: int = 0, count: int | None = None) -> LayoutTable:
        """Return `count` rows from row `first` on as a LayoutTable, for example for `StoredLayouts`.

        If `count` is None, all rows from `first` on are returned.

        Raises:
            ArgumentError: The rows are out of range, or the data set was opened with only some of its `columns`.
            ArgumentTypeError: `first` or `count` is not an integer.
        """
        first = as_integer(first, "LayoutDataset.table: first")
        count = len(self) - first if count is None else as_integer(count, "LayoutDataset.table: count")
        if first < 0 or count < 0 or first + count > len(self):
            raise ArgumentError(f"LayoutDataset.table: rows should be from 0 to {len(self) - 1}.")
        if set(self.columns) != set(self._row.names or ()):
            raise ArgumentError("LayoutDataset.table: a table needs all columns. Open the data set without 'columns'.")
        rows = self.rows(np.arange(first, first + count))
        states = LayoutTable.from_states(rows["qpos"], rows["mocap_pos"], rows["mocap_quat"], rows["present"])
        if "draw_seed" not in rows:  # no randomised fields, or an older file without the keys of fallbacks
            held = {name: getattr(states, name) for name in ("seed", "episode", "valid")} | rows
            rows["draw_seed"], rows["draw_episode"] = held["seed"], np.where(held["valid"], held["episode"], -1)
            rows["draw_stream"] = np.full(count, named_stream(self.manifest["split"]), np.int32)
        columns = {name: rows[name] for name in COLUMNS if name in rows}
        # pyrefly: ignore[bad-argument-type]
        return replace(states, **columns, scene=self.manifest["hash"], split=self.manifest["split"])

    def _part(self, part: int) -> np.ndarray:
        """Return the memory map of a part, shape (nrow,)."""
        path = self._absolute / part_name(part)
        try:
            rows = _mapped(path, self._written)
        except UNREADABLE as error:
            raise DatasetError(f"{path}: NumPy cannot read it ({error}). {_AGAIN}") from error
        if getattr(rows, "dtype", None) != self._row or rows.shape != (self.manifest["parts"][part]["rows"],):
            raise DatasetError(f"{path}: its columns and number of rows should be as in {MANIFEST}. {_AGAIN}")
        return rows


@lru_cache(_OPEN)
def _mapped(path: Path, written: int) -> np.ndarray:
    """Return the memory map of a file. The latest maps stay open.

    Args:
        path: The file.
        written: Time at which the manifest was written [ns]. A new data set in the same folder has another
            time, so maps of the old data set are not used.
    """
    return np.load(path, mmap_mode="r", allow_pickle=False)


def verify(dataset: str | Path | LayoutDataset) -> dict[str, Any]:
    """Compare all files of a data set with the checksums in its manifest, and return the manifest.

    `dataset` may also be the folder of the data set.

    Raises:
        DatasetError: The data set is not complete, or files are damaged. The message names up to five damaged files.
        ArgumentTypeError: `dataset` is neither a path nor a data set.
    """
    dataset = dataset if isinstance(dataset, LayoutDataset) else LayoutDataset(dataset)
    folder, held, damaged = dataset.folder, dataset.manifest, []

    def compare(sums: dict[str, Any]) -> None:
        damaged.extend(name for name, told in sums.items() if checksum(folder / name) != told)

    compare({SCENE: held["scene_sha256"], **held["files"]})
    for part, record in enumerate(held["parts"]):
        compare({part_name(part): record["sha256"], **record["files"]})
        tell("layouts", int(dataset._ends[part]), len(dataset))
    if damaged:
        more = f" and {len(damaged) - 5} others" if len(damaged) > 5 else ""
        raise DatasetError(
            f"{folder}: {', '.join(damaged[:5])}{more} {'is' if len(damaged) == 1 else 'are'} damaged or missing, "
            f"according to {MANIFEST}. Remove damaged files, and repeat the `sceniris-gym generate` with --resume."
        )
    return held
