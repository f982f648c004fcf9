"""Launches that are recorded once: the same results, however they are run."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sceniris_gym.device.sequence import LaunchSequence, repeat_launches

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
    run, ran = sequence(values, 3, graph)
    for call in range(1, 6):
        run()
        assert values.numpy().tolist() == after(start, 3 * call)
    assert len(ran) == (1 if graph else 5)


def test_a_replay_works_on_what_the_arrays_hold_now():
    """Not on what they held when it was recorded."""
    values = wp.array([7, 7], dtype=int, device="cpu")
    run, _ = sequence(values, 1, graph=True)
    run()
    values.assign(np.array([10, 3]))
    run()
    assert values.numpy().tolist() == [5, 10]


def test_inside_of_a_capture_the_launches_are_part_of_it():
    """Of a graph of somebody else's, which then runs them each time."""
    values = wp.array([27], dtype=int, device="cpu")
    run, ran = sequence(values, 2, graph=True)
    with wp.ScopedCapture(device="cpu") as capture:
        run()
    values.assign(np.array([27]))
    for call in range(1, 4):
        wp.capture_launch(capture.graph)
        assert values.numpy().tolist() == after(np.array([27]), 2 * call)
    assert len(ran) == 1


@wp.kernel(enable_backward=False)
def _count_down(left: wp.array[int], rounds: wp.array[int]):
    left[0] = left[0] - 1
    rounds[0] = rounds[0] + 1


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
        run()
        assert (left.numpy()[0], rounds.numpy()[0]) == (0, number)


@pytest.mark.cuda
def test_on_a_gpu_the_numbers_are_the_same():
    """Though its default stream cannot be captured."""
    device, start = wp.get_device("cuda:0"), np.arange(1, 40)
    values = wp.array(start, dtype=int, device=device)
    run = LaunchSequence(lambda: wp.launch(_collatz, dim=39, inputs=[values]), device)
    for call in range(1, 4):
        run()
        assert values.numpy().tolist() == after(start, call)
