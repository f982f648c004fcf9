"""`LayoutPipeline`: which layout each world gets next, who makes it, and when."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.device.fixed import Fixed
from sceniris_gym.errors import ArgumentError, check_type
from sceniris_gym.layout.ahead import Ahead
from sceniris_gym.layout.layouts import LayoutKeys
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.program.compiled import USER_SPLITS


class Chooser:
    """Asks for other layouts than the next episode of a seed.

    An environment takes one as `layout_source=lambda compiled, n: LayoutPipeline(maker, chooser=...)`. It writes
    `next_seed`, `next_episode` and `next_param` of a LayoutsView. Its launches check nothing, never wait for the host,
    and take a mask of worlds, shape (nworld,), bool; None is all. Work on the host is done once, at the capture, unless
    the environment has `graph=False`.

    Attributes:
        layouts: The layouts that it chooses for; None is those of any maker.
        rows: Arrays with a row for each world, by name, that snapshots have in place of the chosen layouts; None has
            the chosen ones.
    """

    layouts: Any = None
    rows: Mapping[str, wp.array] | None = None

    def launch_choose(self, mask: wp.array | None) -> None:
        """Choose the layouts that follow those which the masked worlds were just served.

        Episodes on these have just begun: their outcomes count from the next choice on.
        """

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """Hear how episodes ended; see `LayoutSource.launch_finish`."""

    def launch_forget(self, seeds: wp.array | None, mask: wp.array | None) -> None:
        """Forget what was chosen for the masked worlds, since `LayoutSource.launch_reseed` chose for them."""

    def launch_set_params(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """Choose layouts with these numbers of params from now on; see `LayoutSource.launch_set_params`."""

    def after_reset(self) -> None:
        """Host-side hook, called after the launches of every reset."""


class LayoutPipeline(Fixed, LayoutSource):
    """The layouts of a maker, some of them made ahead, chosen by a chooser.

    Args:
        maker: Makes the layouts; use it for nothing else from now on.
        split: Split of the layouts, if the maker has none of its own; None is that of the randomizer.
        ahead: Prefetches the layouts of the maker; None makes each as it is served.
        chooser: Chooses which layout follows; None goes from episode to episode of one seed.

    Attributes:
        layouts: The latest layouts, in the arrays of the maker.
        split: Split of the layouts.

    Raises:
        ArgumentTypeError: A maker, a prefetch or a chooser of another type.
        ArgumentError: A prefetch or a chooser of another maker, or another split than that of the maker.
        FixedError: Raised on assignment to an attribute that captured graphs already use.
    """

    _FIXED = ("maker", "ahead", "chooser", "layouts", "split", "hears", "rows")

    def __init__(
        self,
        maker: LayoutSource,
        split: str | None = None,
        *,
        ahead: Ahead | None = None,
        chooser: Chooser | None = None,
    ) -> None:
        check_type(maker, LayoutSource, "LayoutPipeline: maker")
        valid = USER_SPLITS if maker.split is None else (maker.split,)
        if split is not None and split not in valid:
            raise ArgumentError(f"LayoutPipeline: split should be {' or '.join(valid)}, got {short(split)}.")
        if ahead is not None:
            check_type(ahead, Ahead, "LayoutPipeline: ahead")
            if ahead.maker is not maker:
                raise ArgumentError("LayoutPipeline: ahead should prefetch for this maker: Ahead(maker).")
        if chooser is not None:
            check_type(chooser, Chooser, "LayoutPipeline: chooser")
            if chooser.layouts is not None and chooser.layouts is not maker.layouts:
                raise ArgumentError("LayoutPipeline: chooser should choose for the layouts of this maker.")
        self.maker, self.ahead, self.chooser, self.layouts = maker, ahead, chooser, maker.layouts
        self.split = maker.split or split
        self.hears = maker.hears or chooser is not None
        self.rows = maker.rows if chooser is None else chooser.rows

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

    def launch_set_params(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """See `LayoutSource`; what was made ahead for the masked worlds is made again."""
        if self.chooser is not None:
            self.chooser.launch_set_params(columns, values, mask)
        self.maker.launch_set_params(columns, values, mask)
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
