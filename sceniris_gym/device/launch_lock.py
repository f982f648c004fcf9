"""Threads take turns: Warp's current device, stream and capture belong to the process, not to a thread."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Concatenate, ParamSpec, Protocol, TypeVar

from sceniris_gym.errors import BusyError

_LAUNCHING = threading.RLock()

_P = ParamSpec("_P")
_T = TypeVar("_T")


def launching(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Let one thread at a time run this function, or any other that is marked so; the others wait.

    What one thread launches while another one captures would become part of that capture, or go to its stream.
    """

    @functools.wraps(function)
    def alone(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        with _LAUNCHING:
            return function(*args, **kwargs)

    return alone


class Turn:
    """Held by the thread that uses an object; another one gets an error, as calls of two threads have no order.

    Args:
        what: What the object is called in messages.
    """

    def __init__(self, what: str) -> None:
        self.what = what
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise BusyError(self.what)
        _LAUNCHING.acquire()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        _LAUNCHING.release()
        self._lock.release()


class _HasTurn(Protocol):
    turn: Turn


_H = TypeVar("_H", bound=_HasTurn)


def in_turn(method: Callable[Concatenate[_H, _P], _T]) -> Callable[Concatenate[_H, _P], _T]:
    """Let only one thread run methods of an object that are marked so, by its `turn`.

    Raises:
        BusyError: Another thread does.
    """

    @functools.wraps(method)
    def alone(self: _H, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        with self.turn:
            return method(self, *args, **kwargs)

    return alone
