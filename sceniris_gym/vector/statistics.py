"""`Outcome`: the results of a control step. `EpisodeStatistics`: sums over finished episodes, read on request."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import torch
from torch import Tensor

COUNTS = ("episodes", "length", "success", "broken")
"""Names of the sums that precede the reward terms."""


def finite_rows(tensors: Iterable[Tensor]) -> Tensor:
    """Return which rows are finite in all tensors, shape (nrow,), bool. Each tensor has shape (nrow, n)."""
    # one sum replaces a test of every number, because x - x is 0 only if x is finite
    total = torch.stack([tensor.sum(dim=1) for tensor in tensors]).sum(dim=0)
    return total - total == 0.0


class Outcome(NamedTuple):
    """The results of a control step, before any world is reset.

    Attributes:
        terms: Names of the reward terms.
        gained: Values of the reward terms, shape (nterm, num_envs), float32.
        success: Worlds that have reached the goal, shape (num_envs,), bool.
        broken: Worlds that have numbers that are not finite, shape (num_envs,), bool.
        terminated: Worlds whose episode is terminated, shape (num_envs,), bool.
        truncated: Worlds whose episode is truncated, shape (num_envs,), bool.
    """

    terms: tuple[str, ...]
    gained: Tensor
    success: Tensor
    broken: Tensor
    terminated: Tensor
    truncated: Tensor

    @property
    def done(self) -> Tensor:
        """Worlds whose episode ends, shape (num_envs,), bool."""
        return self.terminated | self.truncated

    def breaking(self, mask: Tensor) -> Outcome:
        """Return the outcome with the masked worlds marked as broken. Broken worlds are terminated, with reward 0."""
        gained = torch.where(mask, 0.0, self.gained)
        return self._replace(gained=gained, broken=self.broken | mask, terminated=self.terminated | mask)

    def without(self, mask: Tensor) -> Outcome:
        """Return the outcome without the masked worlds: their rewards are 0, and all their flags are false."""
        flags = (flag & ~mask for flag in self[2:])
        return Outcome(self.terms, torch.where(mask, 0.0, self.gained), *flags)

    def info(self) -> dict[str, Any]:
        """Return the entries of `info` for this step."""
        terms = dict(zip(self.terms, self.gained, strict=True))
        return {"success": self.success, "broken": self.broken, "reward_terms": terms}


class EpisodeStatistics:
    """Sums over the episodes that finished since the last `clear`. By default, `read` clears the sums.

    An episode finishes when it is terminated or truncated. Episodes that a reset interrupts do not count. With
    autoreset disabled, the steps of a world after the end of its episode do not count either.

    Each step updates the sums of all worlds in a few small operations on the device. Only `read` waits for the device.

    Args:
        num_envs: Number of worlds.
        device: Torch device.

    Attributes:
        names: Names of the sums: "episodes" (number of episodes), "length" [control steps], "success" (episodes whose
            last step was a success), "broken" (episodes that ended because a number was not finite), and the reward
            terms. The names of the reward terms are known after the first step.
        finished: Worlds whose episode finished in the last step, shape (num_envs,), bool.
    """

    def __init__(self, num_envs: int, device: torch.device) -> None:
        self.names: tuple[str, ...] = COUNTS
        # doubles, because the sums may grow for a long time before they are read
        self._sums = torch.zeros(len(COUNTS), num_envs, dtype=torch.float64, device=device)
        self._running, self._latest = self._sums[:0], self._sums.clone()
        self._ended = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self.finished = self._ended

    def start(self, mask: Tensor) -> None:
        """Begin new episodes in the worlds of `mask`, shape (num_envs,), bool."""
        self._running.masked_fill_(mask, 0.0)
        self._ended.logical_and_(~mask)

    def add(self, outcome: Outcome, elapsed: Tensor) -> None:
        """Add a step of all worlds.

        Args:
            outcome: Results of the step, with the same reward terms in every step.
            elapsed: Steps of the episode, shape (num_envs,).
        """
        if self.names == COUNTS:
            self.names = (*COUNTS, *outcome.terms)
            with torch.inference_mode(False):  # outside it, torch refuses writes to tensors that were made inside it
                self._running = self._sums.new_zeros(len(outcome.terms), self._sums.shape[1])
                self._sums = torch.cat([self._sums, self._running])
        self._running.add_(outcome.gained)
        done = outcome.done
        self.finished = counted = done & ~self._ended
        counts = torch.stack([counted, counted * elapsed, counted & outcome.success, counted & outcome.broken])
        self._latest = torch.cat([counts, torch.where(counted, self._running, 0.0)])
        self._sums.add_(self._latest)
        self._ended.logical_or_(done)

    def sums(self) -> Tensor:
        """Return the sums over finished episodes, in the order of `names`, shape (len(names),), on the device."""
        return self._sums.sum(dim=1)

    def latest(self) -> Tensor:
        """Return the sums over only the episodes that finished in the last step. `clear` does not affect these sums."""
        return self._latest.sum(dim=1)

    def read(self, clear: bool = True) -> dict[str, Any]:
        """Return the means over the finished episodes. Waits for the device.

        Args:
            clear: Also set the sums to 0, so that the next call covers only later episodes.

        Returns:
            `return`, `length` [control steps], `success` (fraction of the episodes whose last step was a success) and
            `reward_terms` (sum over an episode, by name), all NaN if no episode finished. `episodes` is the number of
            episodes, and `broken` the number of episodes that ended because a number was not finite.
        """
        sums = self.sums().tolist()
        if clear:
            self.clear()
        count = int(sums[0])
        length, success, _, *terms = (value / count if count else float("nan") for value in sums[1:])
        by_name = dict(zip(self.names[len(COUNTS) :], terms, strict=True))
        return {
            "episodes": count,
            "return": sum(terms) if count else float("nan"),
            "length": length,
            "success": success,
            "broken": int(sums[3]),
            "reward_terms": by_name,
        }

    def clear(self) -> None:
        """Set the sums to 0. When a running episode finishes, it counts in full, with the steps before this call."""
        self._sums.zero_()
