"""`Levels`: the words of a choice of levels."""

from __future__ import annotations

from dataclasses import dataclass

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.layout.counts import as_count

SCORES = ("learnability", "failure", "given")
PRIORITIES = ("rank", "proportional", "uniform")
_MOST = 1 << 24


@dataclass(frozen=True)
class Levels:
    """A choice of levels.

    Attributes:
        score: "learnability" or "failure", which count successes, or "given", by `LevelSampler.update`.
        replay: Probability that a level is replayed rather than a fresh one.
        capacity: Levels in the buffer, 24 bytes each on the device.
        priority: "rank" weighs levels by rank^(-1 / temperature), the best first, "proportional" by score^(1 /
            temperature), "uniform" all alike. Scores within 4% of each other may count as equal.
        temperature: See `priority`.
        staleness: Share of the weight that goes by the number of resets since a level was played last.
        rate: Weight of the newest episode in a rate of success, which begins at 0.5.
        every: Resets between two refreshes of the weights.

    Raises:
        UnknownNameError: There is no such score or priority.
        ArgumentError: A share that is not from 0 to 1, or a temperature that is not above 0.
        CountError: A capacity or number of resets that is no integer of at least 1.
    """

    score: str = "learnability"
    replay: float = 0.5
    capacity: int = 1 << 16
    priority: str = "rank"
    temperature: float = 0.3
    staleness: float = 0.1
    rate: float = 0.25
    every: int = 16

    def __post_init__(self) -> None:
        if self.score not in SCORES:
            raise UnknownNameError("score", str(self.score), "Levels", SCORES)
        if self.priority not in PRIORITIES:
            raise UnknownNameError("priority", str(self.priority), "Levels", PRIORITIES)
        for name in ("replay", "staleness", "rate"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ArgumentError(f"Levels: {name} should be from 0 to 1, got {getattr(self, name)}.")
        if not self.temperature > 0.0:
            raise ArgumentError(f"Levels: temperature should be above 0, got {self.temperature}.")
        as_count(self.capacity, "Levels: capacity", most=_MOST)
        as_count(self.every, "Levels: every", most=_MOST)
