"""The launch lock: one thread launches at a time, since Warp's device, stream and capture belong to the process."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, TypeVar

from sceniris_gym.errors import BusyError

# One for the process, as Warp's stream and capture are.
_LAUNCH_LOCK = threading.RLock()

_P = ParamSpec("_P")
_T = TypeVar("_T")


def launching(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Hold the launch lock while the function runs; other threads wait for it.

    Launches of one thread during a capture of another would become part of that capture, or go to its stream.
    """

    @functools.wraps(function)
    def locked(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        with _LAUNCH_LOCK:
            return function(*args, **kwargs)

    return locked


class ObjectLock:
    """A lock of one object and the launch lock, taken together.

    A thread that finds the object in use gets an error instead of waiting: the order of calls from two threads would be
    a matter of chance.

    Args:
        what: Name of the object in messages.
    """

    def __init__(self, what: str) -> None:
        self.what = what
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise BusyError(self.what)
        _LAUNCH_LOCK.acquire()

    def __exit__(self, *_: object) -> None:
        _LAUNCH_LOCK.release()
        self._lock.release()


def exclusive(method: Callable[Concatenate[Any, _P], _T]) -> Callable[Concatenate[Any, _P], _T]:
    """Hold the object's `lock` while the method runs.

    Raises:
        BusyError: Another thread holds it.
    """

    @functools.wraps(method)
    def locked(self: Any, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        with self.lock:
            return method(self, *args, **kwargs)

    return locked
