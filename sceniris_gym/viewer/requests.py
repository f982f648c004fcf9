"""What users of the page ask for, from many threads, for the one thread that does it."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Requests:
    """Keeps the latest request about each thing, so that a slider that is dragged leaves no queue behind."""

    def __init__(self) -> None:
        self._waiting: dict[object, Callable[[], None]] = {}
        self._new = threading.Condition()

    def put(self, about: str | None, action: Callable[[], None]) -> None:
        """Ask for something.

        Args:
            about: What it is about: what was asked for about the same thing, and was not done yet, is dropped. None for
                what is to be done as often as it is asked for.
            action: What to do.
        """
        key = object() if about is None else about
        with self._new:
            self._waiting.pop(key, None)
            self._waiting[key] = action
            self._new.notify()

    def take(self, seconds: float) -> list[Callable[[], None]]:
        """Return what was asked for, in order; wait so long for something if there is nothing."""
        with self._new:
            if not self._waiting:
                self._new.wait(seconds)
            taken = list(self._waiting.values())
            self._waiting.clear()
        return taken
