"""`Outcome`: the results of a control step in all worlds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import torch
from torch import Tensor


def finite_rows(tensors: Iterable[Tensor]) -> Tensor:
    """Return the rows in which all numbers of all tensors, each of shape (nrow, n), are finite: (nrow,), bool."""
    # a sum is finite if its terms are, and a finite number minus itself is 0
    total = torch.stack([tensor.sum(dim=1) for tensor in tensors]).sum(dim=0)
    return total - total == 0.0


class Outcome(NamedTuple):
    """The results of a control step, before any world is reset.

    Attributes:
        terms: Names of the reward terms.
        gained: Their values, shape (nterm, num_envs), float32.
        success: Worlds in which the goal is reached, shape (num_envs,), bool.
        broken: Worlds with numbers that are not finite, shape (num_envs,), bool.
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
        """Return an outcome in which the masked worlds are broken, too: terminated, with reward 0."""
        gained = torch.where(mask, 0.0, self.gained)
        return self._replace(gained=gained, broken=self.broken | mask, terminated=self.terminated | mask)

    def without(self, mask: Tensor) -> Outcome:
        """Return an outcome in which nothing counts for the masked worlds."""
        flags = (flag & ~mask for flag in self[2:])
        return Outcome(self.terms, torch.where(mask, 0.0, self.gained), *flags)

    def info(self) -> dict[str, Any]:
        """Return what `info` has of it."""
        terms = dict(zip(self.terms, self.gained, strict=True))
        return {"success": self.success, "broken": self.broken, "reward_terms": terms}
