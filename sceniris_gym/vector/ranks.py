"""Processes that train together, as `torchrun` starts them: each has a device of its own, and worlds of its own."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass

import warp as wp

SEEDS = 1 << 40
"""How many seeds each process has for itself."""


@dataclass(frozen=True)
class Rank:
    """One of the processes that train together.

    Attributes:
        number: Its number among all, from 0.
        local: Its number among those of its host.
        size: How many there are.
    """

    number: int = 0
    local: int = 0
    size: int = 1

    @classmethod
    def current(cls) -> Rank:
        """The rank of this process by RANK, LOCAL_RANK and WORLD_SIZE, which torchrun sets; else the only one."""
        names = ("RANK", "LOCAL_RANK", "WORLD_SIZE")
        if any(not os.environ.get(name, "").isdecimal() for name in names):
            return cls()
        return cls(*(int(os.environ[name]) for name in names))

    @property
    def device(self) -> str | None:
        """The GPU of this process, if there are several processes and a GPU for each; None for the usual default."""
        return f"cuda:{self.local}" if self.size > 1 and self.local < wp.get_cuda_device_count() else None

    def own_seed(self, seed: int) -> int:
        """The seed of this process's first world where all processes are given the same `seed`, modulo 2^64."""
        return (seed + self.number * SEEDS) % (1 << 64)

    def tell(self, device: str) -> None:
        """Say on stderr what this process takes, if there are others."""
        if self.size > 1:
            print(
                f"sceniris_gym: rank {self.number} of {self.size} uses {device}; its seeds are {self.number} * 2^40 "
                "further on than those it is given.",
                file=sys.stderr,
            )


ALONE = Rank()
"""The only process."""
