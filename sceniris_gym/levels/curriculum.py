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
"""The level of a world whose layout does not come from the buffer."""
FROM_BANK = -2
"""The level of a world whose layout comes from the bank. It does not count."""
_MOST = 1 << 24


@dataclass(frozen=True)
class ADR:
    """Automatic domain randomisation: intervals of params that widen with success and narrow with failure.

    Some fresh levels use one end of one interval. After enough of their episodes, this end moves outwards if they
    succeed and inwards if they fail (OpenAI et al., "Solving Rubik's Cube with a Robot Hand", 2019, section 5).
    The end stays between its value in `init_range` and the scene file's.

    Attributes:
        init_range: First interval of each param, such as {"groups.clutter.count": [1, 2]}.
        delta: Size of a move, as a fraction of the scene file's interval, and at least 1 for a count.
        boundary_fraction: Probability that a fresh level is at an end: within `delta` of it, or at a count's exact end.
        threshold_low: An end moves inwards at this success rate and below.
        threshold_high: An end moves outwards at this success rate and above.
        queue_length: Number of episodes at an end before it may move.

    Raises:
        ArgumentTypeError: `init_range` is not a mapping.
        ArgumentError: `init_range` is empty, a fraction is not from 0 to 1, or threshold_low is above threshold_high.
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
            raise ArgumentError("ADR: init_range should name a param.")
        _check_fractions(self, "delta", "boundary_fraction", "threshold_low", "threshold_high")
        if self.delta == 0.0 or self.threshold_low > self.threshold_high:
            raise ArgumentError(f"ADR: delta should be above 0, and threshold_low at most threshold_high, got {self}.")
        as_count(self.queue_length, "ADR: queue_length", most=_MOST)


@dataclass(frozen=True)
class LevelReplay:
    """Prioritized level replay: selects the levels that worlds replay, and their frequency.

    Attributes:
        score: "learnability" or "failure", which follow successes, or "custom", which `LevelSampler.update` sets.
        replay_prob: Probability that a reset replays a level. Otherwise the reset takes a fresh level.
        capacity: Number of levels in the buffer. A level takes 24 bytes on the device, and 4 for each value of its
            params. New levels fill the buffer first and then replace the levels with the lowest scores. The candidates
            for replacement are updated at every refresh of the weights.
        prioritization: "rank" weighs levels by rank^(-1 / temperature), the best first. "proportional" weighs them by
            score^(1 / temperature), and "uniform" equally. Scores within 4% of each other may count as equal.
        temperature: See `prioritization`.
        staleness_coef: Fraction of the weight that depends on the time since a level was last chosen, in refreshes.
        alpha: Weight of the newest episode in a success rate, which begins at 0.5.
        refresh_interval: Number of calls of `reset` between two refreshes of the weights, each for any number of
            worlds. An environment makes one such call in each step.
        adr: Moves the intervals of fresh levels, an ADR or a mapping of its fields.

    Raises:
        UnknownNameError: `score` or `prioritization` has another name.
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
    """Return a LevelReplay, given as an instance, a mapping of its fields, or an ADR. None stays None.

    An ADR or a mapping of its fields becomes a LevelReplay that never replays. `where` names the argument in errors.

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
    """Check that fields are numbers from 0 to 1."""
    for name in names:
        value = getattr(settings, name)
        if not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
            raise ArgumentError(f"{type(settings).__name__}: {name} should be from 0 to 1, got {short(value)}.")
