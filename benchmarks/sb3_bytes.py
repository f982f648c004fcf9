"""Bytes that Sb3VecEnvWrapper copies to the host per step, for different numbers of worlds.

Prints a line of JSON for each number: `bytes_per_step` and `bytes_per_world` (means over the steps), `finished_share`
(share of worlds that finish in a step), `env_ms` and `adapter_ms` (medians of the whole step and of the overhead of the
adapter). Episodes are staggered, so that about the same share of the worlds finishes in each step.

    python -m benchmarks.sb3_bytes --device cuda:0
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium as gym
import numpy as np
import torch
import tyro

import sceniris_gym  # noqa: F401, the import registers the environments
from sceniris_gym.adapters.sb3 import Sb3VecEnvWrapper
from sceniris_gym.vector.vector_env import SceneVectorEnv


@contextmanager
def counted_bytes() -> Iterator[list[int]]:
    """Yield a list to which every tensor copied to the host adds its bytes."""
    found: list[int] = []
    original = torch.Tensor.cpu

    def cpu(tensor: torch.Tensor, *args: Any, **kwargs: Any) -> torch.Tensor:
        found.append(tensor.numel() * tensor.element_size())
        return original(tensor, *args, **kwargs)

    torch.Tensor.cpu = cpu
    try:
        yield found
    finally:
        torch.Tensor.cpu = original


def timed(work: Callable[[], Any], device: torch.device) -> tuple[float, Any]:
    """Return how long the work takes [s], with the device idle before and after, and its result."""
    if device.type == "cuda":
        torch.cuda.synchronize()
    start = time.perf_counter()
    result = work()
    if device.type == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() - start, result


def measure(env_id: str, num_envs: int, steps: int, episode: int, device: str | None) -> dict[str, Any]:
    """Step `num_envs` worlds and return the figures of one line."""
    inner = gym.make_vec(env_id, num_envs=num_envs, device=device, max_episode_steps=episode)
    assert isinstance(inner, SceneVectorEnv)
    envs = Sb3VecEnvWrapper(inner)
    envs.seed(0)
    envs.reset()
    inner.state.elapsed.copy_(torch.arange(num_envs) % episode)
    action = np.zeros((num_envs, *envs.action_space.shape), np.float32)  # pyrefly: ignore[not-iterable]
    envs.step(action)  # the first one loads kernels
    bare = sorted(timed(lambda: inner.step(action), inner.device)[0] for _ in range(steps))
    seconds, finished, copied = [], 0, 0
    for _ in range(steps):
        with counted_bytes() as found:
            spent, (_, _, done, _) = timed(lambda: envs.step(action), inner.device)
        seconds.append(spent)
        finished += int(done.sum())
        copied += sum(found)
    envs.close()
    whole = sorted(seconds)[steps // 2]
    return {
        "env": env_id,
        "num_envs": num_envs,
        "device": str(inner.device),
        "bytes_per_step": copied / steps,
        "bytes_per_world": copied / steps / num_envs,
        "finished_share": finished / steps / num_envs,
        "env_ms": 1e3 * whole,
        "adapter_ms": 1e3 * (whole - bare[steps // 2]),
    }


def main(
    num_envs: tuple[int, ...] = (64, 256, 1024, 4096),
    env_id: str = "sceniris_gym/TabletopReach-v0",
    steps: int = 20,
    episode: int = 10,
    device: str | None = None,
) -> None:
    """Print a line for each number of worlds.

    Args:
        num_envs: numbers of worlds.
        env_id: the environment.
        steps: control steps that are measured.
        episode: control steps of an episode; in each step one in this many worlds finishes.
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one, else cpu.
    """
    for count in num_envs:
        print(json.dumps(measure(env_id, count, steps, episode, device)), flush=True)


if __name__ == "__main__":
    tyro.cli(main)
