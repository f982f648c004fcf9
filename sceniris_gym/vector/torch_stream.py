"""Launches of Warp on the stream of torch."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from functools import cache

import torch
import warp as wp


def on_torch_stream(device: wp.Device) -> AbstractContextManager:
    """Run Warp's launches on a device on torch's current stream, in order with torch's own."""
    if not device.is_cuda:
        return nullcontext()
    stream = torch.cuda.current_stream(wp.device_to_torch(device))
    # Warp knows a capture by its Stream object, so a caller's capture on this stream needs the same object
    if device.stream.cuda_stream == stream.cuda_stream:
        return nullcontext()
    return wp.ScopedStream(_as_warp_stream(stream), sync_enter=False)


@cache
def _as_warp_stream(stream: torch.cuda.Stream) -> wp.Stream:
    """Return a stream of torch, which keeps those of its pools for ever, as one of Warp."""
    return wp.stream_from_torch(stream)
