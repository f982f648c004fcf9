"""The words of a choice of levels: wrong ones are refused by name."""

from __future__ import annotations

import pytest

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError
from sceniris_gym.levels import Levels, Ranges


@pytest.mark.parametrize(
    ("words", "error", "match"),
    [
        ({"score": "learnable"}, UnknownNameError, "learnability"),
        ({"priority": "ranks"}, UnknownNameError, "rank"),
        ({"replay": 1.5}, ArgumentError, "replay should be from 0 to 1"),
        ({"staleness": -0.1}, ArgumentError, "staleness should be from 0 to 1"),
        ({"rate": float("nan")}, ArgumentError, "rate should be from 0 to 1"),
        ({"replay": "half"}, ArgumentError, "replay should be from 0 to 1, got 'half'"),
        ({"temperature": 0.0}, ArgumentError, "temperature should be above 0"),
        ({"temperature": "hot"}, ArgumentError, "temperature should be above 0, got 'hot'"),
        ({"capacity": 0}, ArgumentError, "at least 1"),
        ({"every": 0.5}, ArgumentError, "integer"),
        ({"ranges": {"groups.clutter.count": [1, 2]}}, ArgumentTypeError, "ranges should be a Ranges"),
    ],
)
def test_wrong_words_are_refused(words, error, match):
    """Names that do not exist, shares outside of 0 to 1, numbers that are none."""
    with pytest.raises(error, match=match):
        Levels(**words)


def test_ranges_without_a_param_are_refused():
    """There would be no end for a fresh level to be at."""
    with pytest.raises(ArgumentError, match="start should name a param"):
        Ranges({})
    with pytest.raises(ArgumentTypeError, match="start should be a Mapping"):
        Ranges(["groups.clutter.count"])  # type: ignore[arg-type]


def test_numbers_of_ranges_are_checked():
    """Shares are from 0 to 1, and the lower one is not above the upper one."""
    start = {"groups.clutter.count": [1, 2]}
    with pytest.raises(ArgumentError, match="step should be from 0 to 1, got 'wide'"):
        Ranges(start, step="wide")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="low at most high"):
        Ranges(start, low=0.8)
