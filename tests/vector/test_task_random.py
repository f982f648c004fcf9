"""Random numbers of tasks: reproducible, even, and apart from those of the layouts."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import warp as wp
from scipy import stats

from sceniris_gym.sim.named_random import draw_uniform, named_stream, task_stream


def test_random_numbers_depend_on_seed_episode_step_and_stream(make_env):
    """They are the same in another batch, stay within a step, and change with each of these."""
    envs, other = make_env(3), make_env(2)
    envs.reset(seed=[5, 6, 7])
    other.reset(seed=[7, 5])
    first = envs.state.uniform(6, -2.0, 3.0)
    assert torch.equal(first, envs.state.uniform(6, -2.0, 3.0))
    assert torch.equal(first[[2, 0]], other.state.uniform(6, -2.0, 3.0))
    assert ((first >= -2.0) & (first < 3.0)).all()
    drawn = [first, envs.state.uniform(6, -2.0, 3.0, stream=1)]
    envs.step(torch.zeros(3, 5))
    drawn.append(envs.state.uniform(6, -2.0, 3.0))
    envs.reset()
    drawn.append(envs.state.uniform(6, -2.0, 3.0))
    values = torch.cat(drawn).flatten()
    assert len(torch.unique(values)) == len(values)
    with pytest.raises(ValueError, match="stream should be"):
        envs.state.uniform(1, stream=-1)


def test_random_numbers_fill_their_range_evenly(make_env):
    """A thousand numbers of a world have the mean and the spread of a uniform distribution."""
    envs = make_env(2)
    envs.reset(seed=0)
    values = envs.state.uniform(1000)[1].numpy()
    assert values.mean() == pytest.approx(0.5, abs=0.04)
    assert values.std() == pytest.approx(np.sqrt(1 / 12), abs=0.02)


def test_random_numbers_of_a_name_have_the_shape_that_is_asked_for(make_env):
    """A number is that of columns; environments and their randomizers draw the same."""
    envs = make_env(2)
    envs.reset(seed=0)
    for shape, wanted in (((), (2,)), (3, (2, 3)), ((3, 2), (2, 3, 2))):
        values = envs.state.random("name", shape)
        assert values.shape == wanted
        assert torch.equal(values, envs.randomizer.random("name", shape))


def draws(low: float = 0.0, high: float = 1.0, *, n: int = 8, stream: int = 0, step: int = 0) -> np.ndarray:
    """Return what 2000 worlds, of seeds 0 to 1999 and episode 3, draw; shape (2000, n)."""
    seed = wp.array(np.arange(2000, dtype=np.uint64), dtype=wp.uint64, device="cpu")
    episode, steps = (wp.full(2000, value, dtype=int, device="cpu") for value in (3, step))
    values = wp.zeros((2000, n), dtype=float, device="cpu")
    draw_uniform(seed, episode, steps, task_stream("train", stream), low, high, values)
    return values.numpy()


def test_worlds_steps_and_streams_are_independent():
    """Each column is uniform over the worlds, and no two columns of any step or stream are correlated."""
    columns = np.concatenate([draws(n=5), draws(n=5, step=1), draws(n=5, stream=1)], axis=1)
    assert all(stats.kstest(column, "uniform").pvalue > 0.001 for column in columns.T)
    assert np.abs(np.corrcoef(columns.T) - np.eye(15)).max() < 5.0 / np.sqrt(2000)


def test_fewer_numbers_are_the_first_of_more():
    """Also where they are no multiple of the four that are made at once; a range stretches the same numbers."""
    more = draws(n=11)
    for n in (1, 3, 4, 7):
        np.testing.assert_array_equal(draws(n=n), more[:, :n])
    np.testing.assert_allclose(draws(-2.0, 3.0, n=11), 5.0 * more - 2.0, atol=1e-6)


def test_no_stream_of_a_task_is_one_of_the_layouts_or_of_another_split():
    """The lowest and the highest ones; what is beyond them is refused."""
    most = 2**24 - 1
    found = [task_stream(split, stream) for split in ("train", "eval") for stream in (0, 1, most)]
    found += [named_stream(split) for split in ("train", "eval")]
    assert len(set(found)) == 8
    layouts = {(split << 24) + number for split in (0, 1, 2) for number in (0, 1, most - 2, most - 1, most)}
    assert not layouts & set(found)
    assert max(found) < 2**32
    for stream in (-1, most + 1):
        with pytest.raises(ValueError, match=r"stream should be .*(at least 0|16777215)"):
            task_stream("train", stream)


def philox(seed: int, counter: list[int]) -> list[int]:
    """Return the four words of Philox4x32-10 as its authors define it, in whole numbers of Python's own."""
    words, key, mask = list(counter), [seed & 0xFFFFFFFF, seed >> 32], 0xFFFFFFFF
    for _ in range(10):
        first, second = 0xD2511F53 * words[0], 0xCD9E8D57 * words[2]
        words = [(second >> 32) ^ words[1] ^ key[0], second & mask, (first >> 32) ^ words[3] ^ key[1], first & mask]
        key = [(key[0] + 0x9E3779B9) & mask, (key[1] + 0xBB67AE85) & mask]
    return words


def test_numbers_are_the_upper_bits_of_philox():
    """Of the world's seed, with episode, stream, step and number as the counter: the same on every machine."""
    assert philox(0, [0] * 4) == [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]  # as published
    found = draws(n=6, stream=5, step=9)
    for world in (0, 1, 1999):
        words = [w for draw in (0, 1) for w in philox(world, [3, task_stream("train", 5), 9, draw])]
        np.testing.assert_array_equal(found[world], np.array([(w >> 8) / 2**24 for w in words[:6]], np.float32))
