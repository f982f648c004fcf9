"""Shares of a data set: what torchrun and Slurm say, and what users write."""

from __future__ import annotations

import pytest

from sceniris_gym.dataset.shard import Shard
from sceniris_gym.errors import ArgumentError


def slurm(task: int, first: int, last: int, count: int, **more: str) -> dict[str, str]:
    """The environment of a task of a Slurm array."""
    numbers = {"ID": task, "MIN": first, "MAX": last, "COUNT": count}
    return {f"SLURM_ARRAY_TASK_{name}": str(number) for name, number in numbers.items()} | more


@pytest.mark.parametrize(
    ("environment", "shard"),
    [
        ({}, Shard(0, 1)),
        ({"RANK": "3", "WORLD_SIZE": "8", "LOCAL_RANK": "1"}, Shard(3, 8)),
        ({"RANK": "3"}, Shard(0, 1)),
        (slurm(4, 0, 7, 8), Shard(4, 8)),
        (slurm(4, 1, 8, 8), Shard(3, 8)),
        (slurm(9, 1, 9, 5, SLURM_ARRAY_TASK_STEP="2"), Shard(4, 5)),
        (slurm(3, 3, 3, 1), Shard(0, 1)),
        ({"RANK": "1", "WORLD_SIZE": "2"} | slurm(4, 0, 7, 8), Shard(1, 2)),
    ],
)
def test_a_process_finds_its_shard_in_the_environment(environment: dict[str, str], shard: Shard):
    """Torchrun's before Slurm's; an array may begin anywhere and have a step; a task sent alone writes what is left."""
    assert Shard.current(environment) == shard


@pytest.mark.parametrize("rank", ["2", "9" * 5000])
def test_a_rank_is_below_the_size(rank: str):
    """The message names what the user has set, which is no option."""
    with pytest.raises(ArgumentError, match=r"RANK=.* should be below WORLD_SIZE=2"):
        Shard.current({"RANK": rank, "WORLD_SIZE": "2"})


def test_an_array_with_gaps_needs_words():
    """Tasks 0, 3 and 7 are no first, second and third: nobody knows whether 1 and 2 are somewhere else."""
    with pytest.raises(ArgumentError, match=r"task 3 .* from 0 to 7 with gaps.*--shard R/K"):
        Shard.current(slurm(3, 0, 7, 3))


@pytest.mark.parametrize("step", ["0", "x", "-1", "9" * 5000])
def test_an_array_steps_by_a_positive_integer(step: str):
    """Whatever a script has made of Slurm's variable."""
    with pytest.raises(ArgumentError, match=r"SLURM_ARRAY_TASK_STEP=.* should be a positive integer"):
        Shard.current(slurm(1, 0, 3, 4, SLURM_ARRAY_TASK_STEP=step))


@pytest.mark.parametrize("words", ["", "1", "8/8", "-1/2", "1/2/3", "a/b", "1/0", "1.0/2", "٣/٨"])
def test_a_shard_is_r_of_k(words: str):
    """R from 0 to K - 1, in plain digits."""
    assert Shard.parse("7/8") == Shard(7, 8)
    with pytest.raises(ArgumentError, match="should be R/K"):
        Shard.parse(words)
