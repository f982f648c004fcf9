"""A writer of data sets. It can be killed at any moment, and a resumed run ends with the same bytes.

Until a data set is complete, the hidden folder `.progress` holds its plan and a record of every finished part. The
process that writes the last part writes `dataset.json` and removes `.progress`. Every file is replaced atomically. If
two processes write the same file, they write the same bytes.
"""

import hashlib
import io
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from sceniris_gym.dataset import manifest
from sceniris_gym.dataset.formats import FORMATS, check_formats
from sceniris_gym.dataset.shard import Shard
from sceniris_gym.errors import DatasetError, SceneKeyError
from sceniris_gym.files import read_bytes, replacing, write_text
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.seeds import as_seeds
from sceniris_gym.layout.tables import make_tables
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.progress import tell
from sceniris_gym.scene.model_files import zipped

PROGRESS = ".progress"


class DatasetWriter:
    """Writes the missing parts of a process's shard of a data set.

    Args:
        compiled: The compiled scene.
        plan: The plan of the data set.
        folder: The folder, created if missing.
        shard: The parts that this process writes.
        resume: Continue an incomplete data set. Processes that write different
            shards of one data set always continue it.

    Raises:
        DatasetError: The folder holds a data set and `resume` is false, or it holds a data set with another plan.
        MissingExtraError: A format needs a library that is not installed.
    """

    def __init__(
        self, compiled: CompiledScene, plan: manifest.DatasetPlan, folder: Path, shard: Shard, *, resume: bool = False
    ) -> None:
        self.compiled, self.plan, self.folder, self.shard = compiled, plan, folder, shard
        self._progress = folder / PROGRESS
        check_formats(plan.fields["formats"])
        begun = self._progress / manifest.MANIFEST
        for path in (folder / manifest.MANIFEST, begun):
            if path.exists():
                self._compare(path, resume or shard.size > 1)
        self._manifest = manifest.read_manifest(folder) if (folder / manifest.MANIFEST).exists() else None
        if self._manifest is None:  # later processes compare their plan with this file
            write_text(begun, json.dumps(plan.fields, indent=1) + "\n")

    def _compare(self, path: Path, resume: bool) -> None:
        """Raise DatasetError if `resume` is false, or if the plan stored at `path` differs from this plan."""
        if not resume:
            raise DatasetError(f"{self.folder}: already holds a data set. Add --resume to finish it, or give another.")
        try:
            held = json.loads(read_bytes(path))
        except FileNotFoundError:  # another process has finished the data set since
            return
        except (ValueError, OSError, RecursionError) as error:
            raise DatasetError(f"{path}: cannot be read ({error}). Remove the data set to start again.") from error
        for name, value in self.plan.fields.items():
            before = held.get(name) if isinstance(held, dict) else held
            if before != value:
                raise DatasetError(
                    f"{path}: the data set here has {name} = {before!s:.200}, not {value!s:.200}. Repeat its original "
                    "command to finish it, or give another folder."
                )

    def write(self, *, chunk: int) -> list[dict[str, Any]]:
        """Make and write the missing parts of this shard, `chunk` layouts at once, and report the progress.

        Returns:
            The records of all finished parts, from all processes. The data set is complete if each part has a record.

        Raises:
            OutputError: A file cannot be written.
            DatasetError: A missing part of a complete data set was made again, and differs from its checksum.
        """
        plan, generator = self.plan, None
        if self._manifest is None or not all((self.folder / name).is_file() for name in plan.files):
            self._write_scene()
        parts = range(self.shard.number, plan.parts, self.shard.size)
        done, total = 0, sum(len(plan.rows(part)) for part in parts)
        for part in parts:
            rows = plan.rows(part)
            if self._record(part) is None:
                nworld = min(chunk, plan.layouts, manifest.PART_ROWS)
                generator = generator or LayoutGenerator(self.compiled, nworld, split=plan.fields["split"])
                self._write_part(part, _made(generator, plan, rows, done, total))
            done += len(rows)
            tell("layouts", done, total)
        return self._finish()

    def _record(self, part: int) -> dict[str, Any] | None:
        """Return the record of a part, None if the part is missing or incomplete."""
        path, rows = self.folder / manifest.part_name(part), len(self.plan.rows(part))
        record = manifest.read_record(self._progress / f"{part:05}.json")
        if self._manifest is not None:
            record = self._manifest["parts"][part]
        size = len(_header(self.plan.row, rows)) + rows * self.plan.row.itemsize
        others = (self.folder / manifest.part_name(part, FORMATS[name][0]) for name in self.plan.fields["formats"])
        there = path.is_file() and path.stat().st_size == size and all(other.is_file() for other in others)
        return record if there and record is not None and record["rows"] == rows else None

    def _write_scene(self) -> None:
        spec = self.compiled.scene.spec
        if spec is None:
            raise SceneKeyError(
                f"{self.compiled.config.where}: model: scene.zip cannot be written, because MuJoCo cannot convert a "
                "MjModel back to MJCF. Give 'model' as a mujoco.MjSpec or as the path of an MJCF file."
            )
        _write(self.folder / manifest.SCENE, zipped(spec))
        if "usd" in self.plan.fields["formats"]:
            from sceniris_gym.dataset import usd_stage

            _write(self.folder / manifest.SCENE_USD, usd_stage.scene_bytes(self.compiled))

    def _write_part(self, part: int, rows: np.ndarray) -> None:
        files = {}
        for word in self.plan.fields["formats"]:
            suffix, encode = FORMATS[word]
            name = manifest.part_name(part, suffix)
            files[name] = _write(self.folder / name, encode(self.compiled, rows))
        header = _header(self.plan.row, len(rows))
        record = {
            "rows": len(rows),
            "sha256": _write(self.folder / manifest.part_name(part), header, rows.view(np.uint8).data),
            "files": files,
            "valid": int(rows["valid"].sum()),
            "first_pass_valid": int(rows["first_pass_valid"].sum()),
        }
        if self._manifest is None:
            write_text(self._progress / f"{part:05}.json", json.dumps(record))
        elif record != self._manifest["parts"][part]:
            raise DatasetError(
                f"{self.folder / manifest.part_name(part)}: was missing, and the new file differs from the checksum in "
                f"{manifest.MANIFEST}. Make it with the same versions of sceniris_gym and its libraries as the other "
                "parts."
            )

    def _finish(self) -> list[dict[str, Any]]:
        """Return the records of all finished parts. If no part is left, write the manifest and remove other files."""
        path = self.folder / manifest.MANIFEST
        if self._manifest is None and not path.exists():
            records = [record for part in range(self.plan.parts) if (record := self._record(part)) is not None]
            if len(records) < self.plan.parts:
                return records
            sums = {name: manifest.checksum(self.folder / name) for name in self.plan.files}
            told = {"scene_sha256": sums.pop(manifest.SCENE), "files": sums, "parts": records}
            write_text(path, json.dumps(self.plan.fields | told, indent=1) + "\n")
        self._manifest = manifest.read_manifest(self.folder)
        shutil.rmtree(self._progress, ignore_errors=True)
        for left in self.folder.glob(".*.tmp"):  # left by killed processes, on this machine or another
            if left.name.startswith((f".{manifest.MANIFEST}.", ".scene.", ".layouts-")):
                left.unlink(missing_ok=True)
        return self._manifest["parts"]


