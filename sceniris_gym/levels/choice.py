"""`Levels`: the words of a choice of levels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, check_names, check_type
from sceniris_gym.layout.masks import as_count

SCORES = ("learnability", "failure", "given")
PRIORITIES = ("rank", "proportional", "uniform")
_MOST = 1 << 24


@dataclass(frozen=True)
class Ranges:
    """Intervals of params that widen with success, and narrow with failure: automatic domain randomisation.

    Some fresh levels are made at one end of one interval. Once enough of their episodes are over, that end moves a step
    outwards where they succeed, and inwards where they fail (OpenAI et al., "Solving Rubik's Cube with a Robot Hand",
    2019, section 5). It stays between the interval at the start and that of the scene file.

    Attributes:
        start: The intervals at the start, by the names of params, such as {"groups.clutter.count": [1, 2]}.
        step: A step, as a share of the interval of the scene file; at least 1 for a count.
        probe: Probability that a fresh level is at an end: within a step of it, or for a count exactly at it.
        low, high: Rates of success at and below which an end moves inwards, and at and above which it moves outwards.
        episodes: Episodes at an end that are counted before it may move.

    Raises:
        ArgumentTypeError: The intervals are no mapping.
        ArgumentError: No param, shares that are not from 0 to 1, or low above high. A number of episodes that is no
            integer of at least 1.
    """

    start: Mapping[str, Any]
    step: float = 0.1
    probe: float = 0.5
    low: float = 0.3
    high: float = 0.7
    episodes: int = 256

    def __post_init__(self) -> None:
        check_type(self.start, Mapping, "Ranges: start")
        if not self.start:
            raise ArgumentError("Ranges: start should name a param.")
        _check_shares(self, "step", "probe", "low", "high")
        if self.step == 0.0 or self.low > self.high:
            raise ArgumentError(f"Ranges: step should be above 0, and low at most high, got {self}.")
        as_count(self.episodes, "Ranges: episodes", most=_MOST)


@dataclass(frozen=True)
class Levels:
    """A choice of levels.

    Attributes:
        score: "learnability" or "failure", which count successes, or "given", by `LevelSampler.update`.
        replay: Probability that a level is replayed rather than a fresh one.
        capacity: Levels in the buffer, each 24 bytes on the device and 4 for each number of the worlds' params. New
            ones take empty places while there are some, and then those of the lowest levels; which these are is found
            anew at every refresh of the weights.
        priority: "rank" weighs levels by rank^(-1 / temperature), the best first, "proportional" by score^(1 /
            temperature), "uniform" all alike. Scores within 4% of each other may count as equal.
        temperature: See `priority`.
        staleness: Share of the weight that goes by the time since a level was played last, in refreshes.
        rate: Weight of the newest episode in a rate of success, which begins at 0.5.
        every: Resets between two refreshes of the weights.
        ranges: Params of fresh levels whose intervals follow success; see `Ranges`.

    Raises:
        UnknownNameError: There is no such score or priority.
        ArgumentError: A share that is not from 0 to 1, or a temperature that is not above 0. A capacity or number of
            resets that is no integer of at least 1.
        ArgumentTypeError: `ranges` are no Ranges.
    """

    score: str = "learnability"
    replay: float = 0.5
    capacity: int = 1 << 16
    priority: str = "rank"
    temperature: float = 0.3
    staleness: float = 0.1
    rate: float = 0.25
    every: int = 32
    ranges: Ranges | None = None

    def __post_init__(self) -> None:
        check_names("score", [self.score], "Levels", SCORES)
        check_names("priority", [self.priority], "Levels", PRIORITIES)
        _check_shares(self, "replay", "staleness", "rate")
        if not isinstance(self.temperature, int | float) or not self.temperature > 0.0:
            raise ArgumentError(f"Levels: temperature should be above 0, got {short(self.temperature)}.")
        as_count(self.capacity, "Levels: capacity", most=_MOST)
        as_count(self.every, "Levels: every", most=_MOST)
        if self.ranges is not None:
            check_type(self.ranges, Ranges, "Levels: ranges")


def _check_shares(choice: Ranges | Levels, *names: str) -> None:
    """Check that attributes are numbers from 0 to 1."""
    for name in names:
        value = getattr(choice, name)
        if not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
            raise ArgumentError(f"{type(choice).__name__}: {name} should be from 0 to 1, got {short(value)}.")
