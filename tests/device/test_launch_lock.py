"""Threads: what is launched in one is not captured by another, and an object is used by one at a time."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.device.launch_lock import ObjectLock, exclusive, launching
from sceniris_gym.errors import BusyError
from sceniris_gym.layout.generate import LayoutGenerator
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu


class _Thing:
    def __init__(self) -> None:
        self.lock = ObjectLock("Thing")

    @exclusive
    def hold(self, held: threading.Event, done: threading.Event) -> None:
        held.set()
        done.wait(10)

    @exclusive
    def touch(self) -> int:
        return self.deeper()

    @exclusive
    def deeper(self) -> int:
        return 7


def test_two_threads_cannot_use_one_object():
    """The second gets an error that names it; afterwards, and from within, it is free."""
    thing, held, done = _Thing(), threading.Event(), threading.Event()
    with ThreadPoolExecutor() as pool:
        first = pool.submit(thing.hold, held, done)
        held.wait(10)
        with pytest.raises(BusyError, match="Thing: another thread"):
            thing.touch()
        done.set()
        first.result()
    assert thing.touch() == 7


def test_functions_that_launch_wait_for_each_other():
    """Never two at once, and never a deadlock of one with itself."""
    inside = [0, 0]

    @launching
    def launch(deeper: bool) -> None:
        if deeper:
            launch(False)
            return
        inside[0] += 1
        inside[1] = max(inside)
        time.sleep(0.005)
        inside[0] -= 1

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(launch, [True, False] * 8))
    assert inside == [0, 1]


def test_generators_of_two_threads_are_captured_apart(tmp_path: Path):
    """Their first calls come at once, and each has the layouts that it has alone."""
    cube = box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    scene = {"floor": FLOOR, "objects": {name: {"asset": cube, "on": "floor"} for name in ("a", "b", "c")}}
    compiled = compile_on_cpu(scene, bank=2)
    start = threading.Barrier(4)

    def made(number: int, *, wait: bool) -> np.ndarray:
        generator = LayoutGenerator(compiled, 64, seed=1000 * number)
        if wait:
            start.wait(10)
        for _ in range(5):
            generator.generate()
        return generator.layouts.qpos.numpy()

    alone = [made(number, wait=False) for number in range(4)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda number: made(number, wait=True), range(4)))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)
