"""`Outcome`: the results of a control step in all worlds."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor


class Outcome(NamedTuple):
    """The results of a control step, before any world is reset.

    Attributes:
        terms: Names of the reward terms.
        gained: Their values, shape (nterm, num_envs), float32.
        success: Worlds in which the goal is reached, shape (num_envs,), bool.
        broken: Worlds whose state is no longer finite, shape (num_envs,), bool.
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

    def without(self, mask: Tensor) -> Outcome:
        """Return an outcome in which nothing counts for the masked worlds."""
        flags = (flag & ~mask for flag in self[2:])
        return Outcome(self.terms, torch.where(mask, 0.0, self.gained), *flags)

    def info(self) -> dict[str, Any]:
        """Return what `info` has of it."""
        terms = dict(zip(self.terms, self.gained, strict=True))
        return {"success": self.success, "broken": self.broken, "reward_terms": terms}
