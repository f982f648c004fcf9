"""`Rank`: one of the processes that train together under `torchrun`, each with a separate device and range of seeds."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass

import warp as wp

SEEDS = 1 << 40
"""Number of seeds in the range of each process."""


@dataclass(frozen=True)
class Rank:
    """One of the processes that train together.

    Attributes:
        number: Number of this process among all processes, starting at 0.
        local: Number of this process on its host, starting at 0.
        size: Number of all processes.
    """

    number: int = 0
    local: int = 0
    size: int = 1

    @classmethod
    def current(cls) -> Rank:
        """Return this process's Rank, from torchrun's RANK, LOCAL_RANK and WORLD_SIZE if all three are set."""
        names = ("RANK", "LOCAL_RANK", "WORLD_SIZE")
        if any(not os.environ.get(name, "").isdecimal() for name in names):
            return cls()
        return cls(*(int(os.environ[name]) for name in names))

    @property
    def device(self) -> str | None:
        """The GPU of this process. None means the default device, for a single process or a rank without a GPU."""
        return f"cuda:{self.local}" if self.size > 1 and self.local < wp.get_cuda_device_count() else None

    def own_seed(self, seed: int) -> int:
        """Return the seed of this process's first world, modulo 2^64. All processes are given the same `seed`."""
        return (seed + self.number * SEEDS) % (1 << 64)

    def tell(self, device: str) -> None:
        """If there are other processes, print this process's device and the offset of its seeds to stderr."""
        if self.size > 1:
            print(
                f"sceniris_gym: rank {self.number} of {self.size} uses {device}, and adds {self.number} * 2^40 to "
                "integer seeds.",
                file=sys.stderr,
            )
