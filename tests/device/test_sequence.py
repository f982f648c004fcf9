"""Launches that are recorded once: the same results, however they are run."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from sceniris_gym.device.sequence import (
    LaunchSequence,
    ObjectLock,
    exclusive,
    launch_beside,
    launch_if,
    launching,
    repeat_launches,
)
from sceniris_gym.errors import BusyError
from sceniris_gym.layout.generate import LayoutGenerator
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu

CPU = wp.get_device("cpu")


@wp.kernel(enable_backward=False)
def _collatz(values: wp.array[int]):
    i = wp.tid()
    if values[i] % 2 == 0:
        values[i] = values[i] / 2
    else:
        values[i] = 3 * values[i] + 1


def sequence(values: wp.array, steps: int, graph: bool) -> tuple[LaunchSequence, list[int]]:
    """Return a sequence of a few launches over an array, and a list that grows when Python launches them."""
    ran: list[int] = []

    def launches() -> None:
        ran.append(1)
        for _ in range(steps):
            wp.launch(_collatz, dim=values.shape[0], inputs=[values])

    return LaunchSequence(launches, CPU, graph=graph), ran


def after(start: np.ndarray, steps: int) -> list[int]:
    """Return what Python makes of the numbers."""
    values = start.tolist()
    for _ in range(steps):
        values = [v // 2 if v % 2 == 0 else 3 * v + 1 for v in values]
    return values


@pytest.mark.parametrize("graph", [True, False])
def test_every_call_runs_all_launches_once(graph: bool):
    """Recorded or not: after each call the numbers are so many steps further, the first one included."""
    start = np.arange(1, 40)
    values = wp.array(start, dtype=int, device="cpu")
    sequence(wp.zeros(1, dtype=int, device="cpu"), 1, graph)[0].replay()  # compiles the kernel, by further calls
    run, ran = sequence(values, 3, graph)
    for call in range(1, 8):
        run.replay()
        assert values.numpy().tolist() == after(start, 3 * call)
    assert len(ran) == (4 if graph else 7)  # a CPU launches directly at first, and then records


@pytest.mark.usefixtures("recorded")
def test_a_replay_works_on_what_the_arrays_hold_now():
    """Not on what they held when it was recorded."""
    values = wp.array([7, 7], dtype=int, device="cpu")
    run, _ = sequence(values, 1, graph=True)
    run.replay()
    values.assign(np.array([10, 3]))
    run.replay()
    assert values.numpy().tolist() == [5, 10]


def test_inside_of_a_capture_the_launches_are_part_of_it():
    """Of a graph of somebody else's, which then runs them each time."""
    values = wp.array([27], dtype=int, device="cpu")
    run, ran = sequence(values, 2, graph=True)
    with wp.ScopedCapture(device="cpu") as capture:
        run.replay()
    values.assign(np.array([27]))
    for call in range(1, 4):
        wp.capture_launch(capture.graph)
        assert values.numpy().tolist() == after(np.array([27]), 2 * call)
    assert len(ran) == 1


@wp.kernel(enable_backward=False)
def _need(left: wp.array[int], needed_out: wp.array[int]):
    left[0] -= 1
    needed_out[0] = int(left[0] > 2)


@wp.kernel(enable_backward=False)
def _count_down(left: wp.array[int], rounds: wp.array[int]):
    left[0] = left[0] - 1
    rounds[0] = rounds[0] + 1


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("graph", [True, False])
def test_launches_are_repeated_until_nothing_is_left(graph: bool):
    """As often as an array says when they run, also in a replay; not at all for nothing."""
    left, rounds = (wp.zeros(1, dtype=int, device="cpu") for _ in range(2))
    run = LaunchSequence(
        lambda: repeat_launches(left, lambda: wp.launch(_count_down, dim=1, inputs=[left, rounds]), 9), CPU, graph=graph
    )
    for number in (4, 0, 1):
        left.fill_(number)
        rounds.zero_()
        run.replay()
        assert (left.numpy()[0], rounds.numpy()[0]) == (0, number)


@pytest.mark.cuda
def test_on_a_gpu_the_numbers_are_the_same():
    """Though its default stream cannot be captured."""
    device, start = wp.get_device("cuda:0"), np.arange(1, 40)
    values = wp.array(start, dtype=int, device=device)
    run = LaunchSequence(lambda: wp.launch(_collatz, dim=39, inputs=[values]), device)
    for call in range(1, 4):
        run.replay()
        assert values.numpy().tolist() == after(start, call)


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


@wp.kernel(enable_backward=False)
def _add(values: wp.array[int], first: int, by: int):
    values[first + wp.tid()] += by


@wp.kernel(enable_backward=False)
def _sum(values: wp.array[int], left: wp.array[int], total_out: wp.array[int]):
    for i in range(values.shape[0]):
        total_out[0] += values[i]
    left[0] -= 1


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("graph", [False, True])
def test_launches_that_are_not_needed_are_left_out(device: str, graph: bool):
    """In each pass of a loop, whose kernel needs them until 2 passes are left: 3 of 5."""
    left, needed, number = (wp.zeros(1, dtype=int, device=device) for _ in range(3))

    def once() -> None:
        launch_if(needed, lambda: wp.launch(_add, dim=1, inputs=[number, 0, 1], device=device))
        wp.launch(_need, dim=1, inputs=[left], outputs=[needed], device=device)

    launches = LaunchSequence(lambda: repeat_launches(left, once, 5), left.device, graph=graph)
    for _ in range(5):
        for array, value in ((left, 5), (needed, 1), (number, 0)):
            array.fill_(value)
        launches.replay()
        assert number.numpy()[0] == 3


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("graph", [False, True])
def test_launches_after_two_groups_wait_for_both(device: str, graph: bool):
    """Each pass of a loop adds 1 to one half and 2 to the other half, then sums all: 3 n (1 + 2 + 3) after 3 passes."""
    n = 1 << 12
    values, left, total = (wp.zeros(size, dtype=int, device=device) for size in (2 * n, 1, 1))

    def add(first: int, by: int) -> None:
        wp.launch(_add, dim=n, inputs=[values, first, by], device=device)

    def once() -> None:
        launch_beside(lambda: add(0, 1), lambda: add(n, 2), values.device)
        wp.launch(_sum, dim=1, inputs=[values, left], outputs=[total], device=device)

    launches = LaunchSequence(lambda: repeat_launches(left, once, 3), values.device, graph=graph)
    for _ in range(5):
        for array, value in ((values, 0), (total, 0), (left, 3)):
            array.fill_(value)
        launches.replay()
        assert total.numpy()[0] == 3 * n * (1 + 2 + 3)
        assert left.numpy()[0] == 0
