"""Uniform random numbers for tasks and users: new in each control step, or fixed for an episode, by name."""

import warp as wp

from sceniris_gym.device.random import SPLITS, STREAM_BITS, TASK_STREAM, name_hash, named_stream, uniforms
from sceniris_gym.errors import check_type
from sceniris_gym.layout.masks import as_count

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def task_stream(split: str, stream: int) -> int:
    """Return the Philox stream from which a task draws in a split. The task chooses `stream`, a number below 2^24."""
    as_count(stream, "stream", 0, (1 << STREAM_BITS) - 1)
    return TASK_STREAM + (SPLITS[split] << STREAM_BITS) + stream


@wp.kernel
def _draw_uniform(
    # In:
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    steps: wp.array[int],
    name: int,
    stream: wp.uint32,
    low: float,
    high: float,
    # Out:
    values_out: wp.array2d[float],
):
    worldid, quadid = wp.tid()
    trial = name
    if steps:
        trial = steps[worldid]
    u = uniforms(seed[worldid], episode[worldid], stream, trial, quadid)
    for i in range(4):
        column = 4 * quadid + i
        if column < values_out.shape[1]:
            values_out[worldid, column] = low + (high - low) * u[i]


def draw_uniform(
    seed: wp.array, episode: wp.array, trial: wp.array | int, stream: int, low: float, high: float, values_out: wp.array
) -> None:
    """Fill `values_out` (nworld, n) with uniform numbers in [low, high).

    The numbers depend only on the other arguments.

    Args:
        seed: Seed of each world, shape (nworld,), uint64.
        episode: Episode of each world, shape (nworld,), int32.
        trial: Distinguishes the draws of an episode: the control steps of each world since its reset, shape (nworld,),
            int32, or one integer for all worlds, such as the hash of a name.
        stream: Philox stream, see `task_stream` and `named_stream`.
        low: Lower bound, inclusive.
        high: Upper bound, exclusive.
        values_out: Array to fill, shape (nworld, n), float32.
    """
    dim = values_out.shape[0], (values_out.shape[1] + 3) // 4
    trials = (trial, 0) if isinstance(trial, wp.array) else (None, trial)
    inputs = [seed, episode, *trials, wp.uint32(stream), low, high]
    wp.launch(_draw_uniform, dim=dim, inputs=inputs, outputs=[values_out], device=values_out.device)


def draw_named(seed: wp.array, episode: wp.array, split: str, name: str, values_out: wp.array) -> None:
    """Fill `values_out` with uniform numbers in [0, 1), determined by the other arguments. See `draw_uniform`."""
    check_type(name, str, "random: name")
    draw_uniform(seed, episode, name_hash(name), named_stream(split), 0.0, 1.0, values_out)
