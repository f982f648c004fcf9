"""`Sensing`: noise, delay and dropout of a policy's observations, drawn from the seeds of the layouts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import torch
from torch import Tensor

from sceniris_gym.config.fields import short
from sceniris_gym.device.random import STREAM_BITS
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, check_names
from sceniris_gym.vector.state import State

NOISE, DELAY, DROPOUT = (2**STREAM_BITS - i for i in (1, 2, 3))
"""The last three of the random streams that tasks may use."""

POLICY = "policy"
"""The observation group with noise, delay and dropout. Other groups, such as `critic`, are exact."""


@dataclass(frozen=True)
class Sensing:
    """Noise, delay and dropout of the group `policy`, and delay of actions, drawn by seed, episode and step only.

    Attributes:
        noise: Standard deviation of Gaussian noise, by the name of an observation, in the observation's unit. An
            observation of shape (rows, columns) is a table with a row for each slot. Rows of zeros belong to absent
            objects and stay zero.
        delay: Least and greatest delay [control steps]. The delay is drawn uniformly for each episode. The first
            observation is repeated until the delay has passed.
        dropout: Probability that an observation repeats its previous value. Each observation is drawn independently in
            each step.
        late: Names of the observations to which `delay` and `dropout` apply. None selects all observations.
        encoder_bias: Greatest offset, by the name of an observation, in the observation's unit. For each episode, each
            number of the observation gets an offset drawn uniformly between minus and plus this value.
        action_delay: Least and greatest delay of actions [control steps]. The delay is drawn uniformly for each
            episode. The first action is repeated until the delay has passed.

    Raises:
        ArgumentError: A standard deviation, an offset or a delay is below 0, a least delay is above its greatest delay,
            or the dropout is outside of [0, 1).
        ArgumentTypeError: `noise` or `encoder_bias` is not a mapping of numbers. A delay is not a pair. `dropout` is
            not a number. `late` is not a tuple of names.
    """

    noise: Mapping[str, float] = field(default_factory=dict)
    delay: tuple[int, int] = (0, 0)
    dropout: float = 0.0
    late: tuple[str, ...] | None = None
    encoder_bias: Mapping[str, float] = field(default_factory=dict)
    action_delay: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        for word, sizes in (("noise", self.noise), ("encoder_bias", self.encoder_bias)):
            if not (isinstance(sizes, Mapping) and all(map(_is_number, sizes.values()))):
                raise ArgumentTypeError(f"sensing: {word} should map names to numbers, got {short(sizes)}.")
            for name, size in sizes.items():
                if not size >= 0.0:
                    raise ArgumentError(f"sensing: the {word} of '{name}' should be 0 or more, got {short(size)}.")
        if not _is_number(self.dropout):
            raise ArgumentTypeError(f"sensing: dropout should be a number, got {short(self.dropout)}.")
        if not (self.late is None or (isinstance(self.late, tuple) and all(isinstance(n, str) for n in self.late))):
            raise ArgumentTypeError(f"sensing: late should be a tuple of names or None, got {short(self.late)}.")
        for word, delay in (("delay", self.delay), ("action_delay", self.action_delay)):
            if not (isinstance(delay, tuple) and len(delay) == 2):
                raise ArgumentTypeError(f"sensing: {word} should be a pair (low, high), got {short(delay)}.")
            low, high = delay
            if not (isinstance(low, int) and isinstance(high, int) and 0 <= low <= high):
                raise ArgumentError(f"sensing: {word} should be integers, 0 <= low <= high, got {short(delay)}.")
        if not 0.0 <= self.dropout < 1.0:
            raise ArgumentError(f"sensing: dropout should be in [0, 1), got {short(self.dropout)}.")


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _there(values: Tensor) -> Tensor:
    """Return a mask of the values that get noise: all values except a table's rows of zeros, which are empty slots."""
    if values.ndim < 3:
        return torch.ones_like(values, dtype=torch.bool)
    return (values != 0.0).any(dim=-1, keepdim=True).expand_as(values)


