"""Requests of a page's users, from many threads, for the one thread that does them."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Requests:
    """Keeps the latest request about each thing, so that dragging a slider leaves no queue behind."""

    def __init__(self) -> None:
        self._waiting: dict[object, Callable[[], None]] = {}
        self._new = threading.Condition()

    def put(self, about: str | None, action: Callable[[], None]) -> None:
        """Ask for something.

        Args:
            about: The thing that it is about. An earlier request about the same thing that was not done yet is dropped.
                None if every request counts.
            action: The work to do.
        """
        key = object() if about is None else about
        with self._new:
            self._waiting.pop(key, None)
            self._waiting[key] = action
            self._new.notify()

    def take(self, seconds: float) -> list[Callable[[], None]]:
        """Return the requests in order; if there are none, wait so long for one."""
        with self._new:
            if not self._waiting:
                self._new.wait(seconds)
            taken = list(self._waiting.values())
            self._waiting.clear()
        return taken
