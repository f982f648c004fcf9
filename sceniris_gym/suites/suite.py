"""Files of suites: a line about the scene, and a line for each case."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

from pydantic import ConfigDict, NonNegativeInt, TypeAdapter

from sceniris_gym.config.fields import reading
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, SceneMismatchError
from sceniris_gym.files import as_json, read_bytes, write_text
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training.task_scenes import scene_of

LAW = 1
"""Version of the law that defines axes and grades. A suite of another law has other cases."""


@dataclass(frozen=True)
class Case:
    """A case: one episode from one layout.

    Attributes:
        case: Number of the case in its suite.
        id: Id of the layout, with the params that the case changes.
        axis: The axis that the case changes, or "nominal".
        grade: Grade of the change, 0 for nominal cases.
        tags: Words about the case: "clipped" for an edit that ends at an edge of a region, or at an end of a yaw, and
            "redrawn" if an edit gave other objects, such as objects with relations, new places.
        edits: Edits of the nominal layout, by object: "shift" [m] in the support's frame, or "turn" [degrees].
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    case: NonNegativeInt
    id: str
    axis: str
    grade: NonNegativeInt
    tags: tuple[str, ...] = ()
    edits: dict[str, dict[str, Any]] | None = None

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
    """Cases of one task. `digest` is a hash of the file."""

    head: Head
    cases: list[Case]
    digest: str = ""

    def write(self, path: Path) -> None:
        """Write the suite."""
        write_text(path, "".join(as_json(asdict(line)) + "\n" for line in (self.head, *self.cases)))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a suite.

        Raises:
            ArgumentError: The file is missing or damaged, or the suite has another law.
            SceneKeyError: A line has other keys or types.
        """
        first, *lines = read_lines(path, "suite")
        if first["suite"] != LAW:
            raise ArgumentError(f"{path}: should have law {LAW} of suites, got {first['suite']}. Make the suite again.")
        with reading(str(path)):
            head = TypeAdapter(Head).validate_python(first)
            cases = TypeAdapter(list[Case]).validate_python(lines)
        if not cases or any(case.case != i or case.id.count(":") < 3 for i, case in enumerate(cases)):
            raise ArgumentError(f"{path}: should have cases with layout ids, numbered from 0 on. Make the suite again.")
        return cls(head, cases, hashlib.sha256(read_bytes(path)).hexdigest()[:16])

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
