"""How steps of environments are timed: waiting for the device, and a step as one CUDA graph."""

from __future__ import annotations

from collections.abc import Callable

import torch
import warp as wp
from torch import Tensor

from sceniris_gym.vector.vector_env import SceneVectorEnv


def wait(envs: SceneVectorEnv) -> None:
    """Wait until the device is idle."""
    if envs.device.type == "cuda":
        torch.cuda.synchronize(envs.device)


def captured(envs: SceneVectorEnv, action: Tensor) -> Callable[[], None]:
    """Record a whole step with what is in `action` then, torch and Warp together, into one CUDA graph."""
    stream, graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()
    torch.cuda.synchronize()
    with torch.cuda.graph(graph, stream=stream):
        warp_stream = wp.stream_from_torch(torch.cuda.current_stream())
        with wp.ScopedStream(warp_stream, sync_enter=False), wp.ScopedCapture(stream=warp_stream, external=True):
            envs.step(action)
    return graph.replay