def _made(generator: LayoutGenerator, plan: manifest.DatasetPlan, rows: range, done: int, total: int) -> np.ndarray:
    """Make the rows of a part, and return them as records, shape (len(rows),).

    The reported progress starts at `done` of `total` layouts.
    """
    made = np.zeros(len(rows), plan.row)
    start, seeds = 0, as_seeds((plan.fields["seed"] + rows.start) % (1 << 64), len(rows))
    for table in make_tables(generator, seeds):
        for name in made.dtype.names or ():
            made[name][start : start + len(table)] = getattr(table, name)
        start += len(table)
        tell("layouts", done + start, total)
    return made


def _header(row: np.dtype, nrow: int) -> bytes:
    """Return the header of a .npy file."""
    file = io.BytesIO()
    told = {"descr": npy.dtype_to_descr(row), "fortran_order": False, "shape": (nrow,)}
    npy.write_array_header_1_0(file, told)
    return file.getvalue()


def _write(path: Path, *pieces: bytes | memoryview) -> str:
    """Write a file atomically, wait until it is on disk, and return its SHA-256."""
    digest = hashlib.sha256()
    with replacing(path) as temporary, temporary.open("wb") as file:
        for data in pieces:
            digest.update(data)
            file.write(data)
        file.flush()
        os.fsync(file.fileno())  # otherwise, a crash could leave the record of a file without the file
    return digest.hexdigest()
