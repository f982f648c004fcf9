"""The exponential race that chooses a piece of a region by area, also where a random number is 0."""

import numpy as np
import warp as wp

from sceniris_gym.layout.wave.exponential_race import NO_PIECE, PointCounter, arrival_key, arrival_time, piece_of

STEP = 2.0**-24  # of a uniform number


@wp.kernel(enable_backward=False)
def _race(u: wp.array[float], size: wp.array[float], time_out: wp.array[float]):
    i = wp.tid()
    time_out[i] = arrival_time(u[i], size[i])


def _times(u: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the arrival times of pieces as their bits, by which the race compares them."""
    inputs = [wp.array(a, dtype=float, device="cpu") for a in (u, size)]
    out = wp.zeros(len(u), dtype=float, device="cpu")
    wp.launch(_race, dim=len(u), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy().view(np.uint32)


def test_zero_is_judged_by_area_like_its_neighbours():
    """It neither wins over a piece many times as large nor loses to one that is smaller and later."""
    u, size = np.array([0.0, STEP, 0.0, STEP, 0.5]), np.array([1e-6, 1.0, 1.0, 1.0, 1.0])
    tiny, large, zero, first, late = _times(u, size).tolist()
    assert large < tiny
    assert zero < first < late


def test_all_other_numbers_have_the_time_of_the_formula():
    """By double precision, with two roundings to floats."""
    rng = np.random.default_rng(0)
    u = np.concatenate([rng.integers(1, 1 << 24, 100_000), [1, 2, 3, (1 << 24) - 1]]) * STEP
    size = (10.0 ** rng.uniform(-9, 2, len(u))).astype(np.float32)
    np.testing.assert_allclose(_times(u, size).view(np.float32), -np.log(1.0 - u) / size, rtol=1.3e-7)


def test_zero_takes_its_share_of_the_race():
    """Its time is the middle of those of numbers below the first step: half of that one's."""
    zero, first = _times(np.array([0.0, STEP]), np.ones(2)).view(np.float32)
    assert zero == first / 2


@wp.kernel(enable_backward=False)
def _finish(numbers: PointCounter, size: wp.array[float], key: wp.array[wp.uint64], index: wp.array[int]):
    i = wp.tid()
    key[i] = arrival_key(numbers, 2, i, size[i])
    index[i] = piece_of(key[i])


def test_the_least_key_is_that_of_the_first_to_finish():
    """The upper word has the time and the lower the number; every piece precedes the sentinel."""
    numbers = PointCounter()
    numbers.seed, numbers.episode, numbers.stream, numbers.trial = wp.uint64(3), 1, wp.uint32(4), 5
    size = np.tile(np.array([1e-9, 1e-3, 0.5, 2.0], np.float32), 5000)
    inputs = [numbers, wp.array(size, dtype=float, device="cpu")]
    key = wp.zeros(len(size), dtype=wp.uint64, device="cpu")
    index = wp.zeros(len(size), dtype=int, device="cpu")
    wp.launch(_finish, dim=len(size), inputs=inputs, outputs=[key, index], device="cpu")
    assert (index.numpy() == np.arange(len(size))).all()
    assert (key.numpy() < np.uint64(NO_PIECE)).all()
    time = (key.numpy() >> np.uint64(32)).astype(np.uint32).view(np.float32)
    assert (np.diff(time[np.argsort(key.numpy())]) >= 0.0).all()
    means = (time * size).reshape(-1, 4).mean(0)
    assert np.abs(means - 1.0).max() < 5 / np.sqrt(5000)
