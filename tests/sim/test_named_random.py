"""Numbers drawn by name: the same for any number of worlds, others for another name, seed, episode or split."""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy import stats

from sceniris_gym.sim.named_random import draw_named


def drawn(seeds: list[int], n: int, name: str = "mass", *, split: str = "train", episode: int = 3) -> np.ndarray:
    """Return the numbers of worlds with these seeds, shape (len(seeds), n)."""
    with wp.ScopedDevice("cpu"):
        values = wp.zeros((len(seeds), n), dtype=float)
        draw_named(wp.array(seeds, dtype=wp.uint64), wp.full(len(seeds), episode, dtype=int), split, name, values)
    return values.numpy()


def test_numbers_belong_to_seed_episode_and_name():
    """Alone or among others, few or many of them; two names, splits or episodes share none."""
    values = drawn([5, 9, 2**63], 6)
    np.testing.assert_array_equal(drawn([9], 6)[0], values[1])
    np.testing.assert_array_equal(drawn([2**63, 9], 3), values[[2, 1], :3])
    others = [drawn([9], 6, "friction"), drawn([9], 6, split="eval"), drawn([9], 6, episode=4)]
    assert all(not np.isin(other, values).any() for other in others)


def test_numbers_are_uniform_and_independent():
    """Kolmogorov and Smirnov, over 2,000 seeds; the correlation of two names is that of chance."""
    one, other = (drawn(list(range(2000)), 1, name)[:, 0] for name in ("one", "other"))
    assert stats.kstest(one, "uniform").pvalue > 0.001
    assert abs(np.corrcoef(one, other)[0, 1]) < 3.3 / np.sqrt(2000)  # p = 0.001
