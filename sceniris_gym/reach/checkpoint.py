"""Saves the progress of a long build to a file, so that the build can be stopped and resumed."""

import math
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sceniris_gym.errors import MapError
from sceniris_gym.files import UNREADABLE, check_writable, read_arrays, replacing

_AGAIN = "Remove the file to start over."
_SECONDS = 60.0  # between two writes


class Checkpoint:
    """Progress of a build, which is a sequence of tasks. Each task fills its arrays, part by part.

    Args:
        path: The file. If None, progress is not saved.
        build: Identifier of the build. The file of a different build is rejected.

    Raises:
        MapError: The file belongs to a different build, or is not a checkpoint.
        OutputError: The file cannot be written.
    """

    def __init__(self, path: Path | None, build: str) -> None:
        self.done = 0
        self._path, self._build = path, build
        self._finished: set[str] = set()
        self._task = ""
        self._arrays: dict[str, np.ndarray] = {}
        self._stored: dict[str, np.ndarray] = {}
        self._written = time.monotonic()
        if path is not None:
            check_writable(path)
            if path.is_file():
                self._read(path)

    def enter(self, task: str, arrays: Mapping[str, np.ndarray], most: float = math.inf) -> bool:
        """Begin a task: fill its arrays with their saved values, and return True if the task still has work to do.

        In this case, the attribute `done` is the number of parts that are already finished.

        Args:
            task: Name of the task.
            arrays: The arrays that the task fills, by name.
            most: Number of parts of the task.

        Raises:
            MapError: The saved arrays differ from `arrays` in shape or type, or the file has more finished parts than
                the task.
        """
        for name, array in arrays.items():
            if name in self._stored:
                stored = self._stored.pop(name)
                if stored.shape != array.shape or stored.dtype != array.dtype:
                    wanted, got = (f"{a.dtype} {a.shape}" for a in (array, stored))
                    raise MapError(f"{self._path}: '{name}' should be {wanted}, got {got}. {_AGAIN}")
                array[...] = stored
        self._arrays.update(arrays)
        if task in self._finished:
            return False
        self.done = self.done if task == self._task else 0
        self._task = task
        if not 0 <= self.done <= most:
            raise MapError(f"{self._path}: '{task}' has {most} parts, but {self.done} are stored as done. {_AGAIN}")
        return True

    def leave(self, task: str) -> None:
        """Mark a task as finished."""
        self._finished.add(task)
        self.reached(0)

    def reached(self, done: int) -> None:
        """Set `done`, the number of finished parts. Write the file if the last write is over a minute ago."""
        self.done = done
        if self._path is None or time.monotonic() - self._written <= _SECONDS:
            return
        if not self._path.exists():
            print(f"sceniris_gym: {self._path} keeps the progress, so the same command resumes.", file=sys.stderr)
        with replacing(self._path) as temporary, temporary.open("wb") as file:
            told = {"build": self._build, "finished": " ".join(sorted(self._finished)), "task": self._task}
            np.savez(file, allow_pickle=False, **told, done=self.done, **self._arrays)
        self._written = time.monotonic()

    def _read(self, path: Path) -> None:
        try:
            held = read_arrays(path)
            build, finished, task = (str(held.pop(name)) for name in ("build", "finished", "task"))
            done = int(held.pop("done"))
        except UNREADABLE as error:
            raise MapError(f"{path}: this is not the saved state of a build ({error}). {_AGAIN}") from error
        if build != self._build:
            raise MapError(f"{path}: the state is from a different build, with another arm, step or seed. {_AGAIN}")
        self._finished, self._task, self.done = set(finished.split()), task, done
        self._stored = held
