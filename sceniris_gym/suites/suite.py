"""Files of suites: a line about the scene, a line for each case, and rows of edited layouts in a second file."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from pydantic import ConfigDict, NonNegativeInt, TypeAdapter

from sceniris_gym.config.fields import reading
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, SceneMismatchError
from sceniris_gym.files import UNREADABLE, as_json, read_arrays, read_bytes, replacing, write_text
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import COLUMNS, LayoutTable
from sceniris_gym.training.task_scenes import scene_of

LAW = 1
"""Version of the law that defines axes and grades. A suite of another law has other cases."""


@dataclass(frozen=True)
class Case:
    """A case: one episode from one layout.

    Attributes:
        case: Number of the case in its suite.
        id: Id of the layout. For an edited layout, the id of the nominal layout.
        axis: The axis that the case changes, or "nominal".
        grade: Grade of the change, 0 for nominal cases.
        tags: Words about the case: "clipped" for a shift that ends at an edge of a region.
        edits: Edits of the nominal layout, by object: "shift" [m] in the support's frame, or "turn" [degrees].
        row: The row of the edited layout in the suite's .npz file, None for a layout that the id gives.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    case: NonNegativeInt
    id: str
    axis: str
    grade: NonNegativeInt
    tags: tuple[str, ...] = ()
    edits: dict[str, dict[str, Any]] | None = None
    row: NonNegativeInt | None = None

    @property
    def split(self) -> str:
        """The split of the layout."""
        return self.id.split(":")[1]


@dataclass(frozen=True)
class Head:
    """The first line of a suite.

    Attributes:
        suite: The LAW of the cases.
        task: The task, as `spec_of` takes it.
        scene, hash: Name and hash of the widened scene.
        changes: Changes of the task's scene that widen it, as `--set` takes them.
        params: Names of the params in the ids.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    suite: int
    task: str
    scene: str
    hash: str
    changes: tuple[str, ...]
    params: tuple[str, ...]


class Suite(NamedTuple):
    """Cases of one task. `table` has the edited layouts, and `digest` is a hash of the files of a suite."""

    head: Head
    cases: list[Case]
    table: LayoutTable | None = None
    digest: str = ""

    def write(self, path: Path) -> None:
        """Write the suite and, if it has edited layouts, an .npz file with the same name."""
        if self.table is not None:
            with replacing(path.with_suffix(".npz")) as file, file.open("wb") as opened:
                np.savez(opened, **{name: getattr(self.table, name) for name in COLUMNS})
        write_text(path, "".join(as_json(asdict(line)) + "\n" for line in (self.head, *self.cases)))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a suite from its files.

        Raises:
            ArgumentError: A file is missing or damaged, or the suite has another law.
            SceneKeyError: A line has other keys or types.
        """
        (first, *lines), beside, table = read_lines(path, "suite"), path.with_suffix(".npz"), None
        if first["suite"] != LAW:
            raise ArgumentError(f"{path}: should have law {LAW} of suites, got {first['suite']}. Make the suite again.")
        with reading(str(path)):
            head = TypeAdapter(Head).validate_python(first)
            cases = TypeAdapter(list[Case]).validate_python(lines)
        if not cases or any(case.case != i or case.id.count(":") < 3 for i, case in enumerate(cases)):
            raise ArgumentError(f"{path}: should have cases with layout ids, numbered from 0 on. Make the suite again.")
        digest = hashlib.sha256(read_bytes(path))
        if rows := [case.row for case in cases if case.row is not None]:
            try:
                columns: Any = read_arrays(beside)
                table = LayoutTable(**columns, scene=head.hash, split=cases[0].split, params=head.params)
                table[rows]
            except UNREADABLE as error:
                raise ArgumentError(f"{beside}: should have the edited layouts of {path}: {error}") from None
            digest.update(read_bytes(beside))
        return cls(head, cases, table, digest.hexdigest()[:16])

    def compiled(self, device: str | None) -> CompiledScene:
        """Compile the widened scene.

        Raises:
            SceneMismatchError: The scene is not the scene of the suite any more.
            ScenirisError: The task is unknown, or its scene cannot be compiled.
        """
        config = SceneConfig.load(scene_of(self.head.task, reachable=True), read_changes(self.head.changes))
        compiled = compile_scene(config, device)
        if compiled.hash != self.head.hash:
            now = f"hash {self.head.hash}, now {compiled.hash}"
            raise SceneMismatchError(f"suite: the scene of {self.head.task} changed ({now}). Make the suite again.")
        return compiled


def read_lines(path: Path, what: str) -> list[dict[str, Any]]:
    """Return the lines of a file of JSON objects, which begins with an object that has the key `what`.

    Raises:
        ArgumentError: The file cannot be read, or has another form.
    """
    try:
        lines = [json.loads(line) for line in read_bytes(path).splitlines()]
        if all(isinstance(line, dict) for line in lines) and what in lines[0]:
            return lines
        why = f"its first line has no key '{what}'"
    except (OSError, ValueError, IndexError, RecursionError) as error:
        why = str(error)
    raise ArgumentError(f"{path}: should be a file of 'sceniris-gym suite': {why}.")
