"""`LayoutPipeline`: a maker of layouts with optional prefetching and level choice."""

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
    """Chooses the next layout of each world. Without a chooser, a world takes the next episode of its seed.

    Pass a chooser to an environment with `layout_source=lambda compiled, n: LayoutPipeline(maker, chooser=...)`. A
    chooser writes `next_seed`, `next_episode` and `next_param` of a LayoutsView. Its launches do not validate arguments
    and never wait for the host. Masks in the arguments have the shape (nworld,), bool, and None selects all worlds.
    Host code in these methods runs at the first resets only, unless the environment has `graph=False`: the launches are
    recorded to compile missing kernels, and captured.

    Attributes:
        layouts: The layouts of the only maker that may use this chooser. A pipeline with another maker rejects the
            chooser. None allows any maker.
    """

    layouts: Any = None

    def rows(self) -> Mapping[str, Any] | None:
        """Return the torch tensors that snapshots store instead of the chosen layouts, by name, with a row per world.

        If the method returns None, as it does by default, snapshots store the chosen layouts.
        """

    def launch_choose(self, mask: wp.array | None) -> None:
        """Choose the next layouts of the masked worlds, right after their present layouts were served.

        The episodes on the present layouts are just beginning, so their outcomes can only affect later choices.
        """

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """Process the outcomes of episodes. See `LayoutSource.launch_finish`."""

    def launch_forget(self, seeds: wp.array | None, mask: wp.array | None) -> None:
        """Drop the choices for the masked worlds, because `LayoutSource.launch_reseed` replaced them."""

    def launch_set_params(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """Use these param values for later choices. See `LayoutSource.launch_set_params`."""

    def after_reset(self) -> None:
        """Host-side hook, called after the launches of every reset."""


class LayoutPipeline(Fixed, LayoutSource):
    """A source that combines a maker of layouts with prefetching and a chooser.

    Args:
        maker: Makes the layouts. Do not use it elsewhere from now on.
        split: Split of the layouts, if the maker's `split` is None. If both are None, the split of the randomizer is
            used.
        ahead: Prefetches the layouts of the maker. If None, each layout is made when it is served.
        chooser: Chooses the next layouts. If None, the maker chooses them: by default, a world takes the
            next episode of its seed.

    Attributes:
        layouts: The latest layouts, in the arrays of the maker.
        split: Split of the layouts.

    Raises:
        ArgumentTypeError: `maker`, `ahead` or `chooser` has another type.
        ArgumentError: `ahead` or `chooser` belongs to another maker, or `split` is not the split of the maker.
        FixedError: Raised on assignment to an attribute that captured graphs already use.
    """

    _FIXED = ("maker", "ahead", "chooser", "layouts", "split", "hears")

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
                raise ArgumentError("LayoutPipeline: ahead should be made from the same maker: Ahead(maker).")
        if chooser is not None:
            check_type(chooser, Chooser, "LayoutPipeline: chooser")
            if chooser.layouts is not None and chooser.layouts is not maker.layouts:
                raise ArgumentError("LayoutPipeline: chooser belongs to another maker. Make a chooser for this one.")
        self.maker, self.ahead, self.layouts = maker, ahead, maker.layouts
        self._choices, self.chooser = (Chooser(), maker.chooser) if chooser is None else (chooser, chooser)
        self.split = maker.split or split
        self.hears = maker.hears or chooser is not None

    def launch_generate(self, mask: wp.array | None) -> None:
        """See `LayoutSource`."""
        if self.ahead is None:
            self.maker.launch_generate(mask)
        else:
            self.ahead.launch_open(mask)
            self.maker.launch_make(self.ahead.missing)
            self.ahead.launch_close(mask)
        self._choices.launch_choose(mask)

    def launch_reseed(self, seeds: wp.array | None, mask: wp.array | None, episodes: wp.array | None = None) -> None:
        """See `LayoutSource`."""
        self.maker.launch_reseed(seeds, mask, episodes)
        self._choices.launch_forget(seeds, mask)

    def launch_set_params(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """See `LayoutSource`. Layouts prefetched with other params are made again."""
        self._choices.launch_set_params(columns, values, mask)
        self.maker.launch_set_params(columns, values, mask)
        if self.ahead is not None:
            self.ahead.launch_forget(mask)

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """See `LayoutSource`."""
        self.maker.launch_finish(success, finished)
        self._choices.launch_finish(success, finished)

    def after_reset(self) -> None:
        """See `LayoutSource`."""
        for part in (self.maker, self.ahead, self._choices):
            if part is not None:
                part.after_reset()

    def served(self, split: str, keys: LayoutKeys) -> tuple[str, LayoutKeys]:
        """See `LayoutSource`."""
        return self.maker.served(split, keys)

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """See `LayoutSource`."""
        return self.maker.rejection_counts()
