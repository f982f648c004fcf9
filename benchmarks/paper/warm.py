"""Rate of a warm generator, and the parts that its time goes to."""

from __future__ import annotations

import importlib
import re
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import warp as wp

from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene

_KINDS = {
    "wave.draw": "draw",
    "wave.ahead": "draw",
    "wave.points": "regions",
    "wave.sides": "regions",
    "wave.region_pieces": "regions",
    "wave.prefilter": "prefilter",
    "wave.collision": "collision",
    "wave.standing": "standing",
    "wave.accept": "accept",
    "wave.rounds": "rows and rounds",
    "wave.settle": "rows and rounds",
    "seeds": "rows and rounds",
    "write_columns": "rows and rounds",
}
"""The kind of work that the kernels of a file of layout/ do."""

_HASH = re.compile("_[0-9a-f]{8}$")  # at the end of a kernel's name on a GPU


@dataclass(frozen=True)
class Warm:
    """Layouts of one batch, made again and again.

    Attributes:
        seconds: Median time of a batch [s].
        valid: Share of layouts that are fresh and valid.
        candidates: Candidates for a layout.
        ns_per_candidate: Time for each of them [ns].
    """

    seconds: float
    valid: float
    candidates: float
    ns_per_candidate: float


def warm(compiled: CompiledScene, worlds: int, rounds: int) -> Warm:
    """Measure batches of layouts: one to warm up, then `rounds` of which the median counts."""
    generator = LayoutGenerator(compiled, worlds)
    generator.generate()
    times, valid, attempts = [], 0, 0
    for _ in range(rounds):
        wp.synchronize_device(compiled.device)
        start = time.perf_counter()
        generator.generate()
        wp.synchronize_device(compiled.device)
        times.append(time.perf_counter() - start)
        valid += int((generator.layouts.status.cpu().numpy() == LayoutStatus.VALID).sum())
        attempts += int(generator.layouts.attempts.cpu().numpy().sum(dtype=np.int64))
    seconds, made = statistics.median(times), rounds * worlds
    return Warm(seconds, valid / made, attempts / made, 1e9 * seconds * rounds / attempts)


def shares(compiled: CompiledScene, worlds: int) -> dict[str, float]:
    """Return the share of a batch's time that each kind of kernel takes, the largest first.

    Kernels are launched one by one rather than from a graph. On a GPU the device times them; on a CPU, where a launch
    returns when its kernel is done, the clock around it does. Scenes whose tier of reach has a stage of its own are not
    told apart so.
    """
    generator = LayoutGenerator(compiled, worlds)
    make = LaunchSequence(lambda: generator.launch_generate(None), wp.get_device(compiled.device), graph=False)
    make.replay()  # loads the kernels
    kinds = _kinds_of_kernels()
    times: Counter[str] = Counter()

    def add(kernel: str, seconds: float) -> None:
        times[kinds.get(_key(kernel), "other")] += seconds  # pyrefly: ignore[unsupported-operation]

    if wp.get_device(compiled.device).is_cuda:
        wp.timing_begin(cuda_filter=wp.TIMING_KERNEL)
        make.replay()
        for result in wp.timing_end():
            add(result.name, result.elapsed)
    else:
        with _timed_launches(add):
            make.replay()
    whole = sum(times.values())
    return {kind: seconds / whole for kind, seconds in times.most_common()}


def _key(activity: str) -> str:
    """Return the key of a kernel, which a GPU's timing tells with a hash."""
    return _HASH.sub("", activity.removeprefix("forward kernel "))


def _kinds_of_kernels() -> dict[str, str]:
    """Return the kind of work of each kernel of a search, by its key."""
    found: dict[str, str] = {}
    for name, kind in _KINDS.items():
        module = importlib.import_module(f"sceniris_gym.layout.{name}")
        kernels = [member for member in vars(module).values() if isinstance(member, wp.Kernel)]
        found |= {kernel.key: kind for kernel in kernels if kernel.func.__module__ == module.__name__}
    return found | {"_test_containment": "containment"}  # next to the collision tests


@contextmanager
def _timed_launches(add: Callable[[str, float], None]) -> Iterator[None]:
    """Tell `add` the key of every kernel that is launched meanwhile, and how long that took [s]."""

    def timed(launch: Callable) -> Callable:
        def work(kernel: wp.Kernel, *arguments, **words) -> None:
            start = time.perf_counter()
            launch(kernel, *arguments, **words)
            add(kernel.key, time.perf_counter() - start)

        return work

    kept = {name: getattr(wp, name) for name in ("launch", "launch_tiled")}
    for name, launch in kept.items():
        setattr(wp, name, timed(launch))
    try:
        yield
    finally:
        for name, launch in kept.items():
            setattr(wp, name, launch)
