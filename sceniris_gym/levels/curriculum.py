"""`LevelReplay` and `ADR`: settings of a curriculum."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sceniris_gym.config.fields import short
from sceniris_gym.config.settings import as_config
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, check_names, check_type, refuses_old_names
from sceniris_gym.layout.masks import as_count

SCORES = ("learnability", "failure", "custom")
PRIORITIZATIONS = ("rank", "proportional", "uniform")
FRESH = -1
"""The level of a world with a fresh layout, which comes neither from the buffer nor from the bank."""
FROM_BANK = -2
"""The level of a world with a layout from the bank. Such episodes do not count."""
_MOST = 1 << 24


@dataclass(frozen=True)
class ADR:
    """Automatic domain randomisation: success widens the intervals of params, and failure narrows them.

    Some fresh levels test one end of one interval. After `queue_length` episodes at an end, the end moves outwards if
    their success rate is high, and inwards if it is low (OpenAI et al., "Solving Rubik's Cube with a Robot Hand", 2019,
    section 5). An end always stays between its value in `init_range` and its value in the scene file.

    Attributes:
        init_range: Interval of each param at the start of training, such as {"groups.clutter.count": [1, 2]}.
        delta: Distance by which an end moves, as a fraction of the length of the scene file's interval. The end of a
            count moves by at least 1.
        boundary_fraction: Probability that a fresh level tests an end of an interval. The level's param is then drawn
            between the end and the point that is `delta` inside the interval. A count gets the end itself.
        threshold_low: An end moves inwards if the success rate is at most this.
        threshold_high: An end moves outwards if the success rate is at least this.
        queue_length: Number of episodes that are counted at an end before it may move.

    Raises:
        ArgumentTypeError: `init_range` is not a mapping.
        ArgumentError: `init_range` is empty, a fraction is not from 0 to 1, `delta` is 0, or `threshold_low` is above
            `threshold_high`.
        ArgumentError: `queue_length` is not an integer of at least 1.
    """

    init_range: Mapping[str, Any]
    delta: float = 0.1
    boundary_fraction: float = 0.5
    threshold_low: float = 0.3
    threshold_high: float = 0.7
    queue_length: int = 256

    def __post_init__(self) -> None:
        check_type(self.init_range, Mapping, "ADR: init_range")
        if not self.init_range:
            raise ArgumentError("ADR: init_range should name at least one param: {'groups.clutter.count': [1, 2]}.")
        _check_fractions(self, "delta", "boundary_fraction", "threshold_low", "threshold_high")
        if self.delta == 0.0 or self.threshold_low > self.threshold_high:
            raise ArgumentError(f"ADR: delta should be above 0, and threshold_low at most threshold_high, got {self}.")
        as_count(self.queue_length, "ADR: queue_length", most=_MOST)


@dataclass(frozen=True)
class LevelReplay:
    """Settings of prioritized level replay: which levels worlds replay, and how often.

    Attributes:
        score: "learnability" or "failure" computes the score of a level from the successes of its episodes. "custom"
            takes the scores that you pass to `LevelSampler.update`.
        replay_prob: Probability that a reset replays a level. Otherwise the reset takes a fresh level.
        capacity: Number of levels in the buffer. A level takes 24 bytes on the device, and 4 more for each value of its
            params. New levels first fill the buffer, and then replace the levels with the lowest scores. Each refresh
            of the weights selects the levels that may be replaced until the next refresh.
        prioritization: "rank" weighs levels by rank^(-1 / temperature), where the highest score has rank 1.
            "proportional" weighs them by score^(1 / temperature). "uniform" gives all levels the same weight. Scores
            that differ by less than 4% may count as equal.
        temperature: See `prioritization`.
        staleness_coef: Fraction of a level's weight that depends on its staleness: the number of refreshes since the
            level was last chosen.
        alpha: Weight of the newest episode in the success rate of a level. The rate begins at 0.5.
        refresh_interval: Number of resets from one refresh of the weights to the next. A call of `reset` counts once,
            for any number of worlds. An environment calls `reset` once in each step.
        adr: An ADR, a mapping of its fields, or None. The ADR sets the params of fresh levels.

    Raises:
        UnknownNameError: `score` or `prioritization` is not a name listed above.
        ArgumentError: A fraction is not from 0 to 1, or the temperature is not above 0.
        ArgumentTypeError: `adr` has another type.
        ArgumentError: `capacity` or `refresh_interval` is not an integer of at least 1.
    """

    score: str = "learnability"
    replay_prob: float = 0.5
    capacity: int = 1 << 16
    prioritization: str = "rank"
    temperature: float = 0.3
    staleness_coef: float = 0.1
    alpha: float = 0.25
    refresh_interval: int = 32
    adr: ADR | None = None

    def __post_init__(self) -> None:
        check_names("score", [self.score], "LevelReplay", SCORES)
        check_names("prioritization", [self.prioritization], "LevelReplay", PRIORITIZATIONS)
        _check_fractions(self, "replay_prob", "staleness_coef", "alpha")
        if not isinstance(self.temperature, int | float) or not self.temperature > 0.0:
            raise ArgumentError(f"LevelReplay: temperature should be above 0, got {short(self.temperature)}.")
        as_count(self.capacity, "LevelReplay: capacity", most=_MOST)
        as_count(self.refresh_interval, "LevelReplay: refresh_interval", most=_MOST)
        if self.adr is not None:
            object.__setattr__(self, "adr", as_config(ADR, self.adr, "LevelReplay: adr"))


ADR.__init__ = refuses_old_names(ADR.__init__)
LevelReplay.__init__ = refuses_old_names(LevelReplay.__init__)


def as_curriculum(value: Any, where: str) -> LevelReplay | None:
    """Return the LevelReplay that `value` describes: a LevelReplay, an ADR, or a mapping of the fields of either class.

    An ADR becomes a LevelReplay that never replays levels. For None, the result is None. `where` names the
    argument in errors.

    Raises:
        ArgumentTypeError, UnknownNameError: See `as_config`.
        ArgumentError: See LevelReplay and ADR.
    """
    if isinstance(value, ADR) or (isinstance(value, Mapping) and "init_range" in value):
        return LevelReplay(replay_prob=0.0, adr=as_config(ADR, value, where))
    if not isinstance(value, LevelReplay | Mapping | None):
        wanted = "a LevelReplay, an ADR, a mapping of the fields of one, or None"
        raise ArgumentTypeError(f"{where} should be {wanted}, got {short(value)}.")
    return None if value is None else as_config(LevelReplay, value, where)


def _check_fractions(settings: ADR | LevelReplay, *names: str) -> None:
    """Check that the named fields are numbers from 0 to 1."""
    for name in names:
        value = getattr(settings, name)
        if not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
            raise ArgumentError(f"{type(settings).__name__}: {name} should be from 0 to 1, got {short(value)}.")
