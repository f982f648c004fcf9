"""`LayoutSource`: the interface through which a randomizer gets its layouts."""

from __future__ import annotations

from typing import Protocol

import warp as wp

from sceniris_gym.layout.layouts import Layouts


class LayoutSource(Protocol):
    """Makes the layouts of a batch of worlds: fresh ones (`LayoutGenerator`), or stored ones (`StoredLayouts`).

    The two launches run on the device alone, without allocation or host synchronisation, so that they can be part of a
    captured graph. They check nothing; the caller does.
    """

    @property
    def layouts(self) -> Layouts:
        """The latest layout of each world, always in the same arrays."""
        ...

    def launch_reseed(self, seeds: wp.array, mask: wp.array | None) -> None:
        """Give the masked worlds new seeds; the next layout that they get is that of episode 0.

        Args:
            seeds: Seeds on the device, shape (nworld,), uint64.
            mask: Which worlds, shape (nworld,), bool; all if None.
        """
        ...

    def launch_generate(self, mask: wp.array | None) -> None:
        """Advance the masked worlds by one episode and write their new layouts into `layouts`.

        Args:
            mask: Which worlds, shape (nworld,), bool; all if None.
        """
        ...

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """How many candidates were rejected for the layouts so far, by object and cause. Waits for the device."""
        ...
