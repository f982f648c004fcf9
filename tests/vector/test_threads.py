"""Environments in threads: two side by side, and one that two threads reach for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch

from sceniris_gym.errors import BusyError
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.stepping import actions

MakeEnv = Callable[..., SceneVectorEnv]


def test_environments_of_two_threads_are_as_they_are_alone(make_env: MakeEnv):
    """Also where both are captured at the same moment, in their first resets and steps."""

    def run(envs: SceneVectorEnv, start: threading.Barrier | None) -> torch.Tensor:
        if start is not None:
            start.wait(30)
        envs.reset(seed=5)
        for _ in range(4):
            observation, *_ = envs.step(actions(3))
        return observation["critic"]

    expected = run(make_env(), None)
    start = threading.Barrier(2)
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda envs: run(envs, start), [make_env(), make_env()]))
    assert all(torch.equal(one, expected) for one in found)


def test_stepping_one_environment_from_four_threads_is_an_error(make_env: MakeEnv):
    """It crashed the process; now the calls that overlap raise, and those that succeed do what they do alone."""
    envs = make_env()
    envs.reset(seed=0)
    start = threading.Barrier(4)

    def run(_: int) -> tuple[int, int]:
        start.wait(30)
        stepped = busy = 0
        for _ in range(20):
            try:
                envs.step(actions(3))
                stepped += 1
            except BusyError:
                busy += 1
        return stepped, busy

    with ThreadPoolExecutor(4) as pool:
        counts = list(pool.map(run, range(4)))
    stepped, busy = (sum(each) for each in zip(*counts, strict=True))
    assert stepped + busy == 80
    assert busy > 0
    assert stepped > 0
    alone = make_env()
    alone.reset(seed=0)
    for _ in range(stepped):
        alone.step(actions(3))
    assert torch.equal(envs.state.qpos("arm"), alone.state.qpos("arm"))


def test_a_thread_may_take_over_an_environment(make_env: MakeEnv):
    """One after the other is no error."""
    envs = make_env()
    with ThreadPoolExecutor(1) as pool:
        pool.submit(envs.reset, seed=0).result()
    envs.step(actions(3))
    with pytest.raises(BusyError, match="SceneVectorEnv: another thread"), envs.lock, ThreadPoolExecutor(1) as pool:
        pool.submit(envs.render).result()
