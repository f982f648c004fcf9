"""`LayoutPipeline`: which layout each world gets next, who makes it, and when."""

from __future__ import annotations

from typing import Protocol

import warp as wp

from sceniris_gym.device.fixed import Fixed
from sceniris_gym.layout.ahead import Ahead
from sceniris_gym.layout.layouts import LayoutKeys
from sceniris_gym.layout.source import LayoutSource


class Chooser(Protocol):
    """Asks for other layouts than the next episode of a seed.

    An environment takes one as `layout_source=lambda compiled, n: LayoutPipeline(maker, chooser=...)`. It writes
    `next_seed`, `next_episode` and `next_knob` of a LayoutsView, which snapshots have rows of; they have none of its
    own memory. Its launches check nothing, never wait for the host, and take a mask of worlds, shape (nworld,), bool;
    None is all.
    """

    def launch_choose(self, mask: wp.array | None) -> None:
        """Choose the layouts that follow those which the masked worlds were just served.

        Episodes on these have just begun: their outcomes count from the next choice on.
        """

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """Hear how episodes ended; see `LayoutSource.launch_finish`."""

    def launch_forget(self, seeds: wp.array | None, mask: wp.array | None) -> None:
        """Forget what was chosen for the masked worlds, since `LayoutSource.launch_reseed` chose for them."""

    def launch_set_knobs(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """Choose layouts with these numbers of knobs from now on; see `LayoutSource.launch_set_knobs`."""

    def after_reset(self) -> None:
        """Host-side hook, called after the launches of every reset."""


class LayoutPipeline(Fixed, LayoutSource):
    """The layouts of a maker, some of them made ahead, chosen by a chooser.

    Args:
        maker: Makes the layouts; use it for nothing else from now on.
        split: Split of the layouts if the maker has none of its own.
        ahead: Prefetches the layouts of the maker; None makes each as it is served.
        chooser: Chooses which layout follows; None goes from episode to episode of one seed.

    Attributes:
        layouts: The latest layouts, in the arrays of the maker.
        split: Split of the layouts.

    Raises:
        FixedError: Raised on assignment to an attribute that captured graphs already use.
    """

    FIXED = ("maker", "ahead", "chooser", "layouts", "split", "hears")

    def __init__(
        self, maker: LayoutSource, split: str = "train", *, ahead: Ahead | None = None, chooser: Chooser | None = None
    ) -> None:
        self.maker, self.ahead, self.chooser, self.layouts = maker, ahead, chooser, maker.layouts
        self.split: str = maker.split or split
        self.hears = maker.hears or chooser is not None

    def launch_generate(self, mask: wp.array | None) -> None:
        """See `LayoutSource`."""
        if self.ahead is None:
            self.maker.launch_generate(mask)
        else:
            self.ahead.launch_open(mask)
            self.maker.launch_make(self.ahead.missing)
            self.ahead.launch_close(mask)
        if self.chooser is not None:
            self.chooser.launch_choose(mask)

    def launch_reseed(self, seeds: wp.array | None, mask: wp.array | None, episodes: wp.array | None = None) -> None:
        """See `LayoutSource`."""
        self.maker.launch_reseed(seeds, mask, episodes)
        if self.chooser is not None:
            self.chooser.launch_forget(seeds, mask)

    def launch_set_knobs(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """See `LayoutSource`; what was made ahead for the masked worlds is made again."""
        if self.chooser is not None:
            self.chooser.launch_set_knobs(columns, values, mask)
        self.maker.launch_set_knobs(columns, values, mask)
        if self.ahead is not None:
            self.ahead.launch_forget(mask)

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """See `LayoutSource`."""
        self.maker.launch_finish(success, finished)
        if self.chooser is not None:
            self.chooser.launch_finish(success, finished)

    def after_reset(self) -> None:
        """See `LayoutSource`."""
        for part in (self.maker, self.ahead, self.chooser):
            if part is not None:
                part.after_reset()

    def served(self, split: str, keys: LayoutKeys) -> tuple[str, LayoutKeys]:
        """See `LayoutSource`."""
        return self.maker.served(split, keys)

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """See `LayoutSource`."""
        return self.maker.rejection_counts()
