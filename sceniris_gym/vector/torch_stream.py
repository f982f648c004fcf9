"""Warp launches on torch's stream."""

from contextlib import AbstractContextManager, nullcontext
from functools import cache

import torch
import warp as wp

_as_warp_stream = cache(wp.stream_from_torch)  # torch never frees the streams of its pools


def on_torch_stream(device: wp.Device) -> AbstractContextManager:
    """Return a context in which Warp launches on torch's current stream of a device, in order with torch's launches."""
    if not device.is_cuda:
        return nullcontext()
    stream = torch.cuda.current_stream(wp.device_to_torch(device))
    # Warp finds a capture by its Stream object, so keep the object: the caller may be capturing on this stream
    if device.stream.cuda_stream == stream.cuda_stream:
        return nullcontext()
    return wp.ScopedStream(_as_warp_stream(stream), sync_enter=False)
