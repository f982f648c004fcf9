"""Comparison of rates with the best ones so far, and the growth of the file of these."""

from __future__ import annotations

from benchmarks.figures import GPU_RATES, WATCHED
from benchmarks.rates import BEST, better, read_best, slower
from sceniris_gym.config.loader import shipped

TEXT = "# a comment\nmid 4096 2% 0.25 old\nmid 4096 all 1.0 older\n"


def line(ms: float, few: float, worlds: int = 4096) -> dict:
    """A line of the benchmark of rates."""
    return {"scene": "mid", "num_envs": worlds, "ms": ms, "ms_of_2_percent": few}


def test_more_than_two_percent_above_the_best_is_slower():
    """Each share of the worlds by itself, with the commit of the best; what was never measured is not slower."""
    best = read_best(TEXT)
    assert slower(best, [line(1.02, 0.255)]) == []
    assert slower(best, [line(9.0, 9.0, worlds=16)]) == []
    (found,) = slower(best, [line(1.05, 0.2)])
    assert found == "slower: mid, all of 4,096 worlds: 1.05 ms, +5.0% of 1.0 ms (older)"


def test_better_and_new_times_are_kept_with_their_commit():
    """The others stay as they are."""
    found = better(read_best(TEXT), [line(0.9, 0.3), line(2.0, 1.0, worlds=8)], "new")
    assert found["mid", 4096, "all"] == (0.9, "new")
    assert found["mid", 4096, "2%"] == (0.25, "old")
    assert found["mid", 8, "all"] == (2.0, "new")


def test_every_scene_is_watched_at_three_sizes():
    """And what the file holds is measured by a run."""
    sizes = [
        {int(pair.split(":")[1]) for pair in WATCHED if pair.startswith(f"{name}:")}
        for name in shipped("envs", ".yaml")
    ]
    assert all(len(found) >= 3 for found in sizes)
    assert {f"{scene}:{worlds}" for scene, worlds, _ in read_best(BEST.read_text())} <= {*WATCHED, *GPU_RATES}
