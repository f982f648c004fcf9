"""The race in which a piece of a region is chosen: by area, also for the one number in 16 million that is 0."""

import numpy as np
import warp as wp

from sceniris_gym.layout.points import race_time

STEP = 2.0**-24  # of a uniform number


@wp.kernel(enable_backward=False)
def _race(u: wp.array(dtype=float), size: wp.array(dtype=float), time_out: wp.array(dtype=float)):
    i = wp.tid()
    time_out[i] = race_time(u[i], size[i])


@wp.kernel(enable_backward=False)
def _plain(u: wp.array(dtype=float), size: wp.array(dtype=float), time_out: wp.array(dtype=float)):
    i = wp.tid()
    time_out[i] = -wp.log(1.0 - u[i]) / size[i]


def _times(kernel: wp.Kernel, u: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Times at which pieces finish, compared as the race does: by their bits."""
    inputs = [wp.array(a, dtype=float, device="cpu") for a in (u, size)]
    out = wp.zeros(len(u), dtype=float, device="cpu")
    wp.launch(kernel, dim=len(u), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy().view(np.uint32)


def test_zero_is_judged_by_area_like_its_neighbours():
    """It neither wins over a piece many times as large nor loses to one that is smaller and later."""
    u, size = np.array([0.0, STEP, 0.0, STEP, 0.5]), np.array([1e-6, 1.0, 1.0, 1.0, 1.0])
    tiny, large, zero, first, late = _times(_race, u, size).tolist()
    assert large < tiny
    assert zero < first < late


def test_all_other_numbers_keep_their_bits():
    """The times are those of the plain formula."""
    rng = np.random.default_rng(0)
    u = np.concatenate([rng.integers(1, 1 << 24, 100_000), [1, 2, 3, (1 << 24) - 1]]) * STEP
    size = 10.0 ** rng.uniform(-9, 2, len(u))
    assert (_times(_race, u, size) == _times(_plain, u, size)).all()


def test_zero_takes_its_share_of_the_race():
    """Its time is the middle of those of numbers below the first step: half of that one's."""
    zero, first = _times(_race, np.array([0.0, STEP]), np.ones(2)).view(np.float32)
    assert zero == first / 2
