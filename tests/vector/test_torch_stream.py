"""Launches of Warp and torch on one stream."""

from __future__ import annotations

import pytest
import torch
import warp as wp

from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach

pytestmark = pytest.mark.cuda


def test_a_whole_step_can_be_captured_with_torch(cuda_scene):
    """Task, physics, autoreset and layouts replay as one CUDA graph, and episodes advance in it."""
    envs = SceneVectorEnv(Reach, 4, scene=cuda_scene, max_episode_steps=3)
    envs.reset(seed=0)
    action = torch.zeros(4, 5, device="cuda")
    for _ in range(3):  # compiles and loads all that the capture needs
        envs.step(action)
    stream, graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()
    torch.cuda.synchronize()
    with torch.cuda.graph(graph, stream=stream):
        warp_stream = wp.stream_from_torch(torch.cuda.current_stream())
        with wp.ScopedStream(warp_stream, sync_enter=False), wp.ScopedCapture(stream=warp_stream, external=True):
            observation, _, _, truncated, info = envs.step(action)
    counts = []
    for _ in range(6):
        graph.replay()
        counts.append((truncated.tolist(), info["layout"]["episode"].tolist()))
    assert [flags for flags, _ in counts] == [[False] * 4, [False] * 4, [True] * 4] * 2
    assert [episodes for _, episodes in counts] == [[1] * 4, [1] * 4, [2] * 4, [2] * 4, [2] * 4, [3] * 4]
    assert torch.isfinite(observation["critic"]).all()
