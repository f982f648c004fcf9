"""Attempts in processes of their own, which are replaced when one of them crashes or hangs."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

MOST_SECONDS = 300.0
"""What an attempt may take; the first one in a process may have to wait for kernels to be compiled."""


def _work(pipe: Connection, attempt: Callable[[Any], Any], lost: Callable[[Any, str], Any]) -> None:
    """Make the attempts that come through a pipe."""
    os.chdir(tempfile.mkdtemp())  # MuJoCo C writes its log where it runs
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    while (task := pipe.recv()) is not None:
        try:
            pipe.send(attempt(task))
        except Exception as error:  # of the generator or of the judge, which are to be mended
            pipe.send(lost(task, f"the benchmark itself: {type(error).__name__}: {error}"))


class _Worker:
    """A process that makes attempts, and is replaced when it dies or hangs."""

    def __init__(self, attempt: Callable[[Any], Any], lost: Callable[[Any, str], Any], seconds: float) -> None:
        self._arguments, self._lost, self._seconds = (attempt, lost), lost, seconds
        self._task: Any = None
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self._process = context.Process(target=_work, args=(other, *self._arguments), daemon=True)
        self._process.start()
        other.close()

    def give(self, task: Any) -> None:
        """Let it make an attempt, or None to end."""
        self._task, self._since = task, time.perf_counter()
        self.pipe.send(task)

    def outcome(self) -> Any:
        """Return the outcome of its attempt; None as long as it works."""
        if self.pipe.poll():
            try:
                return self.pipe.recv()
            except EOFError:
                self._process.join()
                return self._replaced(f"crash with exit code {self._process.exitcode}")
        if time.perf_counter() - self._since > self._seconds:
            return self._replaced(f"hang: more than {self._seconds:g} s")
        return None

    def _replaced(self, reason: str) -> Any:
        self._process.kill()
        self._process.join()
        self._start()
        return self._lost(self._task, reason)


def try_all(
    attempt: Callable[[Any], Any],
    tasks: Sequence[Any],
    jobs: int,
    lost: Callable[[Any, str], Any],
    seconds: float = MOST_SECONDS,
) -> Iterator[Any]:
    """Make attempts in several processes; outcomes come as they are ready.

    Args:
        attempt: What is tried. It is sent to the processes, so it is a function of a module, or a partial of one.
        tasks: Its arguments, none of them None.
        jobs: Number of processes.
        lost: The outcome of a task whose process died, hung or raised, by the task and the reason.
        seconds: What an attempt may take [s].
    """
    waiting = list(reversed(tasks))
    busy = [_Worker(attempt, lost, seconds) for _ in range(min(jobs, len(tasks)))]
    for worker in busy:
        worker.give(waiting.pop())
    while busy:
        wait([worker.pipe for worker in busy], timeout=1.0)
        for worker in list(busy):
            outcome = worker.outcome()
            if outcome is None:
                continue
            yield outcome
            if waiting:
                worker.give(waiting.pop())
            else:
                worker.give(None)
                busy.remove(worker)