class Sensors:
    """Applies a Sensing to the observations of all worlds, without host synchronisation.

    If the observations are requested again in the same step, for example after a reset of some worlds, the other worlds
    get the same values as before.

    Args:
        s: The worlds.
        sensing: Noise, delay and dropout.
        observation: An observation of the task, which sets the names and shapes.
        action_size: Length of an action.

    Raises:
        UnknownNameError: The task has no group `policy`, or the group lacks an observation that `sensing` names.
    """

    def __init__(
        self, s: State, sensing: Sensing, observation: Mapping[str, Mapping[str, Tensor]], action_size: int
    ) -> None:
        check_names("observation group", [POLICY], "sensing", observation)
        seen = observation[POLICY]
        check_names("observation", (*sensing.noise, *sensing.encoder_bias, *(sensing.late or ())), "sensing", seen)
        self.sensing = sensing
        late = tuple(seen) if sensing.late is None else sensing.late
        sizes = torch.tensor([values[0].numel() for values in seen.values()])
        self._parts, width = len(seen), int(sizes.sum())
        self._part = torch.arange(self._parts).repeat_interleave(sizes).to(s.device)
        self._deviation, self._bias = (
            torch.tensor([float(of.get(name, 0.0)) for name in seen], device=s.device)[self._part]
            for of in (sensing.noise, sensing.encoder_bias)
        )
        self._late = torch.tensor([name in late for name in seen], device=s.device)[self._part]
        self._rows = torch.arange(s.num_envs, device=s.device)
        self._past = torch.zeros(s.num_envs, sensing.delay[1] + 1, width, device=s.device)
        self._shown = torch.zeros(s.num_envs, 2, width, device=s.device)
        self._delay = torch.zeros(s.num_envs, dtype=torch.long, device=s.device)
        self._actions = torch.zeros(s.num_envs, sensing.action_delay[1] + 1, action_size, device=s.device)

    def __call__(self, s: State, observation: Mapping[str, dict[str, Tensor]]) -> dict[str, dict[str, Tensor]]:
        """Return the observation with noise, delay and dropout in the group `policy`."""
        seen = observation[POLICY]
        exact = torch.cat([values.reshape(len(values), -1).float() for values in seen.values()], dim=1)
        sensed = self._dropped(s, self._delayed(s, self._noisy(s, exact, seen)))
        pieces = sensed.split([values[0].numel() for values in seen.values()], dim=1)
        shaped = (piece.reshape(values.shape) for piece, values in zip(pieces, seen.values(), strict=True))
        return {**observation, POLICY: dict(zip(seen, shaped, strict=True))}

    def delayed_action(self, s: State, action: Tensor) -> Tensor:
        """Store `action`, and return the action that takes effect in this step, shape (num_envs, action size)."""
        low, high = self.sensing.action_delay
        if high == 0:
            return action
        delay = (low + (high - low + 1.0) * s.random("sensing: action_delay")).long().clamp(max=high)
        return self._kept(self._actions, s, action, delay)

    def _noisy(self, s: State, exact: Tensor, seen: Mapping[str, Tensor]) -> Tensor:
        if self.sensing.encoder_bias:
            u = s.random("sensing: encoder_bias", (exact.shape[1],))
            exact = exact + self._bias * (2.0 * u - 1.0)
        if not self.sensing.noise:
            return exact
        there = torch.cat([_there(values).reshape(len(values), -1) for values in seen.values()], dim=1)
        # Box-Muller transform, with log(1 - u) because u may be 0 but not 1
        u, v = s.uniform(2 * exact.shape[1], stream=NOISE).chunk(2, dim=1)
        noise = (-2.0 * torch.log1p(-u)).sqrt() * (2.0 * torch.pi * v).cos()
        return exact + self._deviation * noise * there

    def _delayed(self, s: State, now: Tensor) -> Tensor:
        low, high = self.sensing.delay
        if high == 0:
            return now
        drawn = (low + s.uniform(1, high=high - low + 1.0, stream=DELAY)[:, 0].floor()).long().clamp(max=high)
        self._delay.copy_(torch.where(s.elapsed == 0, drawn, self._delay))
        return torch.where(self._late, self._kept(self._past, s, now, self._delay), now)

    def _dropped(self, s: State, now: Tensor) -> Tensor:
        if self.sensing.dropout == 0.0:
            return now
        elapsed, first = s.elapsed.long(), s.elapsed == 0
        lost = (s.uniform(self._parts, stream=DROPOUT) < self.sensing.dropout)[:, self._part]
        lost = lost & self._late & ~first[:, None]
        shown = torch.where(lost, self._shown[self._rows, (elapsed - 1) % 2], now)
        return self._kept(self._shown, s, shown, 0)

    def _kept(self, ring: Tensor, s: State, now: Tensor, delay: Tensor | int) -> Tensor:
        """Store the values `now` in a ring buffer of the latest steps. Return the values from `delay` steps ago.

        The first values of an episode fill the whole ring.
        """
        elapsed, size = s.elapsed.long(), ring.shape[1]
        ring.copy_(torch.where((elapsed == 0)[:, None, None], now[:, None], ring))
        ring[self._rows, elapsed % size] = now
        return ring[self._rows, (elapsed - delay) % size]
