"""The launch lock, and `LaunchSequence`: kernel launches that are captured into a graph and then replayed.

One thread launches at a time, because Warp's device, stream and capture belong to the process.
"""

import functools
import threading
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, TypeVar

import warp as wp

from sceniris_gym.device.loading import ModuleVariant, load_modules, on_missing
from sceniris_gym.errors import BusyError, refuses_old_names

# One lock for the process, because Warp's stream and capture belong to the process.
_LAUNCH_LOCK = threading.RLock()

# A CPU records a graph in the time of two to ten direct runs, and many sequences, such as a proof, run only once.
_DIRECT_ON_CPU = 3

_P = ParamSpec("_P")
_T = TypeVar("_T")


def launching(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Make a function hold the launch lock while it runs. Other threads wait for the lock.

    Without the lock, launches of one thread would join the capture of another thread or go to its stream.
    """

    @refuses_old_names
    @functools.wraps(function)
    def locked(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        with _LAUNCH_LOCK:
            return function(*args, **kwargs)

    return locked


class ObjectLock:
    """The lock of one object and the launch lock, taken together.

    If another thread is using the object, a thread gets an error and does not wait. The order of the two threads' calls
    would otherwise be a matter of chance.

    Args:
        what: Name of the object in messages.
    """

    def __init__(self, what: str) -> None:
        self.what = what
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise BusyError(
                f"{self.what}: another thread is using it now, so the order of the calls would be a "
                "matter of chance. Call it from one thread at a time, or give each thread a separate object."
            )
        _LAUNCH_LOCK.acquire()

    def __exit__(self, *_: object) -> None:
        _LAUNCH_LOCK.release()
        self._lock.release()


def exclusive(method: Callable[Concatenate[Any, _P], _T]) -> Callable[Concatenate[Any, _P], _T]:
    """Make a method hold the `lock` of its object while it runs.

    Raises:
        BusyError: Another thread holds the lock.
    """

    @refuses_old_names
    @functools.wraps(method)
    def locked(self: Any, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        with self.lock:
            return method(self, *args, **kwargs)

    return locked


def repeats_in_graphs(device: wp.Device) -> bool:
    """Return whether a graph on this device can loop and branch. A GPU needs a driver for CUDA 12.4 or newer."""
    return not device.is_cuda or wp.is_conditional_graph_supported()


def repeat_launches(left: wp.array, launches: Callable[[], None], most: int) -> None:
    """Repeat launches until `left` is 0. If the device captures a graph that cannot loop, repeat them `most` times.

    Args:
        left: Array of one element. The launches finally set it to 0.
        launches: Function that makes the launches, as in `LaunchSequence`.
        most: Number of repetitions in the worst case.
    """
    device = left.device
    if device.is_capturing and not repeats_in_graphs(device):
        for _ in range(most):
            launches()
    else:
        wp.capture_while(left, launches)


def launch_if(needed: wp.array, launches: Callable[[], None]) -> None:
    """Make launches unless `needed`, an array of one element, is 0. A graph that cannot branch makes them always."""
    if needed.device.is_capturing and not repeats_in_graphs(needed.device):
        launches()
    else:
        wp.capture_if(needed, launches)


@functools.cache
def _side_stream(device: str, priority: int) -> wp.Stream:
    return wp.Stream(device, priority=priority)


def launch_beside(first: Callable[[], None], second: Callable[[], None], device: wp.Device) -> None:
    """Make two groups of launches that do not wait for each other: in a graph of a GPU, they run at the same time.

    Everywhere else, `first` runs before `second`. Both may write an array only if the result does not depend on the
    order.
    """
    if not device.is_cuda or not device.is_capturing:
        first()
        second()
        return
    stream = device.stream
    side = _side_stream(device.alias, stream.priority)
    with wp.ScopedStream(side):
        first()
    second()
    stream.wait_stream(side)


def _capture(launches: Callable[[], None], device: wp.Device, priority: int = 0) -> wp.Graph | None:
    # on a new stream: CUDA cannot capture the null stream, which is torch's current stream by default
    stream = wp.Stream(device, priority=priority) if device.is_cuda else None
    with wp.ScopedDevice(device), wp.ScopedStream(stream), wp.ScopedCapture(device) as capture:
        launches()
    return capture.graph


def compile_missing(launches: Callable[[], None], device: wp.Device) -> bool:
    """Compile all kernels of these launches that Warp's cache lacks, without a launch.

    Args:
        launches: Function that makes the launches, as in `LaunchSequence`.
        device: The device. It must not be capturing.

    Returns:
        True, so that `on_missing` continues with the launch.
    """
    missing: dict[ModuleVariant, None] = {}
    with on_missing(lambda variant: missing.setdefault(variant)):
        _capture(launches, device)
    if missing:
        load_modules(missing, device)
    return True


class LaunchSequence:
    """A fixed sequence of kernel launches, captured into a graph at the first replay, or on a CPU at the fourth.

    Captured and direct launches run the same kernels on the same arrays, so they give the same bits. If the device is
    already capturing, the launches go into that capture. A sequence works on CPU and CUDA devices.

    Args:
        launches: Function without arguments that makes the launches. It must not synchronise with the host, and the
            arrays that it reads and writes must never be reallocated.
        device: The device of these arrays.
        graph: Whether to capture a graph and replay it. If false, `replay` launches directly.
        priority: Priority of the kernels in the graph on a GPU. Kernels with -1 run before kernels of other streams.
            The priority of the stream that replays a graph has no effect.

    Attributes:
        ahead: Launches that include `launches`, which is the default. If Warp's cache lacks a kernel of the sequence,
            the first replay compiles all missing kernels of `ahead` together.
    """

    def __init__(
        self, launches: Callable[[], None], device: wp.Device, *, graph: bool = True, priority: int = 0
    ) -> None:
        self.launches, self.device, self.graph, self.priority = launches, device, graph, priority
        self.ahead = launches
        self._captured: wp.Graph | None = None
        self._direct = 0 if device.is_cuda else _DIRECT_ON_CPU  # replays that are still to be launched directly

    def replay(self) -> None:
        """Run the launches on the device's current stream."""
        if not self.graph or self.device.is_capturing:
            with wp.ScopedDevice(self.device):
                self.launches()
        elif self._direct > 0:
            self._direct -= 1
            with wp.ScopedDevice(self.device), on_missing(lambda _: compile_missing(self.ahead, self.device)):
                self.launches()
        else:
            if self._captured is None:
                self._captured = self._record()
            wp.capture_launch(self._captured)

    def _record(self) -> wp.Graph:
        missing: list[ModuleVariant] = []
        with on_missing(missing.append):
            graph = _capture(self.launches, self.device, self.priority)
        if missing:  # the graph lacks their launches
            compile_missing(self.ahead, self.device)
            graph = _capture(self.launches, self.device, self.priority)
        if graph is None:
            raise RuntimeError(f"Capturing {self.launches} on {self.device} returned no graph. Pass graph=False.")
        return graph
