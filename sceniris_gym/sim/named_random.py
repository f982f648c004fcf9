"""Random numbers drawn by name, a pure function of seed, episode, split and name."""

import hashlib

import warp as wp

from sceniris_gym.device.random import NAMED_STREAM, SPLITS, STREAM_BITS, uniforms

wp.set_module_options({"enable_backward": False})


def named_stream(split: str) -> int:
    """Return the Philox stream of numbers that are drawn by name in a split."""
    return NAMED_STREAM + (SPLITS[split] << STREAM_BITS)


def name_hash(name: str) -> int:
    """Return the 31 bits that stand for a name."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little") >> 1


@wp.kernel
def _draw_named(
    # In:
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    stream: wp.uint32,
    name: int,
    # Out:
    values_out: wp.array2d[float],
):
    worldid, quadid = wp.tid()
    u = uniforms(seed[worldid], episode[worldid], stream, name, quadid)
    for i in range(4):
        column = 4 * quadid + i
        if column < values_out.shape[1]:
            values_out[worldid, column] = u[i]


def draw_named(seed: wp.array, episode: wp.array, split: str, name: str, values_out: wp.array) -> None:
    """Fill `values_out` (nworld, n) with uniform numbers in [0, 1).

    Args:
        seed: Seed of each world, shape (nworld,), uint64.
        episode: Episode of each world, shape (nworld,), int32.
        split: "train" or "eval".
        name: The purpose of the numbers: two names have independent ones.
        values_out: Array to fill, shape (nworld, n), float32.
    """
    dim = values_out.shape[0], (values_out.shape[1] + 3) // 4
    inputs = [seed, episode, wp.uint32(named_stream(split)), name_hash(name)]
    wp.launch(_draw_named, dim=dim, inputs=inputs, outputs=[values_out], device=values_out.device)
