"""Philox4x32-10: random numbers as a pure function of a key and a counter.

J. Salmon, M. Moraes, R. Dror, D. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011. The key is the 64-bit
seed of a world. The counter is (episode, stream, trial, draw): each use of numbers has a stream, for example the
placement of one object, each attempt is a trial, and each call in an attempt is a draw. A layout therefore does not
depend on the other worlds that are reset, on their order, or on the number of lanes that share the work.
"""

import hashlib

import warp as wp

from sceniris_gym.device.transforms import log_of, unit_circle

# Streams of one seed and episode. The placement of an object uses stream split * 2^24 + object. Streams of tasks have
# the top bit set, so that goals and noise never repeat the numbers behind the poses.
SPLITS = {"train": 0, "eval": 1, "train_bank": 2, "eval_bank": 3}  # only compile_scene draws from the bank splits
STREAM_BITS = 24
BANK_BIT = SPLITS["train_bank"] << STREAM_BITS  # set only in the streams of banks
TASK_STREAM = 1 << 31
NAMED_STREAM = 1 << 30  # numbers drawn by name, with the name as their trial
BANK_STREAM = (1 << STREAM_BITS) - 1
GROUP_STREAM = (1 << STREAM_BITS) - 2
REACH_STREAM = (1 << STREAM_BITS) - 3
START_STREAM = (1 << STREAM_BITS) - 4
PATH_STREAM = (1 << STREAM_BITS) - 6
REDRAW_STREAM = (1 << STREAM_BITS) - 5  # with the number of the redraw as trial, it seeds all draws of that redraw

_M0 = wp.constant(wp.uint32(0xD2511F53))
_M1 = wp.constant(wp.uint32(0xCD9E8D57))
_W0 = wp.constant(wp.uint32(0x9E3779B9))
_W1 = wp.constant(wp.uint32(0xBB67AE85))


@wp.func
def _mulhi(a: wp.uint32, b: wp.uint32) -> wp.uint32:
    """Return the upper 32 bits of a product."""
    return wp.uint32((wp.uint64(a) * wp.uint64(b)) >> wp.uint64(32))


@wp.func
def philox(seed: wp.uint64, counter: wp.vec4ui) -> wp.vec4ui:
    """Return Philox4x32-10 of `counter` under the key `seed` (low word first)."""
    k0 = wp.uint32(seed & wp.uint64(0xFFFFFFFF))
    k1 = wp.uint32(seed >> wp.uint64(32))
    c0 = counter[0]
    c1 = counter[1]
    c2 = counter[2]
    c3 = counter[3]
    for _round in range(10):
        hi0 = _mulhi(_M0, c0)
        hi1 = _mulhi(_M1, c2)
        lo0 = _M0 * c0
        lo1 = _M1 * c2
        c0 = hi1 ^ c1 ^ k0
        c1 = lo1
        c2 = hi0 ^ c3 ^ k1
        c3 = lo0
        k0 = k0 + _W0
        k1 = k1 + _W1
    return wp.vec4ui(c0, c1, c2, c3)


@wp.func
def uniform(word: wp.uint32) -> float:
    """Return a float in [0, 1) from the upper 24 bits of `word`, exact in float32."""
    return float(word >> wp.uint32(8)) * 5.9604644775390625e-08


@wp.func
def uniforms(seed: wp.uint64, episode: int, stream: wp.uint32, trial: int, draw: int) -> wp.vec4:
    """Return four independent uniform numbers in [0, 1) for one draw of one trial."""
    words = philox(seed, wp.vec4ui(wp.uint32(episode), stream, wp.uint32(trial), wp.uint32(draw)))
    return wp.vec4(uniform(words[0]), uniform(words[1]), uniform(words[2]), uniform(words[3]))


@wp.func(inline=False)
def normals(u: float, v: float) -> wp.vec2:
    """Return two independent normal numbers from two uniform numbers in [0, 1).

    G. Box, M. Muller, "A note on the generation of random normal deviates", Ann. Math. Statist. 29, 1958.
    """
    return wp.sqrt(-2.0 * log_of(1.0 - u)) * unit_circle(2.0 * wp.pi * v)


def named_stream(split: str) -> int:
    """Return the Philox stream of a split for draws that are keyed by a name."""
    return NAMED_STREAM + (SPLITS[split] << STREAM_BITS)


def name_hash(name: str) -> int:
    """Return a hash of a name, with 31 bits."""
    return int.from_bytes(hashlib.sha256(name.encode("utf-8", "surrogatepass")).digest()[:4], "little") >> 1
