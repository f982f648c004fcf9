"""Random numbers for tasks, from Philox streams that no layout uses."""

import warp as wp

from sceniris_gym.device.random import SPLITS, STREAM_BITS, TASK_STREAM, uniforms
from sceniris_gym.errors import ArgumentError

wp.set_module_options({"enable_backward": False})


def task_stream(split: str, stream: int) -> int:
    """Return the Philox stream of a task's own `stream`, 0 to 2^24 - 1, in a split."""
    if not 0 <= stream < 1 << STREAM_BITS:
        raise ArgumentError(f"stream should be from 0 to {(1 << STREAM_BITS) - 1}, got {stream}.")
    return TASK_STREAM + (SPLITS[split] << STREAM_BITS) + stream


@wp.kernel
def _draw_uniform(
    # In:
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    step: wp.array[int],
    stream: wp.uint32,
    low: float,
    high: float,
    # Out:
    values_out: wp.array2d[float],
):
    worldid, quadid = wp.tid()
    u = uniforms(seed[worldid], episode[worldid], stream, step[worldid], quadid)
    for i in range(4):
        column = 4 * quadid + i
        if column < values_out.shape[1]:
            values_out[worldid, column] = low + (high - low) * u[i]


def draw_uniform(
    seed: wp.array, episode: wp.array, step: wp.array, stream: int, low: float, high: float, values_out: wp.array
) -> None:
    """Fill `values_out` (nworld, n) with uniform numbers in [low, high), a pure function of the other arguments.

    Args:
        seed: Seed of each world, shape (nworld,), uint64.
        episode: Episode of each world, shape (nworld,), int32.
        step: Control steps since the reset, shape (nworld,), int32.
        stream: Philox stream, see task_stream.
        low: Lower bound, inclusive.
        high: Upper bound, exclusive.
        values_out: Array to fill, shape (nworld, n), float32.
    """
    dim = values_out.shape[0], (values_out.shape[1] + 3) // 4
    inputs = [seed, episode, step, wp.uint32(stream), low, high]
    wp.launch(_draw_uniform, dim=dim, inputs=inputs, outputs=[values_out], device=values_out.device)
