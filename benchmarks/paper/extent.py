"""Extent of the suite's measurements, and the bench that they are made on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import warp as wp

from sceniris_gym.program.compiled import CompiledScene

LARGEST = 16384  # of the paper's figure of batch sizes
PRESSURE = 524288  # its pressure test
SIZES = (4, 16, 64, 256, 1024, 4096, LARGEST, PRESSURE)


@dataclass(frozen=True)
class Extent:
    """Extent of the measurements.

    Attributes:
        quick: Leave out what takes long.
        largest: Most scenes at once.
        reason: Why not more.
        rounds: Batches of which the median counts.
        judged: Layouts that FCL judges.
        seconds: How long a peer makes scenes [s].
    """

    quick: bool
    largest: int
    reason: str
    rounds: int
    judged: int
    seconds: float

    @classmethod
    def of(cls, device: str, quick: bool) -> Extent:
        """Return what suits a device."""
        gpu = wp.get_device(device).is_cuda
        if quick:
            return cls(True, LARGEST if gpu else 1024, "left out by --quick", 5, 100, 8.0)
        if gpu:
            return cls(False, PRESSURE, "", 9, 500, 40.0)
        return cls(False, LARGEST, "left to a GPU", 5, 500, 40.0)

    def within(self, worlds: int) -> int:
        """Return a number of scenes, or as many as there may be."""
        return min(worlds, self.largest)


@dataclass(frozen=True)
class Bench:
    """Setting of the measurements: device, extent, the scene Mid, and a folder for kernel caches."""

    device: str
    extent: Extent
    mid: CompiledScene
    folder: Path
