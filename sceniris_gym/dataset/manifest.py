"""The contents of a data set: its rows, its parts, and `dataset.json`, which is written after all parts."""

import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np

import sceniris_gym
from sceniris_gym.errors import DatasetError
from sceniris_gym.files import read_bytes
from sceniris_gym.layout.columns import columns, row_types
from sceniris_gym.program.compiled import USER_SPLITS, CompiledScene

MANIFEST, SCENE, SCENE_USD = "dataset.json", "scene.zip", "scene.usdc"
PART_ROWS = 1 << 16
"""Number of rows of a part. It is the same in every process. The last part may have fewer rows."""
FORMAT = 3
STATE = ("qpos", "mocap_pos", "mocap_quat")
"""Columns that make a state: copy each into the field of MjData with the same name."""

_FIELDS = {
    **{"format": int, "scene": str, "hash": str, "split": str, "seed": int, "layouts": int, "rows_of_a_part": int},
    **{"columns": dict, "object_names": list, "reachable_names": list, "formats": list, "versions": dict},
    **{"scene_sha256": str, "files": dict, "parts": list},
}
_RIGHT = {
    "format": (f"[1-{FORMAT}]", f"1 to {FORMAT}"),
    "hash": ("[0-9a-f]{16}", "16 hexadecimal digits"),
    "split": ("|".join(USER_SPLITS), " or ".join(USER_SPLITS)),
    **dict.fromkeys(("sha256", "scene_sha256"), ("[0-9a-f]{64}", "64 hexadecimal digits")),
    **dict.fromkeys(("seed", "valid", "first_pass_valid"), (r"\d+", "0 or more")),
    **dict.fromkeys(("layouts", "rows_of_a_part", "rows"), (r"[1-9]\d*", "positive")),
}
"""Field -> pattern of its values, and a description of the pattern for error messages."""
_AGAIN = "Generate the data set again."
_FILE = re.compile(r"\w[\w.-]{0,200}", re.ASCII)
"""The name of a file in the folder of the manifest."""
_RECORD = {"sha256": str, "files": dict, "rows": int, "valid": int, "first_pass_valid": int}


@dataclass(frozen=True)
class DatasetPlan:
    """The plan of a data set, equal in all processes that write parts of it.

    Attributes:
        fields: The plan as JSON values: the fields of `dataset.json` except files and parts.
        row: Type of a row: a record with an aligned field per column.
    """

    fields: dict[str, Any]
    row: np.dtype

    @classmethod
    def of(cls, compiled: CompiledScene, n: int, seed: int, split: str, formats: tuple[str, ...] = ()) -> Self:
        """Return the plan of `n` layouts of a scene. Row i is episode 0 of seed + i.

        Args:
            compiled: The scene.
            n: Number of layouts.
            seed: Seed of the first row.
            split: "train" or "eval".
            formats: Formats of parts in addition to `.npy`, in alphabetical order.
        """
        left_out = ["param", *([] if compiled.config.start else ["start"])]
        left_out += [] if compiled.scene.draws else columns("draw")
        left_out += [] if compiled.reaching is not None else [*columns("grasp"), "grasp_pose"]
        types = row_types(compiled)
        left_out += [] if types["path"][1][-1] else ["path"]
        types = {name: form for name, form in types.items() if name not in left_out}
        fields = {
            "format": FORMAT,
            "scene": compiled.config.name,
            "hash": compiled.hash,
            "split": split,
            "seed": seed,
            "layouts": n,
            "rows_of_a_part": PART_ROWS,
            "columns": {name: {"dtype": dtype, "shape": list(shape)} for name, (dtype, shape) in types.items()},
            "state_columns": list(STATE),
            "object_names": list(compiled.object_names),
            "reachable_names": [] if compiled.reaching is None else list(compiled.reaching.names),
            "formats": list(formats),
            "versions": {"sceniris_gym": sceniris_gym.__version__, "mujoco": mujoco.__version__},
        }
        return cls(fields, row_of(fields["columns"]))

    @property
    def layouts(self) -> int:
        """Number of rows."""
        return self.fields["layouts"]

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that hold the scene. All parts share these files."""
        return (SCENE, SCENE_USD) if "usd" in self.fields["formats"] else (SCENE,)

    @property
    def parts(self) -> int:
        """Number of parts."""
        return -(-self.layouts // PART_ROWS)

    def rows(self, part: int) -> range:
        """Return the rows of a part."""
        return range(part * PART_ROWS, min((part + 1) * PART_ROWS, self.layouts))


def part_name(part: int, suffix: str = ".npy") -> str:
    """Return the file name of a part."""
    return f"layouts-{part:05}{suffix}"


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file, or "missing"."""
    if not path.is_file():  # a pipe would block
        return "missing"
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def row_of(columns: dict[str, dict[str, Any]]) -> np.dtype:
    """Return the type of a row with columns `{name: {"dtype": ..., "shape": [...]}}`."""
    fields = [(name, np.dtype(told["dtype"]), tuple(told["shape"])) for name, told in columns.items()]
    return np.dtype(fields, align=True)


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read `dataset.json`.

    Raises:
        DatasetError: The file is missing, as in an unfinished data set, or is not a manifest.
    """
    path = folder / MANIFEST
    try:
        return checked(path, json.loads(read_bytes(path)), _FIELDS)
    except FileNotFoundError:
        raise DatasetError(
            f"{folder}: should be a complete data set, but has no {MANIFEST}. If `sceniris-gym generate` was stopped, "
            "repeat its command with --resume."
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: cannot be read ({error}). {_AGAIN}") from error


def read_record(path: Path) -> dict[str, Any] | None:
    """Read the JSON record of a finished part. Return None if the record is missing or damaged."""
    try:
        return checked(path, json.loads(read_bytes(path)), _RECORD)
    except (OSError, ValueError, RecursionError, DatasetError):
        return None


def checked(path: Path, told: Any, fields: dict[str, type]) -> dict[str, Any]:
    """Return `told`, the contents of the file `path`, if it is a mapping with a valid value for each key of `fields`.

    Raises:
        DatasetError: `told` is not a mapping, or a field is missing or has a wrong value.
    """
    for name, kind in fields.items():
        value = told.get(name) if isinstance(told, dict) else None
        pattern, advice = _RIGHT.get(name, ("", f"of type {kind.__name__}"))
        if type(value) is not kind or (pattern and not re.fullmatch(pattern, str(value), re.ASCII)):
            raise DatasetError(f"{path}: '{name}' should be {advice}, got {value!s:.80}. {_AGAIN}")
    for name, digest in told["files"].items():
        if not _FILE.fullmatch(name) or not isinstance(digest, str):
            raise DatasetError(f"{path}: 'files' should map plain file names to checksums, got {name!r:.80}. {_AGAIN}")
    if fields is _RECORD and not told["first_pass_valid"] <= told["valid"] <= told["rows"]:
        raise DatasetError(f"{path}: 'valid' should be from 'first_pass_valid' to 'rows'. {_AGAIN}")
    if fields is _FIELDS:
        for record in told["parts"]:
            checked(path, record, _RECORD)
    return told
