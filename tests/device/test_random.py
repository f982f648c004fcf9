"""Philox against the known answers of its authors, and the independence of its streams."""

import numpy as np
import pytest
import warp as wp
from scipy import stats

from sceniris_gym.device.random import philox, uniforms

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _philox(seed: wp.uint64, counter: wp.vec4ui, out: wp.array[wp.vec4ui]):
    out[0] = philox(seed, counter)


@wp.kernel
def _uniforms(seed: wp.array[wp.uint64], episode: int, stream: wp.uint32, out: wp.array[wp.vec4]):
    i = wp.tid()
    out[i] = uniforms(seed[i], episode, stream, 0, 0)


# Key, counter, result: the file kat_vectors of the Random123 distribution, philox4x32 with 10 rounds.
KNOWN = [
    ((0, 0), (0, 0, 0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF,) * 4, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0xA4093822, 0x299F31D0),
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.mark.parametrize(("key", "counter", "result"), KNOWN)
def test_philox_gives_the_known_answers(key: tuple, counter: tuple, result: tuple):
    """Bit for bit, for zeros, ones and digits of pi."""
    out = wp.zeros(1, dtype=wp.vec4ui, device="cpu")
    wp.launch(_philox, dim=1, inputs=[key[0] | key[1] << 32, wp.vec4ui(*counter), out], device="cpu")
    assert tuple(int(x) for x in out.numpy()[0]) == result


def _draw(seeds: np.ndarray, episode: int, stream: int) -> np.ndarray:
    out = wp.zeros(len(seeds), dtype=wp.vec4, device="cpu")
    wp.launch(_uniforms, dim=len(seeds), inputs=[wp.array(seeds, device="cpu"), episode, stream, out], device="cpu")
    return out.numpy()


def test_numbers_are_uniform_and_neighbouring_streams_are_independent():
    """Neighbouring seeds, episodes and streams: each uniform by Kolmogorov-Smirnov, no two correlated."""
    seeds = np.arange(20_000, dtype=np.uint64)
    draws = [_draw(seeds, 0, 0), _draw(seeds, 1, 0), _draw(seeds, 0, 1)]
    columns = np.concatenate(draws, axis=1)
    assert columns.min() >= 0.0 and columns.max() < 1.0
    assert all(stats.kstest(c, "uniform").pvalue > 0.001 for c in columns.T)
    off_diagonal = np.corrcoef(columns.T) - np.eye(columns.shape[1])
    assert np.abs(off_diagonal).max() < 5.0 / np.sqrt(len(seeds))


def test_no_two_worlds_share_numbers():
    """A thousand episodes of many worlds: every one of them draws something else."""
    seeds = np.arange(1000, dtype=np.uint64)
    words = np.concatenate([_draw(seeds, episode, 3) for episode in range(50)])
    assert len(np.unique(words, axis=0)) == len(words)
