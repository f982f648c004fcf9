"""Timing of steps: waiting for the device, a step as one CUDA graph, and the median and range of several figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
import warp as wp

from sceniris_gym.vector.vector_env import SceneVectorEnv


def wait(envs: SceneVectorEnv) -> None:
    """Wait until the device is idle."""
    if envs.device.type == "cuda":
        torch.cuda.synchronize(envs.device)


def spread(values: Sequence[float] | np.ndarray, digits: int = 4) -> dict[str, float]:
    """Return median, least and greatest."""
    found = {"median": np.median(values), "min": np.min(values), "max": np.max(values)}
    return {name: round(float(value), digits) for name, value in found.items()}


def captured(work: Callable[[], object]) -> Callable[[], None]:
    """Record what torch and Warp launch in `work` into one CUDA graph, and return what replays it."""
    stream, graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()
    torch.cuda.synchronize()
    with torch.cuda.graph(graph, stream=stream):
        warp_stream = wp.stream_from_torch(torch.cuda.current_stream())
        with wp.ScopedStream(warp_stream, sync_enter=False), wp.ScopedCapture(stream=warp_stream, external=True):
            work()
    return graph.replay
