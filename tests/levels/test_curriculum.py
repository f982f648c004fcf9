"""Settings of a curriculum: wrong ones are refused by name, and mappings are as good as dataclasses."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError
from sceniris_gym.levels import ADR, LevelReplay
from sceniris_gym.levels.curriculum import as_curriculum


@pytest.mark.parametrize(
    ("words", "error", "match"),
    [
        ({"score": "learnable"}, UnknownNameError, "learnability"),
        ({"prioritization": "ranks"}, UnknownNameError, "rank"),
        ({"replay_prob": 1.5}, ArgumentError, "replay_prob should be from 0 to 1"),
        ({"staleness_coef": -0.1}, ArgumentError, "staleness_coef should be from 0 to 1"),
        ({"alpha": float("nan")}, ArgumentError, "alpha should be from 0 to 1"),
        ({"replay_prob": "half"}, ArgumentError, "replay_prob should be from 0 to 1, got 'half'"),
        ({"temperature": 0.0}, ArgumentError, "temperature should be above 0"),
        ({"temperature": "hot"}, ArgumentError, "temperature should be above 0, got 'hot'"),
        ({"capacity": 0}, ArgumentError, "at least 1"),
        ({"refresh_interval": 0.5}, ArgumentError, "integer"),
        ({"adr": [1, 2]}, ArgumentTypeError, "LevelReplay: adr should be an ADR"),
        ({"adr": {"groups.clutter.count": [1, 2]}}, UnknownNameError, "LevelReplay: adr: unknown field"),
    ],
)
def test_wrong_words_are_refused(words, error, match):
    """Names that do not exist, shares outside of 0 to 1, numbers that are none."""
    with pytest.raises(error, match=match):
        LevelReplay(**words)


def test_an_adr_without_a_param_is_refused():
    """There would be no end for a fresh level to be at."""
    with pytest.raises(ArgumentError, match="init_range should name at least one param"):
        ADR({})
    with pytest.raises(ArgumentTypeError, match="init_range should be a Mapping"):
        ADR(["groups.clutter.count"])  # pyrefly: ignore[bad-argument-type]


def test_numbers_of_an_adr_are_checked():
    """Shares are from 0 to 1, and the lower one is not above the upper one."""
    start = {"groups.clutter.count": [1, 2]}
    with pytest.raises(ArgumentError, match="delta should be from 0 to 1, got 'wide'"):
        ADR(start, delta="wide")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(ArgumentError, match="threshold_low at most threshold_high"):
        ADR(start, threshold_low=0.8)


def test_an_adr_alone_replays_no_level():
    """Given as itself or as a mapping of its fields, as Gymnasium's JSON has it; mappings of a LevelReplay nest it."""
    adr = ADR({"groups.clutter.count": [1, 2]}, delta=0.2)
    fields = asdict(adr)
    for value in (adr, fields, {"replay_prob": 0.0, "adr": fields}):
        assert as_curriculum(value, "curriculum") == LevelReplay(replay_prob=0.0, adr=adr)
    assert as_curriculum(None, "curriculum") is None
    assert as_curriculum({"score": "failure"}, "curriculum") == LevelReplay("failure")
    with pytest.raises(UnknownNameError, match=r"curriculum: unknown field 'replay'\. 'replay' is now replay_prob"):
        as_curriculum({"replay": 0.5}, "curriculum")
