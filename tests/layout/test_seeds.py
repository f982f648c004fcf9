"""Seeds of worlds: integers of any kind are taken with all their bits, and everything else is refused by name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.seeds import as_seeds
from tests.layout.scenes import compile_on_cpu


def test_seeds_wrap_around():
    """Seed + i is taken modulo 2^64."""
    generator = LayoutGenerator(compile_on_cpu({"objects": {}}), 3, seed=(1 << 64) - 2)
    assert generator.layouts.seed.numpy().tolist() == [-2, -1, 0]  # two's complement


@pytest.mark.parametrize(
    "seed",
    [-1, 1 << 64, True, np.True_, 1.0, np.float64(2), None, "12", [1, 2], [1, 2, 3, 4], [1, 2, -3], [1, 2, 1 << 64]]
    + [[1, 2, True], [1, 2, 3.0], np.array([1.0, 2.0, 3.0]), np.array([True] * 3), np.array(5), np.ones((3, 1), int)]
    + [{1, 2, 3}, ["1", "2", "3"], "abc"],
    ids=str,
)
def test_a_wrong_seed_is_refused(seed):
    """Negative, too large, no integer, or not one for each world: in the constructor and in `reseed`."""
    compiled = compile_on_cpu({"objects": {}})
    with pytest.raises(ArgumentError, match="seed"):
        LayoutGenerator(compiled, 3, seed=seed)
    generator = LayoutGenerator(compiled, 3, seed=8)
    with pytest.raises(ArgumentError, match="seed"):
        generator.reseed(seed=seed)
    assert generator.layouts.seed.numpy().tolist() == [8, 9, 10]


def test_after_the_last_episode_comes_the_first():
    """So that every layout has an id, and its bits; more episodes than a seed has are refused."""
    generator = LayoutGenerator(compile_on_cpu({"objects": {}}), 2, seed=5)
    generator.reseed(layouts={"seed": [5, 6], "episode": 2**31 - 2})
    found = []
    for _ in range(2):
        generator.generate()
        found += generator.layouts.ids("train")[:1]
    assert [name.split(":")[2:] for name in found] == [["5", str(2**31 - 2)], ["5", "0"]]
    with pytest.raises(ArgumentError, match=r"from 0 to 2\^31 - 2, got 2147483647"):
        generator.reseed(layouts={"seed": 5, "episode": 2**31 - 1})


@pytest.mark.parametrize(
    "given",
    [
        40,
        np.uint8(40),
        np.int64(40),
        [40, 41, 42],
        (40, 41, 42),
        range(40, 43),
        [np.int32(40), 41, np.uint64(42)],
        *(np.array([40, 41, 42], dtype) for dtype in (np.uint8, np.int16, np.int32, ">i8", np.uint64, object)),
        np.array([40, 0, 41, 0, 42])[::2],
    ],
    ids=repr,
)
def test_seeds_may_be_integers_of_any_kind(given):
    """One that counts up, or one for each world: in any sequence or array, also one that is strided."""
    found = as_seeds(given, 3)
    assert (found.dtype, found.tolist()) == (np.uint64, [40, 41, 42])


@pytest.mark.parametrize("make", [list, tuple, lambda seeds: np.array(seeds, object), lambda s: np.array(s, np.uint64)])
def test_large_seeds_keep_all_their_bits(make):
    """Beside small ones too: NumPy by itself would make floating-point numbers of such a list."""
    seeds = [2**63 - 1, 2**63, 2**64 - 1, 0, 2**53 + 1]
    assert as_seeds(make(seeds), 5).tolist() == seeds
    mixed: list[Any] = [np.int64(3), np.uint64(2**64 - 1), 2**63 + 1]
    assert as_seeds(mixed, 3).tolist() == [3, 2**64 - 1, 2**63 + 1]
    assert as_seeds(make([2**64 - 1])[0], 3).tolist() == [2**64 - 1, 0, 1]


WRONG = [-1, 2**64, -(2**70), True, np.True_, np.int8(-5), 1.0, np.float64(2), np.nan, None, "3", 1j, [1], np.array(1)]


@pytest.mark.parametrize("wrong", WRONG, ids=repr)
@pytest.mark.parametrize("place", [0, 2])
def test_the_first_wrong_seed_of_many_is_named(wrong, place: int):
    """By its index, in lists, tuples and arrays of objects, beside seeds of all sizes."""
    seeds = [7, 2**63, 2**64 - 1, None]  # the last one is wrong in any case
    seeds[place] = wrong
    objects = np.empty(4, object)
    objects[:] = seeds
    for given in (seeds, tuple(seeds), objects):
        with pytest.raises(ArgumentError, match=rf"seed\[{place}\]=.* should be an integer from 0 to 2\^64 - 1"):
            as_seeds(given, 4)  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    ("seeds", "place"),
    [
        (np.array([5, 6, -7], np.int8), 2),
        (np.array([5, -6, -7]), 1),
        (np.array([1.0, 2.0, 3.0]), 0),
        (np.array([1.0, 2.0, np.nan], np.float32), 0),
        (np.array([True, False, True]), 0),
        (np.array(["1", "2", "3"]), 0),
        (np.array([1, 2, 3], complex), 0),
        (np.array([1, 2, 3], "m8[s]"), 0),
        (np.array([1, 2, 3], "M8[s]"), 0),
    ],
)
def test_arrays_of_other_numbers_are_refused(seeds: np.ndarray, place: int):
    """Negative ones, floating-point ones though they are whole, truth values, texts and times."""
    with pytest.raises(ArgumentError, match=rf"seed\[{place}\]="):
        as_seeds(seeds, 3)


@pytest.mark.parametrize(
    "seeds", [[1, 2], [], (1, 2, 3, 4), np.arange(2), np.ones((3, 1), int), np.array(5), {1, 2, 3}, 1.0, None, "12"]
)
def test_a_wrong_number_of_seeds_is_told(seeds):
    """The right number is named."""
    with pytest.raises(ArgumentError, match="one integer, or a sequence of 3"):
        as_seeds(seeds, 3)


@pytest.mark.parametrize("dtype", [wp.int32, wp.int64, wp.float32])
def test_device_seeds_of_a_wrong_kind_are_refused(dtype):
    """A Warp array of another type or length is no set of seeds."""
    generator = LayoutGenerator(compile_on_cpu({"objects": {}}), 3)
    with pytest.raises(ArgumentError, match="uint64"):
        generator.reseed(seed=wp.zeros(3, dtype=dtype, device="cpu"))
    with pytest.raises(ArgumentError, match="3"):
        generator.reseed(seed=wp.zeros(2, dtype=wp.uint64, device="cpu"))
