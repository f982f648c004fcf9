"""Progress of a long build, saved in a file so that the build can be stopped and resumed."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sceniris_gym.config.stored_arrays import UNREADABLE, read_arrays
from sceniris_gym.errors import MapError
from sceniris_gym.files import check_writable, replacing

_AGAIN = "Remove the file to start over."
_SECONDS = 60.0  # between two writes


class Checkpoint:
    """Progress of a build: a sequence of tasks, each with arrays that it fills.

    Args:
        path: The file; None saves nothing.
        build: Identifier of the build; the file of a different build is refused.

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
        """Begin a task: restore its arrays, and return True if anything is left to do.

        `done` is then the number of parts that are finished, at most `most`.

        Raises:
            MapError: The file holds arrays of another shape or type, or more finished parts than the task has.
        """
        for name, array in arrays.items():
            if name in self._stored:
                stored = self._stored.pop(name)
                if stored.shape != array.shape or stored.dtype != array.dtype:
                    raise MapError(f"{self._path}: '{name}' holds {stored.dtype} of shape {stored.shape}. {_AGAIN}")
                array[...] = stored
        self._arrays.update(arrays)
        if task in self._finished:
            return False
        self.done = self.done if task == self._task else 0
        self._task = task
        if not 0 <= self.done <= most:
            raise MapError(f"{self._path}: says that {self.done} of {most} parts of '{task}' are done. {_AGAIN}")
        return True

    def leave(self, task: str) -> None:
        """End a task."""
        self._finished.add(task)
        self.reached(0)

    def reached(self, done: int) -> None:
        """Record the number of finished parts, and save if the last save was long ago."""
        self.done = done
        if self._path is None or time.monotonic() - self._written <= _SECONDS:
            return
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
            raise MapError(f"{path}: the state of a different build, with another arm, step or seed. {_AGAIN}")
        self._finished, self._task, self.done = set(finished.split()), task, done
        self._stored = held
